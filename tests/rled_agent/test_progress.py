import math
import os
import pty
import subprocess
import sys
import termios
import textwrap

import pytest
from rled_agent.training.progress import Progress, summary

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
        progress.say(2000, {"loss": 1234.5, "return": "1±2"})
    assert capsys.readouterr().err.splitlines() == [
        "step 1,000 of 2,000: loss 0.123",
        "step 2,000 of 2,000: loss 1.23e+03, return 1±2",
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


def row(**metrics: float) -> dict[str, float]:
    return {"step": 100.0, "updates_per_second": 50.0, "qcd_mean": 7.0} | metrics


def test_one_run_is_summed_up_by_its_metrics():
    assert summary([row(reward=-3.0, qcd_median=math.nan)], ["."]) == {
        "updates/s": 50.0, "return": -3.0, "uncertainty": pytest.approx(math.nan, nan_ok=True)
    }  # fmt: skip
    assert summary([], []) == {}


def test_several_runs_are_summed_up_by_mean_and_deviation_and_the_run_that_lags_behind():
    rows = [row(reward=each, demonstrated_share=0.5) for each in (1.0, -5.0, 4.0)]  # deviations 1, -5, 4 from 0
    assert summary(rows, ["seed-8", "seed-3", "seed-6"]) == {
        "updates/s": "150 in all",
        "return": "0±3.7",  # root of 42/3
        "demonstrated": "0.5±0",
        "behind": "seed-3 with a return of -5",
    }


def test_an_evaluation_decides_about_who_lags_behind():
    rows = [row(reward=each, evaluation_reward=-each) for each in (1.0, -5.0)]
    assert summary(rows, ["phi-0/seed-8", "seed-3"])["behind"] == "phi-0/seed-8 with a return of -1"


@pytest.mark.parametrize("rewards", [(2.0, 2.0), (1.0, math.nan), (math.nan, math.nan)])
def test_nobody_lags_behind_where_returns_are_equal_or_unknown(rewards):
    found = summary([row(reward=each) for each in rewards], ["seed-0", "seed-1"])
    assert "behind" not in found
    assert ("return" in found) == all(map(math.isfinite, rewards))
