"""What once failed is read or refused, and so are inputs drawn from valid ones."""

from threading import Event

import pytest

from .cases import CASES, Case, add_cases, cases_of, read_cases
from .target import names
from .watch import Job, watch

DRAWN = 300


@pytest.mark.parametrize("name", names())
def test_valid_inputs_are_read_and_cases_and_drawn_ones_read_or_refused(tmp_path, name):
    result = watch(Job(name, tmp_path, count=DRAWN), Event())
    assert not result.failure
    assert not result.found, "\n".join(f"{each}: {summary}" for each, summary in result.found.items())
    assert result.inputs > len(cases_of(name)) + 10


def test_cases_are_of_targets_and_small():
    assert {case.target for case in read_cases()} <= set(names())
    assert CASES.stat().st_size < 1_000_000


def test_findings_of_any_bytes_become_cases_once(tmp_path):
    inputs = {"b": b'{"a":\n1}', "a": bytes(range(256)), "c": b"", "d": "é".encode()}
    for name, data in inputs.items():
        (tmp_path / "urdf").mkdir(exist_ok=True)
        (tmp_path / "urdf" / name).write_bytes(data)
    found, packed = [tmp_path / "urdf" / name for name in inputs], tmp_path / "cases.jsonl"
    assert len(add_cases(found, packed)) == 4
    assert not add_cases(found, packed)
    assert read_cases(packed) == [Case("urdf", name, inputs[name]) for name in "abcd"]
