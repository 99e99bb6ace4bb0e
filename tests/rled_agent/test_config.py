import json
import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Annotated, get_args, get_origin, get_type_hints

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_agent.cli.presets import all_presets
from rled_agent.learners.cloning import CloningConfig
from rled_agent.methods import Method, methods
from rled_agent.methods.biased_exploration import BiasedExploration
from rled_agent.methods.mc_rled import MCRLED
from rled_agent.methods.td3 import TD3
from rled_agent.training.config import Schedule, TrainConfig
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.validation import Range


def changed(settings, name: str, value: object):
    """The same settings with one, of a dotted name, replaced."""
    first, _, rest = name.partition(".")
    return replace(settings, **{first: changed(getattr(settings, first), rest, value) if rest else value})


def kinds(settings: object) -> Iterator[tuple[str, object]]:
    """The type of each field, by dotted name."""
    hints = get_type_hints(type(settings), include_extras=True)
    for each in fields(settings):
        value = getattr(settings, each.name)
        if is_dataclass(value):
            yield from ((f"{each.name}.{name}", kind) for name, kind in kinds(value))
        else:
            yield each.name, hints[each.name]


def ranges(settings: object) -> dict[str, Range]:
    """The closed range of each field that has one, by dotted name."""
    annotated = {name: get_args(kind)[1:] for name, kind in kinds(settings) if get_origin(kind) is Annotated}
    return {name: bound for name, bounds in annotated.items() for bound in bounds if isinstance(bound, Range)}


CONFIGS = {name: TrainConfig(method()) for name, method in methods().items()}


@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS)
def test_a_value_beyond_either_end_of_its_range_is_refused(config):
    for name, bound in ranges(config).items():
        for value in (bound.low - 1, bound.high * 2 + 1, math.nan):
            given = (64, value) if name.endswith("hidden") else value
            with pytest.raises(
                ContractError, match=rf"^({name}|{name.removeprefix('method.')}) .*; accepted: "
            ) as caught:
                changed(config, name, given)
            assert "\n" not in str(caught.value)


@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS)
def test_every_number_has_a_range(config):
    numbers = {name for name, kind in kinds(config) if kind in (int, float)}
    assert {name for name in numbers if not name.startswith("faults.")} == set()


def flat(values: dict, prefix: str = "") -> Iterator[tuple[str, object]]:
    for name, value in values.items():
        yield from flat(value, f"{prefix}{name}.") if isinstance(value, dict) else [(prefix + name, value)]


PLAIN = json.loads(json.dumps(TrainConfig(BiasedExploration()).to_dict()))
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9),
    lambda part: st.lists(part, max_size=3) | st.dictionaries(st.text(max_size=3), part, max_size=2),
    max_leaves=5,
)


def read(values: object) -> TrainConfig:
    return TrainConfig.from_dict(values, methods())


def test_what_was_written_is_read_again():
    for _, config in all_presets().values():
        assert read(json.loads(json.dumps(config.to_dict()))) == config


