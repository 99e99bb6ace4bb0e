"""Measure: let a robot, an agent that learns and a recorder run for long; see that their memory stays flat.

    python -m tests.graph.soak --minutes 30

The drift of a process is its resident memory, median of the last minute, beyond that of the fourth minute, as a share.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from rled_msgs_py.bags import Bag

from .team import AGENT, DEMONSTRATION, Team, Watch, expert_of, private_graph, running

PAGE = os.sysconf("SC_PAGE_SIZE")
SETTLING_TIME, WINDOW = 180.0, 60.0
EVERY = 5.0
MAX_DRIFT = 0.02


def memory(process: int) -> int:
    """Resident bytes of a process.

    Raises:
        ProcessLookupError: it has ended.
    """
    size = int(Path(f"/proc/{process}/statm").read_text().split()[1]) * PAGE
    if not size:
        raise ProcessLookupError(f"process {process} has ended")
    return size


def child_of(process: int) -> int:
    """A child of a process that runs the learning program."""
    for task in Path(f"/proc/{process}/task").iterdir():
        for child in (task / "children").read_text().split():
            if b"learner_process" in Path(f"/proc/{child}/cmdline").read_bytes():
                return int(child)
    raise ProcessLookupError("the agent does not learn")


def drift(times: np.ndarray, sizes: np.ndarray) -> float:
    """Growth after the start has settled, as a share."""
    settled = min(SETTLING_TIME, times[-1] / 2.0)
    early = sizes[(times >= settled) & (times < settled + WINDOW)]
    return float(np.median(sizes[times > times[-1] - WINDOW]) / np.median(early) - 1.0)


def measure(minutes: float, period: float, folder: Path) -> dict[str, Any]:
    """Run and sample."""
    options = ("--period", str(period), "--start-points", str(DEMONSTRATION))
    team = Team(folder, expert_of(DEMONSTRATION, folder), options)
    with closing(Watch()) as watch, running(team):
        watch.wait(
            lambda: AGENT in watch.health and int(watch.health[AGENT][1].values.get("handovers", 0)) > 1, "learning"
        )
        processes = {name: each.pid for name, each in team.processes.items()}
        processes["learning process"] = child_of(processes["agent"])
        times, rows, began = [], [], time.monotonic()
        while times[-1:] < [60.0 * minutes]:
            watch.spin(EVERY)
            times.append(time.monotonic() - began)
            rows.append([memory(each) for each in processes.values()])
            if len(times) % 12 == 0:
                sizes = {name: f"{size / 2**20:.1f} MiB" for name, size in zip(processes, rows[-1], strict=True)}
                print(f"{times[-1]:.0f} s: {sizes}", flush=True)
        report = watch.health[AGENT][1].values
        took = team.stop()
    table = np.array(rows)  # (samples, processes)
    return {
        "minutes": round(times[-1] / 60.0, 1),
        "rate_hz": round(1.0 / period),
        "drift": {
            name: round(drift(np.array(times), column), 4) for name, column in zip(processes, table.T, strict=True)
        },
        "mib": {
            name: " ".join(f"{size / 2**20:.1f}" for size in column[:: max(1, len(column) // 10)])
            for name, column in zip(processes, table.T, strict=True)
        },
        "agent": {name: report[name] for name in ("offered", "dropped", "handovers", "deadlines_missed")},
        "recorded_messages": Bag(team.bags[0]).message_count,
        "ended_within_s": {name: round(seconds, 2) for name, seconds in took.items()},
        "load_average": os.getloadavg()[0],
    }


def main() -> None:
    """Measure and print; exits with 1 when a process grew by more than 2 %."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--period", type=float, default=0.01)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, private_graph():
        figures = measure(options.minutes, options.period, Path(folder))
    print(json.dumps(figures, indent=2))
    sys.exit(1 if max(figures["drift"].values()) > MAX_DRIFT else 0)


if __name__ == "__main__":
    main()
