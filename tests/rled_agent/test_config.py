"""Settings: from anywhere within their bounds, and those that people start from."""

import json
import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Annotated, get_args, get_origin, get_type_hints

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from rled_agent.cli.presets import PRESETS, all_presets
from rled_agent.learners.cloning import CloningConfig
from rled_agent.methods import Method, all_methods
from rled_agent.methods.biased_exploration import BiasedExploration
from rled_agent.methods.mc_rled import MCRLED
from rled_agent.methods.td3 import TD3
from rled_agent.per_seed import numbers
from rled_agent.training.config import Schedule, TrainConfig
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.validation import Range

from rled_agent import per_seed


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


CONFIGS = {name: TrainConfig(method()) for name, method in all_methods().items()}


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
    return TrainConfig.from_dict(values, all_methods())


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


@pytest.mark.parametrize("name", all_methods())
def test_a_methods_name_is_its_files_and_comes_with_title_and_paper(name):
    method = all_methods()[name]
    assert issubclass(method, Method)
    assert method().name == name
    assert method.title
    assert method.paper
    assert set(method.needs) <= {"expert", "demonstrations"}


def test_a_gate_is_what_its_methods_settings_say():
    gate = MCRLED(threshold=0.25, measure="iqr", passes=7).gate
    assert (gate.threshold, gate.measure, gate.passes, gate.estimator) == (0.25, "iqr", 7, "dropout")
    assert {name for name, method in all_methods().items() if method().gate is not None} == {"mc_rled"}


# Numbers that may differ between the seeds of a population.


@pytest.mark.parametrize("name", all_methods())
def test_every_number_of_a_method_that_may_differ_can_be_changed_within_its_bounds(name):
    method, bounds = all_methods()[name](), ranges(TrainConfig(all_methods()[name]()))
    for each in numbers(method):
        low, high = bounds[f"method.{each}"].low, bounds[f"method.{each}"].high
        for value in (low, (low + high) / 2.0, high):
            one = per_seed.changed(method, each, value)
            assert TrainConfig(one).method == changed(method, each, value)
    assert {"noise", "learner.gamma", "learner.tau"} <= set(numbers(method))


def test_settings_that_are_the_same_are_merged_into_themselves():
    methods = [MCRLED(noise=0.3), MCRLED(noise=0.3)]
    assert per_seed.merged(methods) is methods[0]


def test_numbers_that_differ_are_merged_into_exact_tensors():
    values = (0.1, 1e-3, 1.0 / 3.0)
    whole = per_seed.merged(
        [changed(changed(MCRLED(), "learner.gamma", each), "threshold", 2.0 * each) for each in values]
    )
    assert whole.learner.gamma.tolist() == [*values]
    assert whole.threshold.tolist() == [2.0 * each for each in values]
    assert [per_seed.of_seed(whole.learner.gamma, k) for k in range(3)] == [*values]
    assert (whole.noise, whole.learner.tau, whole.cloning) == (MCRLED().noise, MCRLED().learner.tau, MCRLED().cloning)


def test_a_column_has_the_dimensions_and_the_kind_of_what_it_goes_with():
    values = torch.tensor([0.1, 0.2], dtype=torch.float64)
    column = per_seed.column(values, torch.zeros(2, 5, 1))
    assert (column.shape, column.dtype) == ((2, 1, 1), torch.float32)
    assert column.flatten().tolist() == torch.tensor([0.1, 0.2]).tolist()
    assert per_seed.column(0.1, torch.zeros(2, 5)) == 0.1


@pytest.mark.parametrize(
    ("one", "other", "name"),
    [
        (MCRLED(passes=7), MCRLED(passes=8), "passes"),
        (MCRLED(demonstrated_share=0.1), MCRLED(), "demonstrated_share"),
        (MCRLED(), changed(MCRLED(), "learner.delay", 3), "delay"),
        (MCRLED(), changed(MCRLED(), "learner.actor.hidden", (9,)), "hidden"),
    ],
)
def test_what_decides_the_shape_of_learning_does_not_differ_between_seeds(one, other, name):
    with pytest.raises(ContractError, match=f"{name} differs between seeds; accepted: one value for all of them"):
        per_seed.merged([one, other])


# The settings that people start from.


def test_the_presets_of_the_thesis_hold_its_settings():
    panda, planar = PRESETS["panda_biased"].config, PRESETS["planar_mc"].config
    assert (type(panda.method), type(planar.method)) == (BiasedExploration, MCRLED)
    learners = panda.method.learner, planar.method.learner
    assert [(each.actor.hidden, each.critic.hidden) for each in learners] == [2 * ((400, 300),), 2 * ((128, 128),)]
    assert [each.gamma for each in learners] == [0.99, 0.95]
    assert [(each.actor_rate, each.critic_rate) for each in learners] == [(1e-3, 1e-3), (1e-5, 1e-5)]
    for each in learners:
        assert (each.critics, each.delay, each.target_noise, each.target_clip, each.tau) == (2, 2, 0.2, 0.5, 5e-3)
        assert not each.target_dropout
    schedules = panda.schedule, planar.schedule
    bursts = [(each.train_after, each.train_every, each.gradient_steps) for each in schedules]
    assert bursts == [(10_000, 1_000, 1_000), (1_000, 100, 100)]
    assert [(each.capacity, each.batch_size) for each in schedules] == [(1_000_000, 100), (50_000, 100)]
    assert (planar.method.noise, planar.method.passes, learners[1].actor.dropout) == (0.1, 30, 0.1)
    assert (learners[0].actor.weights, learners[0].critic.weights) == ("glorot", "glorot")  # TensorFlow's
    assert planar.method.measure == "qcd"
    for each in (panda.method, planar.method):  # nothing of what came later
        assert (each.demonstrated_share, each.cloning.weight) == (0.0, 0.0)


def test_what_is_compared_differs_in_its_method_alone():
    for gated, biased in (("planar_mc", "planar_biased"), ("planar_mc_tuned", "planar_biased_tuned")):
        one, other = (PRESETS[name].config for name in (gated, biased))
        assert one.to_dict() | {"method": "", "settings": {}} == other.to_dict() | {"method": "", "settings": {}}
        assert one.method.learner == other.method.learner
        assert (one.method.demonstrated_share, one.method.cloning) == (
            other.method.demonstrated_share,
            other.method.cloning,
        )


def test_every_method_is_a_preset_with_its_own_settings():
    found = all_presets()
    assert set(found) == {*PRESETS, *all_methods()}
    for name, method in all_methods().items():
        assert found[name].config.method == method()
        assert found[name].summary == method.title


@pytest.mark.parametrize("name", all_presets())
def test_settings_are_plain_values(name):
    config = all_presets()[name].config
    plain = json.loads(json.dumps(config.to_dict()))
    assert plain["method"] == config.method.name
    assert plain["settings"]["learner"]["actor"]["hidden"] == list(config.method.learner.actor.hidden)
