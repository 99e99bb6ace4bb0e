"""Benchmarks report their figures with the fixture ``figure``; together they become out/bench/summary.json."""

import json
import platform
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from rled_msgs_py.files import write_whole

SUMMARY = Path(__file__).parents[2] / "out" / "bench" / "summary.json"


@pytest.fixture(scope="session")
def figure() -> Iterator[Callable[[str, float], None]]:
    """Call ``figure(name, value)`` with each figure measured, before asserting its bound."""
    figures: dict[str, float] = {}
    yield figures.__setitem__
    described = {"python": platform.python_version(), "numpy": np.__version__, "machine": platform.machine()}
    write_whole(SUMMARY, json.dumps(figures | {"environment": described}, indent=2, sort_keys=True) + "\n")
    rows = "".join(f"| `{name}` | {value:,.4g} |\n" for name, value in sorted(figures.items()))
    write_whole(SUMMARY.with_name("table.md"), f"| figure | measured |\n|---|---|\n{rows}")
    print(f"\n{SUMMARY.relative_to(Path.cwd()) if SUMMARY.is_relative_to(Path.cwd()) else SUMMARY}: {figures}")


def wanted(is_met: bool, what: str) -> None:
    """Say which aim a figure misses; it fails nothing, since figures differ by processor and by what else runs."""
    if not is_met:
        warnings.warn(f"wanted: {what}", stacklevel=2)
