import json
import math
from collections.abc import Iterator
from dataclasses import is_dataclass, replace
from typing import Annotated, get_args, get_origin, get_type_hints

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_agent.training.config import Schedule, TrainConfig
from rled_agent.learners.cloning import CloningConfig
from rled_agent.cli.presets import PRESETS
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.kinds import Range


def changed(settings, name: str, value: object):
    """The same settings with one, of a dotted name, replaced."""
    first, _, rest = name.partition(".")
    return replace(settings, **{first: changed(getattr(settings, first), rest, value) if rest else value})


def ranges(kind: type, prefix: str = "") -> Iterator[tuple[str, Range]]:
    """The closed range of each field that has one, by dotted name."""
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if is_dataclass(hint):
            yield from ranges(hint, f"{prefix}{name}.")
        for bound in get_args(hint)[1:] if get_origin(hint) is Annotated else ():
            if isinstance(bound, Range):
                yield prefix + name, bound


RANGES = dict(ranges(TrainConfig))


@pytest.mark.parametrize("name", RANGES)
def test_a_value_beyond_either_end_of_its_range_is_refused(name):
    low, high = RANGES[name].low, RANGES[name].high
    for value in (low - 1, high * 2 + 1, math.nan):
        given = (64, value) if name.endswith("hidden") else value
        with pytest.raises(ContractError, match=rf"^{name} .*; accepted: ") as caught:
            changed(TrainConfig(), name, given)
        assert "\n" not in str(caught.value)


def test_every_number_has_a_range():
    numbers = {name for name, value in flat(TrainConfig().to_dict()) if type(value) in (int, float)}
    assert {name for name in numbers if not name.startswith("faults.")} <= set(RANGES)


def flat(values: dict, prefix: str = "") -> Iterator[tuple[str, object]]:
    for name, value in values.items():
        yield from flat(value, f"{prefix}{name}.") if isinstance(value, dict) else [(prefix + name, value)]


PLAIN = json.loads(json.dumps(TrainConfig().to_dict()))
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9),
    lambda part: st.lists(part, max_size=3) | st.dictionaries(st.text(max_size=3), part, max_size=2),
    max_leaves=5,
)


def test_what_was_written_is_read_again():
    for _, config in PRESETS.values():
        assert TrainConfig.from_dict(json.loads(json.dumps(config.to_dict()))) == config


@given(st.sampled_from([name for name, _ in flat(PLAIN)] + ["learner", "learner.actor", "schedule"]), JSON)
def test_a_field_of_any_other_kind_is_one_clear_error_or_fits(name, value):
    values = json.loads(json.dumps(PLAIN))
    *path, last = name.split(".")
    part = values
    for each in path:
        part = part[each]
    part[last] = value
    try:
        config = TrainConfig.from_dict(values)
    except RledError as error:
        said = str(error)
    else:
        said = ""
        assert json.loads(json.dumps(config.to_dict())) == values
    assert "\n" not in said
    assert len(said) < 600


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("learner.actor.hidden", [1.5], "learner.actor.hidden (1.5,); accepted: a list, each a whole number"),
        ("learner.actor.hidden", [-5], "learner.actor.hidden is (-5,); accepted: 1 to 100000"),
        ("learner.actor.hidden", [0], "learner.actor.hidden is (0,); accepted: 1 to 100000"),
        ("learner.actor.hidden", "abc", "learner.actor.hidden 'abc'; accepted: a list, each a whole number"),
        ("learner.actor.hidden", [1] * 10**5, "accepted: at most 32 values"),
        ("learner.actor", {"hidden": {"hidden": [3]}}, "actor has other fields"),
        ("learner.actor", [], "learner.actor (); accepted: an object with hidden, activation"),
        ("learner.actor.activation", "tanh", "learner.actor.activation 'tanh'; accepted: relu, leaky_relu"),
        ("learner.critic.dropout", 0.5, "learner.critic.dropout is 0.5; accepted: 0"),
        ("schedule.capacity", 1e6, "schedule.capacity 1000000.0; accepted: a whole number"),
        ("schedule.capacity", 10**9, "schedule.capacity is 1000000000; accepted: 1 to 1e+07"),
        ("behaviour.passes", True, "behaviour.passes True; accepted: a whole number"),
        ("behaviour.name", "greedy", "behaviour.name 'greedy'; accepted: biased, gate, jump_start, proposal"),
        ("reward", None, "reward None; accepted: dense, sparse, own"),
        ("seed", -1, "seed is -1; accepted: 0 to"),
        ("env", 3, "env 3; accepted: a text"),
        ("env", "os:path-v0", "config.env is 'os:path-v0'; accepted: the name of a registered environment"),
        ("behaviour", None, "behaviour None; accepted: an object with name, phi"),
    ],
)
def test_settings_from_elsewhere_are_refused_by_name(name, value, said):
    values = json.loads(json.dumps(PLAIN))
    *path, last = name.split(".")
    part = values
    for each in path:
        part = part[each]
    part[last] = value
    with pytest.raises(ContractError) as caught:
        TrainConfig.from_dict(values)
    assert said in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("values", [None, [], 3, "config", {}, {"env": "rled/PandaReach-v0"}, PLAIN | {"more": 1}])
