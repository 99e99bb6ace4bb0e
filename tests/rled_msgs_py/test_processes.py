import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from rled_msgs_py.errors import RledError
from rled_msgs_py.processes import Child, Children, program

READY = "print('ready', flush=True)"
STUBBORN = "import signal; [signal.signal(each, signal.SIG_IGN) for each in (2, 15)];"


def python(code: str) -> list[str]:
    return [sys.executable, "-c", textwrap.dedent(code)]


def await_that(condition: Callable[[], bool], seconds: float = 10.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.01)


def is_ready(child: Child) -> bool:
    return "ready" in child.last_lines


def is_running(pid: int) -> bool:
    status = Path(f"/proc/{pid}/status")
    return status.exists() and "\nState:\tZ" not in status.read_text()


def test_a_child_has_the_open_files_that_it_is_given_and_no_others() -> None:
    given, kept = os.memfd_create("given"), os.memfd_create("kept")
    code = f"""
        import os
        os.write({given}, b"written")
        try:
            os.write({kept}, b"written")
        except OSError:
            os.write({given}, b", refused")
    """
    with Children() as children:
        children.wait(children.start(python(code), files=(given,)), timeout=10)
    assert os.pread(given, 100, 0) == b"written, refused"
    assert os.pread(kept, 100, 0) == b""


def test_a_command_is_printed_as_one_would_type_it(capfd: pytest.CaptureFixture[str]) -> None:
    with Children() as children:
        children.wait(children.start(["echo", "two words", "plain"], env={"ROS_DOMAIN_ID": "7"}), timeout=10)
    assert capfd.readouterr().out.splitlines() == ["$ ROS_DOMAIN_ID=7 echo 'two words' plain", "[echo] two words plain"]


def test_a_child_that_fails_is_reported_with_its_last_lines() -> None:
    with Children() as children:
        failing = children.start(["sh", "-c", "echo begin; echo 'error: unknown robot' >&2; exit 2"])
        with pytest.raises(RledError, match=r"sh ended with exit code 2: begin \| error: unknown robot"):
            children.wait(failing, timeout=10)


def test_waiting_for_one_child_fails_when_another_one_does() -> None:
    with Children() as children:
        long = children.start(["sleep", "100"])
        children.start(["sh", "-c", "exit 3"])
        with pytest.raises(RledError, match="sh ended with exit code 3"):
            children.wait(long, timeout=10)


def test_a_child_that_is_killed_is_reported_with_the_signal() -> None:
    with Children() as children:
        child = children.start(["sleep", "100"])
        child.process.kill()
        with pytest.raises(RledError, match="sleep ended by signal SIGKILL"):
            children.wait(child, timeout=10)


def test_a_child_that_takes_too_long_is_reported() -> None:
    with Children() as children, pytest.raises(RledError, match="sleep still runs"):
        children.wait(children.start(["sleep", "100"]), timeout=0.05)


def test_a_program_that_is_not_there_is_reported() -> None:
    with Children() as children, pytest.raises(RledError, match="no_such_program does not start"):
        children.start(["no_such_program"])


@pytest.mark.parametrize("inherited", [signal.SIG_DFL, signal.SIG_IGN])
def test_leaving_the_block_interrupts_a_child_which_can_clean_up(tmp_path: Path, inherited: signal.Handlers) -> None:
    code = f"""
        import pathlib, time
        try:
            {READY}
            time.sleep(100)
        except KeyboardInterrupt:
            pathlib.Path({str(tmp_path / "clean")!r}).touch()
    """
    before = signal.signal(signal.SIGINT, inherited)
    try:
        with Children() as children:
            child = children.start(python(code))
            await_that(lambda: is_ready(child))
    finally:
        signal.signal(signal.SIGINT, before)
    assert (tmp_path / "clean").exists()
    assert child.exit_code == 0


def test_a_child_that_ignores_signals_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rled_msgs_py.processes.END_TIMEOUTS", {signal.SIGINT: 0.1, signal.SIGTERM: 0.1})
    with Children() as children:
        child = children.start(python(f"import time; {STUBBORN} {READY}; time.sleep(100)"))
        await_that(lambda: is_ready(child))
    assert child.exit_code == -signal.SIGKILL


def test_the_children_of_a_child_end_with_it() -> None:
    with Children() as children:
        child = children.start(["sh", "-c", "sleep 100 & echo $!; echo ready; wait"])
        await_that(lambda: is_ready(child))
        grandchild = int(child.last_lines[0])
        assert is_running(grandchild)
    await_that(lambda: not is_running(grandchild))


def test_children_end_when_their_parent_is_killed() -> None:
    code = """
        import time
        from rled_msgs_py.processes import Children
        with Children() as children:
            print(children.start(["sleep", "100"]).process.pid, flush=True)
            time.sleep(100)
    """
    parent = subprocess.Popen(python(code), stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    assert parent.stdout.readline() == "$ sleep 100\n"
    child = int(parent.stdout.readline())
    assert is_running(child)
    parent.kill()
    parent.wait()
    parent.stdout.close()
    await_that(lambda: not is_running(child))


def test_a_program_of_a_sourced_workspace_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = tmp_path / "lib" / "some_package" / "some_node"
    script.parent.mkdir(parents=True)
    script.touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join(["/nowhere", str(tmp_path)]))
    assert program("some_package", "some_node") == [str(script)]


def test_a_program_that_is_not_installed_is_run_as_a_module(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    assert program("some_package", "some_node")[1:] == ["-m", "some_package.some_node"]
