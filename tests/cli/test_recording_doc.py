"""The page on recording: its commands are run as they are printed, in their order, in an empty folder."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from rled_msgs_py.bags import Bag, review

PAGE = Path(__file__).parents[2] / "docs" / "recording.md"


def commands() -> list[str]:
    """The blocks marked ``bash``, in order; a block of another kind is no command to run here."""
    return re.findall(r"^```bash\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)


@pytest.mark.timeout(300)
def test_the_commands_run_as_printed(tmp_path: Path) -> None:
    script = "set -euxo pipefail\n" + "".join(commands())
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=280, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    folder = tmp_path / "out" / "recording"
    assert {each.name for each in folder.iterdir()} >= {
        "bag",
        "shaky",
        "plots",
        "part",
        "both",
        "one",
        "killed",
        "expert",
    }
    assert len(review(Bag(folder / "both")).episodes) == 2
    assert "left out: " in done.stdout
    assert "no faults" in done.stdout


def test_each_subcommand_is_shown() -> None:
    text = "".join(commands())
    for name in ("info", "check", "plot", "trim", "merge", "drop", "repair"):
        assert f"demos {name} " in text
