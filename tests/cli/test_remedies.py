"""Each situation of docs/remedies.md is made, and mended by what the message says, letter by letter."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from .test_bad_input import CHANGES, PLANAR, changed, restarted

ROOT = Path(__file__).parents[2]
BIN = Path(sys.executable).parent
WAIT_TIMEOUT = 120.0
ROW = re.compile(r"\| (.+?) \| `(.+?)` \| (.+?) \|")
COMMAND = re.compile(r"(?:with|see): ((?:demos|python -m rled_\w+\.\w+|rosbags-convert) .*)|see (\w+ --help)")
REST = re.compile(r" \(or .*|, or .*|\)$")


class Shell:
    """A terminal in a folder whose name asks for quotes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.variables: dict[str, str | None] = {"PATH": f"{BIN}:{os.environ['PATH']}", "COLUMNS": "200"}

    def run(self, line: str) -> tuple[int, str]:
        """Exit code and what was printed."""
        environment = {name: value for name, value in (os.environ | self.variables).items() if value is not None}
        words = ["bash", "-c", line]
        done = subprocess.run(
            words, cwd=self.folder, env=environment, capture_output=True, text=True, timeout=WAIT_TIMEOUT, check=False
        )
        return done.returncode, done.stdout + done.stderr

    def says(self, line: str, what: str, code: int = 2) -> str:
        """The one line of what a command prints that has the message in it."""
        found, printed = self.run(line)
        assert found == code, printed
        return next(each for each in printed.splitlines() if what in each)


def command_in(message: str) -> str:
    found = COMMAND.search(message)
    assert found, message
    return REST.sub("", found[1] or found[2])


@pytest.fixture
def shell(tmp_path: Path) -> Shell:
    folder = tmp_path / "a person's bags; all of them"
    folder.mkdir()
    return Shell(folder)


def bag(shell: Shell, name: str = "bag") -> str:
    shutil.copytree(PLANAR, shell.folder / name)
    return shlex.quote(str(shell.folder / name))


def killed(shell: Shell, what: str) -> None:
    path = bag(shell)
    (shell.folder / "bag" / "metadata.yaml").unlink()
    assert (
        shell.run(command_in(shell.says(f"demos info {path}", what.replace("BAG", str(shell.folder / "bag")))))[0] == 0
    )
    assert shell.run(f"demos check {path}")[0] == 0


