import math
import os
import pty
import subprocess
import sys
import termios
import textwrap

import pytest
from rled_agent.training.progress import Progress

WORK = """
    from rled_agent.training.progress import Progress
    with Progress("step", 3, 1) as progress:
        for done in (2, 3):
            progress.say(done, {"loss": 0.12345})
"""


def test_lines_are_plain_where_there_is_no_terminal(capsys):
    with Progress("step", 2000, 500) as progress:
        progress.move(600)
        progress.say(1000, {"loss": 0.123456, "targets": math.nan})
        progress.say(2000, {"loss": 1234.5})
    assert capsys.readouterr().err.splitlines() == [
        "step 1,000 of 2,000: loss 0.123",
        "step 2,000 of 2,000: loss 1.23e+03",
    ]


def test_plain_lines_are_at_least_a_second_apart_but_the_last_is_said(capsys, monkeypatch):
    now = [100.0]
    monkeypatch.setattr("rled_agent.training.progress.time.monotonic", lambda: now[0])
    with Progress("step", 10) as progress:
        for done, now[0] in ((1, 100.0), (2, 100.9), (3, 101.1), (4, 102.0), (9, 102.2), (10, 102.3)):
            progress.say(done, {"x": 0.0})
    assert [line.split()[1] for line in capsys.readouterr().err.splitlines()] == ["1", "3", "9", "10"]


def test_a_terminal_shows_a_bar_with_the_figures():
    parent, child = pty.openpty()
    termios.tcsetwinsize(child, (24, 120))
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(WORK)], stderr=child, stdout=child, timeout=60)
    shown = os.read(parent, 10_000).decode()
    os.close(parent)
    os.close(child)
    assert done.returncode == 0
    assert "3/3" in shown
    assert "loss=0.123" in shown


@pytest.mark.parametrize("total", [0, 1])
def test_nothing_done_says_nothing(capsys, total):
    Progress("step", total).close()
    assert capsys.readouterr().err == ""
