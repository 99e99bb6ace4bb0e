"""The measurements of recordings under load, with small numbers: they run, and what was received is kept."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent


def measured(script: str, *arguments: str) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, str(HERE / script), *arguments], capture_output=True, text=True, timeout=150, check=False
    )
    assert "{" in done.stdout, done.stderr
    figures: dict[str, Any] = json.loads(done.stdout[done.stdout.index("{\n") :])
    return figures


def test_killed_recorders_leave_bags_that_all_readers_read() -> None:
    figures = measured("kills.py", "--kills", "3")
    assert figures["readable_bags"] == figures["kills"] == 3
    assert figures["since_received"]["median_ms"] < 250.0  # more than alone: others may use the machine


def test_five_topics_at_1_khz_lose_no_message() -> None:
    figures = measured("endurance.py", "--seconds", "5")
    assert figures["published"] == 25_000
    assert not any(figures["lost"].values()), figures
    assert figures["joint_states_in_order"]