def test_what_are_no_settings_of_this_version_is_refused(values):
    with pytest.raises(ContractError, match="config has other fields; accepted: env, reward, "):
        TrainConfig.from_dict(values)


def test_the_message_names_value_and_range():
    with pytest.raises(ContractError) as caught:
        changed(TrainConfig(), "behaviour.phi", 1.5)
    assert str(caught.value) == "behaviour.phi is 1.5; accepted: 0 to 1"


@pytest.mark.parametrize("name", ["checkpoint_every", "evaluate_every"])
def test_what_happens_between_rows_is_a_multiple_of_them(name):
    with pytest.raises(ContractError, match=rf"schedule\.{name} is 1500; accepted: a multiple of .*\(1000\)"):
        TrainConfig(schedule=replace(Schedule(), **{name: 1500}))


@pytest.mark.parametrize(
    ("name", "value"),
    [("steps", 0), ("batch_size", 0), ("validate_every", 0), ("learning_rate", -1.0), ("validation_share", 2.0)],
)
def test_expert_settings_out_of_range_are_refused(name, value):
    with pytest.raises(ContractError, match=f"^{name} is {value}; accepted"):
        CloningConfig(**{name: value})


def test_the_presets_of_the_thesis_hold_its_settings():
    panda, planar = PRESETS["panda_biased"][1], PRESETS["planar_mc"][1]
    assert panda.learner.actor.hidden == panda.learner.critic.hidden == (400, 300)
    assert planar.learner.actor.hidden == planar.learner.critic.hidden == (128, 128)
    assert (panda.learner.gamma, planar.learner.gamma) == (0.99, 0.95)
    assert (panda.learner.actor_rate, panda.learner.critic_rate) == (1e-3, 1e-3)
    assert (planar.learner.actor_rate, planar.learner.critic_rate) == (1e-5, 1e-5)
    for each in (panda.learner, planar.learner):
        assert (each.critics, each.delay, each.target_noise, each.target_clip, each.tau) == (2, 2, 0.2, 0.5, 5e-3)
    schedules = [
        (each.schedule.train_after, each.schedule.train_every, each.schedule.gradient_steps) for each in (panda, planar)
    ]
    assert schedules == [(10_000, 1_000, 1_000), (1_000, 100, 100)]
    assert [(each.schedule.capacity, each.schedule.batch_size) for each in (panda, planar)] == [
        (1_000_000, 100),
        (50_000, 100),
    ]
    assert (planar.behaviour.noise, planar.behaviour.passes, planar.learner.actor.dropout) == (0.1, 30, 0.1)
    assert (panda.learner.actor.weights, panda.learner.critic.weights) == ("glorot", "glorot")  # TensorFlow's
    assert (panda.behaviour.name, planar.behaviour.name, planar.behaviour.measure) == ("biased", "gate", "qcd")


def test_the_expert_of_the_thesis_is_the_default():
    config = CloningConfig()
    assert config.architecture.hidden == (400, 300)
    assert config.architecture.activation == "leaky_relu"
    assert (config.learning_rate, config.batch_size) == (1e-3, 256)


@pytest.mark.parametrize("name", PRESETS)
def test_settings_are_plain_values(name):
    config = PRESETS[name][1]
    assert json.loads(json.dumps(config.to_dict()))["learner"]["actor"]["hidden"] == list(config.learner.actor.hidden)
