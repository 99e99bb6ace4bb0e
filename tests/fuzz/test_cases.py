"""What once failed is read or refused, and so are inputs drawn from valid ones."""

from threading import Event

import pytest

from .target import CASES, cases, names
from .watch import Job, watch

DRAWN = 300


@pytest.mark.parametrize("name", names())
def test_valid_inputs_are_read_and_cases_and_drawn_ones_read_or_refused(tmp_path, name):
    result = watch(Job(name, tmp_path, count=DRAWN), Event())
    assert not result.failure
    assert not result.found, "\n".join(f"{each}: {summary}" for each, summary in result.found.items())
    assert result.inputs > len(cases(name)) + 10


def test_cases_are_of_targets_and_small():
    files = [path for path in CASES.rglob("*") if path.is_file()]
    assert {path.parent.name for path in files} <= set(names())
    assert sum(path.stat().st_size for path in files) < 1_000_000
