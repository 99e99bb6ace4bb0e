"""An error of a user is one line."""

import os
import pickle
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from rled_msgs_py.errors import ContractError, RledError, command, command_line


def test_message_says_what_is_accepted_and_the_remedy():
    assert str(RledError("x is 3", "1 to 2", "choose less")) == "x is 3; accepted: 1 to 2; choose less"
    assert str(RledError("x is 3")) == "x is 3"


def test_error_survives_pickling():
    error = pickle.loads(pickle.dumps(ContractError("x is 3", "1 to 2", "choose less")))
    assert type(error) is ContractError
    assert (error.what, error.accepted, error.remedy) == ("x is 3", "1 to 2", "choose less")


def raising(error):
    @command_line
    def main():
        raise error

    return main


def test_a_users_mistake_ends_a_command_with_one_line_and_2(capsys):
    with pytest.raises(SystemExit) as exit_:
        raising(RledError("first\nsecond", "this"))()
    assert exit_.value.code == 2
    assert capsys.readouterr().err == "error: first second; accepted: this\n"


def test_interrupt_ends_a_command_with_130(capsys):
    with pytest.raises(SystemExit) as exit_:
        raising(KeyboardInterrupt())()
    assert exit_.value.code == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_a_programmers_mistake_keeps_its_traceback():
    with pytest.raises(ZeroDivisionError):
        raising(ZeroDivisionError())()


TALKATIVE = """
from rled_msgs_py.errors import command_line

@command_line
def main():
    while True:
        print("a line")

main()
"""
BROKEN_ELSEWHERE = """
import os
from rled_msgs_py.errors import command_line

@command_line
def main():
    print("said before")
    reader, writer = os.pipe()
    os.close(reader)
    os.write(writer, b"x")

main()
"""


def test_a_command_whose_output_nobody_reads_any_more_ends_quietly():
    with subprocess.Popen([sys.executable, "-c", TALKATIVE], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as command:
        command.stdout.readline()
        command.stdout.close()
        assert command.stderr.read() == b""
        assert command.wait(10) == 141


def test_another_pipe_that_breaks_is_still_an_error():
    command = subprocess.run([sys.executable, "-c", BROKEN_ELSEWHERE], capture_output=True, text=True, timeout=10)
    assert (command.returncode, command.stdout) == (2, "said before\n")
    assert "Broken pipe" in command.stderr


def test_an_error_is_printed_in_one_line_and_a_path_keeps_its_spaces(capsys):
    said = command("demos", "repair", Path("two  spaces"))
    with pytest.raises(SystemExit):
        raising(RledError("it is\n   damaged", "", said))()
    assert capsys.readouterr().err == "error: it is damaged; demos repair 'two  spaces'\n"


def test_a_command_in_a_remedy_survives_a_shell():
    said = command("demos", "info", Path("/data/it's mine; $HOME"))
    assert shlex.split(said) == ["demos", "info", "/data/it's mine; $HOME"]
    assert command("demos", "repair", Path("bags/one")) == "demos repair bags/one"
    assert command("demos", "repair", Path("--help")) == "demos repair ./--help"


SPEAKING = """
import sys
from rled_msgs_py.errors import RledError, command_line

@command_line
def main():
    print("a line")
    if sys.argv[1:]:
        raise RledError("x is 3")

main()
"""


def spoken(where: str, *arguments: str) -> "subprocess.CompletedProcess[str]":
    command = ["bash", "-c", f'exec "$@" {where}', "-", sys.executable, "-c", SPEAKING, *arguments]
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    return subprocess.run(command, capture_output=True, text=True, timeout=20, env=buffered)


def test_output_that_cannot_be_written_is_one_line() -> None:
    said = spoken(">/dev/full")
    assert (said.returncode, said.stderr) == (2, "error: [Errno 28] No space left on device\n")


def test_an_error_goes_before_output_that_cannot_be_written() -> None:
    said = spoken(">/dev/full", "fail")
    assert (said.returncode, said.stderr) == (2, "error: x is 3\n")


def test_the_exit_code_is_kept_where_the_error_cannot_be_written() -> None:
    said = spoken("2>/dev/full", "fail")
    assert (said.returncode, said.stdout) == (2, "a line\n")
    assert spoken(">/dev/full 2>/dev/full", "fail").returncode == 2


def test_no_memory_and_no_unicode_are_a_users_errors(capsys):
    for error, said in ((MemoryError(), "out of memory"), (UnicodeDecodeError("utf-8", b"x", 0, 1, "why"), "'utf-8'")):
        with pytest.raises(SystemExit) as exit_:
            raising(error)()
        assert exit_.value.code == 2
        assert capsys.readouterr().err.startswith(f"error: {said}")
