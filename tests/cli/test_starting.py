"""Commands start in any environment and with any streams; a signal in their first seconds ends them cleanly."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from rled_msgs_py.processes import program

PATIENCE = 60.0
COMMANDS = {
    "rled_sim.nodes.sim_node": "gymnasium",
    "rled_teleop.nodes.record_demos": "rclpy",
    "rled_agent.nodes.agent_node": "torch",
}
"""Commands, and the import in each that takes longest."""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("when", ["numpy.version", "the longest"])
def test_a_command_ends_cleanly_while_it_imports(command: str, when: str, number: signal.Signals) -> None:
    awaited = COMMANDS[command] if when == "the longest" else when
    package, _, module = command.partition(".")
    code = f"from rled_msgs_py.starting import {package}; {package}.{module}()"
    shown = [sys.executable, "-X", "importtime", "-c", code]  # says on stderr what it has imported
    with subprocess.Popen(shown, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        imported = (line.rpartition("|")[2].strip() for line in process.stderr)
        assert awaited in imported
        process.send_signal(number)
        rest = process.stderr.read()
        exit_code = process.wait(timeout=PATIENCE)
    assert "Traceback" not in rest
    assert exit_code == (130 if number == signal.SIGINT else -signal.SIGTERM)


def shell(line: str, *command: str, **environment: str | None) -> "subprocess.CompletedProcess[bytes]":
    """Run a command with its streams redirected; a variable that is None is not set."""
    variables = {name: value for name, value in (os.environ | environment).items() if value is not None}
    words = ["bash", "-c", f'exec "$@" {line}', "-", *command]
    return subprocess.run(words, env=variables, capture_output=True, timeout=PATIENCE, check=False)


ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


@pytest.mark.parametrize(
    "environment", [{"PYTHONIOENCODING": "latin-1"}, {"PYTHONIOENCODING": "ascii"}, ASCII], ids=str
)
@pytest.mark.parametrize("command", [("rled_agent", "agent_node"), ("rled_agent", "train_agent")], ids=str)
def test_help_is_shown_in_any_encoding(command: tuple[str, str], environment: dict[str, str]) -> None:
    shown = shell("", *program(*command), "--help", **environment)
    assert (shown.returncode, shown.stderr) == (0, b"")
    encoding = environment.get("PYTHONIOENCODING", "ascii")
    assert command[1] in shown.stdout.decode(encoding)


def test_an_error_names_its_offender_in_any_encoding() -> None:
    said = shell("", *program("rled_teleop", "demos"), "info", "/keine/Vorführung", **ASCII)
    assert said.returncode == 2
    assert said.stderr.startswith(b"error: /keine/Vorf")
    assert said.stderr.count(b"\n") == 1


STREAMS = """
import os, sys
from rled_msgs_py.starting import _open_streams
_open_streams()
file = os.open(sys.argv[1], os.O_CREAT | os.O_WRONLY)
assert file > 2
print("to standard output", flush=True)
print("to standard error \\u03be", file=sys.stderr)
assert sys.stdin.read() == ""
"""


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-", "<&-", "<&- >&- 2>&-"])
def test_a_closed_stream_is_nowhere_and_no_file_takes_its_place(tmp_path: Path, closed: str) -> None:
    file = tmp_path / "file"
    ended = shell(f"{closed} </dev/null" if "<" not in closed else closed, sys.executable, "-c", STREAMS, str(file))
    assert ended.returncode == 0, ended.stderr
    assert file.read_bytes() == b""


@pytest.mark.parametrize("variables", [{"HOME": None}, {"HOME": "/proc"}, {"ROS_LOG_DIR": "/dev/null"}], ids=str)
def test_a_node_starts_where_ros_cannot_log(tmp_path: Path, variables: dict[str, str | None]) -> None:
    ended = shell(
        "", *program("rled_msgs_py", "security_policy"), str(tmp_path / "policy.xml"), "--seconds", "0.1",
        **{"ROS_LOG_DIR": None, "ROS_HOME": None, "TMPDIR": str(tmp_path)} | variables,
    )  # fmt: skip
    first, last = ended.stderr.decode().splitlines()
    (folder,) = tmp_path.glob("ros-log-*")
    assert first.endswith(f"ROS logs to {folder}")
    assert last.startswith("error: no node was seen")
    assert ended.returncode == 2


def test_an_unknown_middleware_is_one_line_where_ros_is_needed_and_nothing_elsewhere() -> None:
    refused = shell("", *program("rled_sim", "sim_node"), RMW_IMPLEMENTATION="rmw_gone_cpp")
    assert refused.returncode == 2
    assert refused.stderr.startswith(b"error: RMW_IMPLEMENTATION is 'rmw_gone_cpp'; accepted: ")
    shown = shell("", *program("rled_sim", "robot_description"), "planar", RMW_IMPLEMENTATION="rmw_gone_cpp")
    assert shown.returncode == 0


WORKING = """
import signal, sys, tempfile, types
from rled_msgs_py.starting import rled_working

def main():
    with tempfile.NamedTemporaryFile(dir=sys.argv[1]) as file:
        print("begun", flush=True)
        signal.pause()

sys.modules["rled_working"] = types.SimpleNamespace(main=main)
rled_working()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_command_in_order(tmp_path: Path, number: signal.Signals) -> None:
    words = [sys.executable, "-c", WORKING, str(tmp_path)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        process.send_signal(number)
        _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 128 + number
    assert errors == ("interrupted\n" if number == signal.SIGINT else "")
    assert list(tmp_path.iterdir()) == []


def test_the_end_of_the_terminal_is_nothing_behind_nohup() -> None:
    look = "import signal; from rled_msgs_py.stopping import stop_requested as s"
    code = f"{look}\nwith s() as stop: signal.raise_signal(signal.SIGHUP); print(stop.is_set())"
    assert shell("", "nohup", sys.executable, "-c", code).stdout == b"False\n"
    assert shell("", sys.executable, "-c", code).stdout == b"True\n"


def test_a_command_that_is_not_installed_is_run_as_its_module(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    monkeypatch.setenv("AMENT_PREFIX_PATH", "")
    assert program("rled_sim", "sim_node") == ["/nowhere/python", "-m", "rled_sim.nodes.sim_node"]
    assert program("rled_sim", "robot_description")[-1] == "rled_sim.robot_description"
