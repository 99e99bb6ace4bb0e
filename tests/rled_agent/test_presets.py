"""The settings that people start from."""

import json

import pytest
from rled_agent.cli.presets import PRESETS, all_presets
from rled_agent.methods import methods
from rled_agent.methods.biased_exploration import BiasedExploration
from rled_agent.methods.mc_rled import MCRLED


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
    assert set(found) == {*PRESETS, *methods()}
    for name, method in methods().items():
        assert found[name].config.method == method()
        assert found[name].summary == method.title


@pytest.mark.parametrize("name", all_presets())
def test_settings_are_plain_values(name):
    config = all_presets()[name].config
    plain = json.loads(json.dumps(config.to_dict()))
    assert plain["method"] == config.method.name
    assert plain["settings"]["learner"]["actor"]["hidden"] == list(config.method.learner.actor.hidden)
