"""A run goes on only as the run that began."""

import copy
from pathlib import Path
from typing import Any

import pytest
from rled_agent.training.resuming import require_same_run
from rled_msgs_py.errors import RledError

BEGAN: dict[str, Any] = {
    "config": {
        "method": "td3", "settings": {"learner": {"actor": {"hidden": [8, 6]}}}, "seed": 3, "schedule": {"steps": 100}
    },
    "demonstrations": {
        "bag": "a/bag", "bag_sha256": "1" * 64, "expert": "a/expert", "expert_sha256": "2" * 64, "points": 0,
        "over": "graph", "simulation": {"max_steps": 100, "limits": {"collisions": False}},
    },
}  # fmt: skip


def changed(**values: Any) -> dict[str, Any]:
    """The record with values of dotted names, with two underscores for a dot."""
    record = copy.deepcopy(BEGAN)
    for name, value in values.items():
        *path, last = name.split("__")
        part = record
        for each in path:
            part = part[each]
        part[last] = value
    return record


@pytest.mark.parametrize(
    "values",
    [{}, {"config__schedule__steps": 900}, {"demonstrations__bag": "b/bag", "demonstrations__expert": "b/expert"}],
)
def test_more_steps_and_the_same_files_elsewhere_go_on(values):
    require_same_run(BEGAN, changed(**values), Path("run"))
    require_same_run(BEGAN | {"git": "abc"}, changed(**values), Path("run"))


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"demonstrations__bag_sha256": "3" * 64}, "what is in the bag a/bag has changed since the run began"),
        ({"demonstrations__expert_sha256": "3" * 64}, "what is in the expert a/expert has changed since the run began"),
        (
            {"demonstrations__expert": "b", "demonstrations__expert_sha256": "3"},
            "the expert b holds something else",
        ),
        ({"demonstrations__bag": "None", "demonstrations__bag_sha256": None}, "the bag None holds something else than"),
        ({"demonstrations__points": 7}, "demonstrations.points changed since the run began; accepted: .*points 0"),
        (
            {"config__settings__learner__actor__hidden": [8, 7]},
            "config.settings.learner.actor.hidden changed",
        ),
        ({"config__method": "ddpg"}, "the method is ddpg, and the run began with another; accepted: td3"),
        ({"demonstrations__simulation__max_steps": 50}, "demonstrations.simulation.max_steps changed since"),
        (
            {"demonstrations__simulation__limits__collisions": True},
            "simulation.limits.collisions changed",
        ),
        ({"demonstrations__over": "process", "demonstrations__simulation": None}, "^demonstrations.over changed since"),
        ({"config__more": 1}, r"begun by a version with other settings \(config.more\)"),
    ],
)
def test_what_is_not_the_same_is_named(values, said):
    with pytest.raises(RledError, match=said) as caught:
        require_same_run(BEGAN, changed(**values), Path("run"))
    assert "begin a new run with another --output" in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("began", [{}, {"config": [], "demonstrations": 3}, {"config": None}, {"config": {}}])
def test_what_no_run_wrote_is_of_another_version(began):
    with pytest.raises(RledError, match="the run in run was begun by a version with other settings"):
        require_same_run(began, BEGAN, Path("run"))
