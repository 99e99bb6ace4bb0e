import json
import math
from dataclasses import replace

import pytest
from rled_agent.config import RANGES, ConfigError, ScheduleConfig, TrainConfig
from rled_agent.expert import ExpertConfig
from rled_agent.presets import PRESETS


def changed(settings, name: str, value: object):
    """The same settings with one, of a dotted name, replaced."""
    first, _, rest = name.partition(".")
    return replace(settings, **{first: changed(getattr(settings, first), rest, value) if rest else value})


@pytest.mark.parametrize("name", RANGES)
def test_a_value_beyond_either_end_of_its_range_is_refused(name):
    low, high = RANGES[name]
    for value in (low - 1, high * 2 + 1, math.nan):
        given = (64, value) if name.endswith("hidden") else value
        with pytest.raises(ConfigError, match=rf"^{name} is .*; accepted: {low:g} to ") as caught:
            changed(TrainConfig(), name, given)
        assert "\n" not in str(caught.value)


def test_the_message_names_value_and_range():
    with pytest.raises(ConfigError) as caught:
        changed(TrainConfig(), "behaviour.phi", 1.5)
    assert str(caught.value) == "behaviour.phi is 1.5; accepted: 0 to 1"


@pytest.mark.parametrize("name", ["checkpoint_every", "evaluate_every"])
def test_what_happens_between_rows_is_a_multiple_of_them(name):
    with pytest.raises(ConfigError, match=rf"schedule\.{name} is 1500; accepted: a multiple of .*\(1000\)"):
        TrainConfig(schedule=replace(ScheduleConfig(), **{name: 1500}))


@pytest.mark.parametrize(
    ("name", "value"),
    [("steps", 0), ("batch_size", 0), ("validate_every", 0), ("learning_rate", -1.0), ("validation_share", 2.0)],
)
def test_expert_settings_out_of_range_are_refused(name, value):
    with pytest.raises(ConfigError, match=f"^{name} is {value}; accepted"):
        ExpertConfig(**{name: value})


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
    config = ExpertConfig()
    assert config.architecture.hidden == (400, 300)
    assert config.architecture.activation == "leaky_relu"
    assert (config.learning_rate, config.batch_size) == (1e-3, 256)


@pytest.mark.parametrize("name", PRESETS)
def test_settings_are_plain_values(name):
    config = PRESETS[name][1]
    assert json.loads(json.dumps(config.to_dict()))["learner"]["actor"]["hidden"] == list(config.learner.actor.hidden)
