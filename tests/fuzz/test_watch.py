"""The fuzzer finds every fault that is planted, keeps its input, and goes on."""

import threading
import time

import pytest

from .findings import kept
from .targets._planted import FAULTS
from .watch import Job, watch

KINDS = {
    "raises": "KeyError",
    "works": "hang",
    "waits": "hang",
    "eats": "memory",
    "asks": "MemoryError",
    "leaves": "growth",
    "breaks": "SIGSEGV",
    "leaves_process": "exit3",
    "exits": "SystemExit",
    "sinks": "RecursionError",
}


def inputs(folder, names):
    folder.mkdir()
    for name in names:
        (folder / name).write_text(name)
    return sorted(folder.iterdir())


def test_every_planted_fault_is_found_by_its_input(tmp_path):
    files = inputs(tmp_path / "inputs", [*KINDS, "fine", "refused"])
    result = watch(Job("_planted", tmp_path, replay=files, patience=1.0), threading.Event())
    found = {path.read_text(): path.name.split("-")[0] for path in kept(tmp_path / "findings", "_planted")}
    assert not result.failure
    assert set(KINDS) == {name.decode() for name in FAULTS}
    assert found == KINDS
    assert set(result.found) == {path.name for path in kept(tmp_path / "findings", "_planted")}


def test_a_finding_says_where_it_was_and_how_to_see_it_again(tmp_path):
    files = inputs(tmp_path / "inputs", ["raises", "breaks"])
    watch(Job("_planted", tmp_path, replay=files), threading.Event())
    for path in kept(tmp_path / "findings", "_planted"):
        text = path.with_suffix(".txt").read_text()
        assert f"see it again: make fuzz ARGS='--replay {path}'" in text
        assert f"in {path.read_text()}" in text


def test_a_branch_behind_three_comparisons_is_found(tmp_path):
    pytest.importorskip("atheris")
    stop, results = threading.Event(), []
    job = Job("_planted", tmp_path, seconds=170.0, seed=1, patience=60.0)
    thread = threading.Thread(target=lambda: results.append(watch(job, stop)))
    thread.start()
    while thread.is_alive() and not any("ValueError" in each.name for each in kept(tmp_path / "findings", "_planted")):
        time.sleep(0.1)
    stop.set()
    thread.join()
    assert any("deep" in summary for summary in results[0].found.values()), results
    assert results[0].coverage
