"""The example script of the public interface, run as it is printed."""

import re
import subprocess
import sys
from pathlib import Path

import rled_agent

ROOT = Path(__file__).parents[2]


def test_the_example_learns_from_a_bag(tmp_path: Path) -> None:
    command = [sys.executable, "docs/examples/learn.py", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    reached = {name: int(share) for name, share in re.findall(r"^(\w+): (\d+)% of the targets", done.stdout, re.M)}
    assert reached.keys() == {"expert", "agent"}
    assert reached["agent"] >= 95
    assert (tmp_path / "policy.safetensors").is_file()


def test_every_public_name_is_there_and_documented() -> None:
    for name in rled_agent.__all__:
        assert getattr(rled_agent, name).__doc__, name
    assert sorted(rled_agent._HOMES) == sorted(rled_agent.__all__)