@given(
    st.sampled_from(
        [name for name, _ in flat(PLAIN)] + ["settings", "settings.learner", "settings.learner.actor", "schedule"]
    ),
    JSON,
)
def test_a_field_of_any_other_kind_is_one_clear_error_or_fits(name, value):
    values = json.loads(json.dumps(PLAIN))
    *path, last = name.split(".")
    part = values
    for each in path:
        part = part[each]
    part[last] = value
    try:
        config = read(values)
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
        ("settings.learner.actor.hidden", [1.5], "learner.actor.hidden (1.5,); accepted: a list, each a whole number"),
        ("settings.learner.actor.hidden", [-5], "learner.actor.hidden is (-5,); accepted: 1 to 100000"),
        ("settings.learner.actor.hidden", [0], "learner.actor.hidden is (0,); accepted: 1 to 100000"),
        ("settings.learner.actor.hidden", "abc", "learner.actor.hidden 'abc'; accepted: a list, each a whole number"),
        ("settings.learner.actor.hidden", [1] * 10**5, "accepted: at most 32 values"),
        ("settings.learner.actor", {"hidden": {"hidden": [3]}}, "actor has other fields"),
        ("settings.learner.actor", [], "learner.actor (); accepted: an object with hidden, activation"),
        ("settings.learner.actor.activation", "tanh", "learner.actor.activation 'tanh'; accepted: relu, leaky_relu"),
        ("settings.learner.critic.dropout", 0.5, "learner.critic.dropout is 0.5; accepted: 0"),
        ("schedule.capacity", 1e6, "schedule.capacity 1000000.0; accepted: a whole number"),
        ("schedule.capacity", 10**9, "schedule.capacity is 1000000000; accepted: 1 to 1e+07"),
        ("settings.passes", True, "passes True; accepted: a whole number"),
        ("method", "greedy", "config.method is 'greedy'; accepted: biased_exploration, ddpg, ibrl, jsrl, mc_rled, "),
        ("method", ["td3"], "config.method is '['td3']'; accepted: biased_exploration"),
        ("method", "td3", "config.settings has other fields; accepted: noise, random_steps, learner"),
        ("reward", None, "reward None; accepted: dense, sparse, own"),
        ("seed", -1, "seed is -1; accepted: 0 to"),
        ("env", 3, "env 3; accepted: a text"),
        ("env", "os:path-v0", "config.env is 'os:path-v0'; accepted: the name of a registered environment"),
        ("settings", None, "config.settings has other fields; accepted: phi, noise"),
        ("settings.cloning", None, "cloning None; accepted: an object with weight, q_filter"),
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
        read(values)
    assert said in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("values", [None, [], 3, "config", {}, {"env": "rled/PandaReach-v0"}, {"method": "td3"}])
def test_what_names_no_method_with_its_settings_is_refused(values):
    with pytest.raises(ContractError, match="config names no method with its settings; accepted: a run that"):
        read(values)


@pytest.mark.parametrize("values", [PLAIN | {"more": 1}, {"method": "td3", "settings": PLAIN["settings"]}])
def test_what_are_no_settings_of_this_version_is_refused(values):
    with pytest.raises(ContractError, match=r"config(\.settings)? has other fields; accepted: "):
        read(values)


def test_the_message_names_value_and_range():
    with pytest.raises(ContractError) as caught:
        changed(TrainConfig(BiasedExploration()), "method.phi", 1.5)
    assert str(caught.value) == "phi is 1.5; accepted: 0 to 1"


@pytest.mark.parametrize("name", ["checkpoint_every", "evaluate_every"])
def test_what_happens_between_rows_is_a_multiple_of_them(name):
    with pytest.raises(ContractError, match=rf"schedule\.{name} is 1500; accepted: a multiple of .*\(1000\)"):
        TrainConfig(TD3(), schedule=replace(Schedule(), **{name: 1500}))


@pytest.mark.parametrize(
    ("name", "value"),
    [("steps", 0), ("batch_size", 0), ("validate_every", 0), ("learning_rate", -1.0), ("validation_share", 2.0)],
)
def test_expert_settings_out_of_range_are_refused(name, value):
    with pytest.raises(ContractError, match=f"^{name} is {value}; accepted"):
        CloningConfig(**{name: value})


def test_the_expert_of_the_thesis_is_the_default():
    config = CloningConfig()
    assert config.architecture.hidden == (400, 300)
    assert config.architecture.activation == "leaky_relu"
    assert (config.learning_rate, config.batch_size) == (1e-3, 256)


@pytest.mark.parametrize("name", methods())
def test_a_methods_name_is_its_files_and_comes_with_title_and_paper(name):
    method = methods()[name]
    assert issubclass(method, Method)
    assert method().name == name
    assert method.title
    assert method.paper
    assert set(method.needs) <= {"expert", "demonstrations"}


def test_a_gate_is_what_its_methods_settings_say():
    gate = MCRLED(threshold=0.25, measure="iqr", passes=7).gate
    assert (gate.threshold, gate.measure, gate.passes, gate.estimator) == (0.25, "iqr", 7, "dropout")
    assert {name for name, method in methods().items() if method().gate is not None} == {"mc_rled"}