def flipped(shell: Shell, what: str) -> None:
    path = bag(shell)
    (file,) = (shell.folder / "bag").glob("*.mcap")
    content = bytearray(file.read_bytes())
    content[7 * len(content) // 10] ^= 1
    file.write_bytes(content)
    for _ in range(2):  # the file, then the bag that counted more messages in it
        code, printed = shell.run(f"demos check {path}")
        if code == 2:
            assert what in printed
            assert shell.run(command_in(printed.splitlines()[-1]))[0] == 0
    assert shell.run(f"demos check {path}")[0] in (0, 1)  # what is whole may have a gap


def faulty(shell: Shell, what: str) -> None:
    path = changed(shell.folder / "bag", CHANGES["messages lost"][0])
    leave_out(shell, path, what)


def begun_again(shell: Shell, what: str) -> None:
    leave_out(shell, restarted(shell.folder / "bag"), what)


def leave_out(shell: Shell, path: Path, what: str) -> None:
    line = command_in(shell.says(f"demos check {shlex.quote(str(path))}", what, code=1))
    assert shell.run(line.replace("NEW", "new"))[0] == 0
    assert what not in shell.run("demos check new")[1]


def trained_on(shell: Shell, what: str) -> None:
    path = shlex.quote(str(restarted(shell.folder / "bag")))
    code, printed = shell.run(command_in(shell.says(f"train_expert --bag {path} --source trajectories", what)))
    assert code == 1
    assert command_in(printed.splitlines()[0]).startswith("demos ")


def no_such_episode(shell: Shell, what: str) -> None:
    code, printed = shell.run(command_in(shell.says(f"demos drop {bag(shell)} --episodes 99999 --output new", what)))
    assert code == 0
    assert re.search(r"^ *199 ", printed, re.MULTILINE)


def too_good(shell: Shell, what: str) -> None:
    path = bag(shell)
    what = what.replace("BAG", str(shell.folder / "bag"))
    line = f"train_expert --bag {path} --source trajectories --min-quality 1"
    code, printed = shell.run(command_in(shell.says(line, what)))
    assert code == 0
    assert re.search(r"^episode .* score ", printed, re.MULTILINE)


def output_exists(shell: Shell, what: str) -> None:
    line = f"demos trim {bag(shell)} --to 1 --output new"
    assert shell.run(line)[0] == 0
    assert "--overwrite" in shell.says(line, what)
    assert shell.run(f"{line} --overwrite")[0] == 0


def run_exists(shell: Shell, what: str) -> None:
    line = (
        "train_agent pendulum --schedule.log-every 100 --schedule.checkpoint-every 100 --output run --schedule.steps {}"
    )
    assert shell.run(line.format(100))[0] == 0
    assert "--resume" in shell.says(line.format(200), what)
    code, printed = shell.run(f"{line.format(200)} --resume")
    assert code == 0
    assert "continuing at step 100" in printed


def no_such_option(shell: Shell, what: str) -> None:
    code, printed = shell.run(command_in(shell.says("sim_node --robots planar", what)))
    assert code == 0
    assert "--robot " in printed


def with_variable(name: str, wrong: str, right: Callable[[str], str | None]) -> Callable[[Shell, str], None]:
    """A node does not start with a variable, and does with the value that the message leads to."""

    def check(shell: Shell, what: str) -> None:
        shell.variables[name] = wrong
        line = "security_policy policy.xml --seconds 0.1"
        message = shell.says(line, what)
        assert name in message
        shell.variables[name] = right(message)
        assert "no node was seen" in shell.run(line)[1]

    return check


def first_accepted(message: str) -> str:
    return message.partition("accepted: ")[2].split(",")[0].split(" ")[0]


def nowhere_to_log(shell: Shell, what: str) -> None:
    (shell.folder / "sitecustomize.py").write_text("import tempfile\ntempfile.tempdir = '/proc'\n")
    shell.variables |= {"PYTHONPATH": str(shell.folder), "HOME": None, "ROS_HOME": None, "ROS_LOG_DIR": None}
    message = shell.says("security_policy policy.xml --seconds 0.1", what)
    assert "ROS_LOG_DIR" in message
    shell.variables["ROS_LOG_DIR"] = "log"
    assert "no node was seen" in shell.run("security_policy policy.xml --seconds 0.1")[1]
    assert (shell.folder / "log").is_dir()


def no_such_robot(shell: Shell, what: str) -> None:
    message = shell.says("python -m rled_sim.robot_description nobody", what)
    assert shell.run(f"python -m rled_sim.robot_description {first_accepted(message)}")[0] == 0


SITUATIONS: dict[str, Callable[[Shell, str], None]] = {
    "a recorder was killed": killed,
    "a bit of a bag is flipped": flipped,
    "a fault in a demonstration": faulty,
    "a restart within a recording": begun_again,
    "training on a faulty bag": trained_on,
    "an episode that a bag has not": no_such_episode,
    "a quality that no episode has": too_good,
    "a bag in the place of the output": output_exists,
    "a run in the place of the output": run_exists,
    "an option that a node has not": no_such_option,
    "a domain out of range": with_variable("ROS_DOMAIN_ID", "102", first_accepted),
    "a discovery range that is none": with_variable("ROS_AUTOMATIC_DISCOVERY_RANGE", "LAN", first_accepted),
    "a middleware that is not installed": with_variable("RMW_IMPLEMENTATION", "rmw_gone_cpp", lambda _: None),
    "no place for the log of ROS": nowhere_to_log,
    "a robot that there is not": no_such_robot,
}


def rows() -> Iterator[tuple[str, str]]:
    for line in (ROOT / "docs" / "remedies.md").read_text().splitlines():
        if (row := ROW.fullmatch(line)) is not None:
            yield row[1], row[2]


def test_the_table_has_the_situations_that_are_tested() -> None:
    assert [situation for situation, _ in rows()] == list(SITUATIONS)


@pytest.mark.parametrize(
    ("situation", "message"),
    list(rows()),
    ids=[situation for situation, _ in rows()],
)
def test_a_remedy_does_what_it_says(shell: Shell, situation: str, message: str) -> None:
    SITUATIONS[situation](shell, message)
