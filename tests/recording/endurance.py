"""Measure: record five topics at 1 kHz for minutes; see that nothing is lost and memory stays flat.

python tests/recording/endurance.py --seconds 600
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from load import FIVE, PERIOD, shared, start_publishing
from rled_msgs_py.bags import Bag
from rled_msgs_py.processes import program

PAGE = os.sysconf("SC_PAGE_SIZE")
MAX_DRIFT = 0.05


def memory(process: int) -> int:
    """Resident bytes of a process."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * PAGE


def drift(samples: list[tuple[float, int]], settled: float) -> float:
    """Growth from ``settled`` seconds on to the end, medians of a tenth of the time each, as a share."""
    times, sizes = np.array(samples).T
    window = max(2.0, times[-1] / 10.0)
    early = sizes[(times >= settled) & (times < settled + window)]
    return float(np.median(sizes[times > times[-1] - window]) / np.median(early) - 1.0)


def measure(seconds: float, folder: Path) -> dict[str, Any]:
    """Record, with a look at the recorder's memory each second."""
    published = shared(round(seconds * 1e9 / PERIOD))
    load = start_publishing(published, wait_for_recorder=True)
    recorder = subprocess.Popen([*program("rled_teleop", "record_demos"), "--output", str(folder / "bag")])
    samples, began = list[tuple[float, int]](), time.monotonic()
    try:
        while os.waitpid(load, os.WNOHANG) == (0, 0):
            time.sleep(1.0)
            samples.append((time.monotonic() - began, memory(recorder.pid)))
            if len(samples) % 30 == 0:
                print(f"{samples[-1][0]:.0f} s: {samples[-1][1] / 2**20:.1f} MiB", flush=True)
    finally:
        recorder.send_signal(signal.SIGINT)
        recorder.wait(timeout=600)  # it reads the whole bag, to say what is in it
    bag = Bag(folder / "bag")
    expected = np.arange(len(published)) * PERIOD
    lost = {topic.name: len(expected) - bag.counts[topic.name] for topic in FIVE}
    in_order = np.array_equal(bag.joints(FIVE[0]).stamps, expected)
    longest = float(np.diff(published).max())
    settled = min(60.0, seconds / 2.0)
    return {
        "seconds": seconds,
        "published": len(published) * len(FIVE),
        "lost": lost,
        "joint_states_in_order": bool(in_order),
        "achieved_rate_hz": round(float((len(published) - 1) / (published[-1] - published[0])), 1),
        "longest_publisher_pause_ms": round(1e3 * longest, 1),
        "memory_drift_after_first_minute": round(drift(samples, settled), 4),
        "memory_mib": [round(size / 2**20, 1) for _, size in samples[:: max(1, len(samples) // 10)]],
        "load_average": os.getloadavg()[0],
    }


def main() -> None:
    """Measure and print; exits with 1 when a message was lost, or memory grew by 5 %."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    seconds = parser.parse_args().seconds
    with tempfile.TemporaryDirectory() as folder:
        figures = measure(seconds, Path(folder))
    print(json.dumps(figures, indent=2))
    sys.exit(any(figures["lost"].values()) or figures["memory_drift_after_first_minute"] >= MAX_DRIFT)


if __name__ == "__main__":
    main()
