import math

import numpy as np
import pytest
import torch
from rled_agent.exploration.behaviour import BiasedExploration, MonteCarloGate, Noise, actor_source, policy_source
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.scaling import scaling_of_bounds
from rled_agent.uncertainty.monte_carlo import Estimate
from rled_msgs_py.records import Actor

STATE = np.zeros(4, dtype=np.float32)
AGENT, EXPERT = (np.array(action, dtype=np.float32) for action in ([0.5, -0.5], [0.25, 0.75]))
SILENT = Noise(0.0, np.random.default_rng(0))


def biased(phi: float, seed: int = 0, expert=lambda _: EXPERT, noise: Noise = SILENT) -> BiasedExploration:
    return BiasedExploration(lambda _: AGENT, expert, noise, phi, np.random.default_rng(seed))


def gate(threshold: float, measure: str = "qcd", noise: Noise = SILENT, **uncertainty: float) -> MonteCarloGate:
    return MonteCarloGate(lambda _: Estimate(AGENT, uncertainty), lambda _: EXPERT, noise, threshold, measure)


@pytest.mark.parametrize("phi", [0.1, 0.3])
def test_the_share_of_expert_episodes_is_phi(phi):
    behaviour, drawn = biased(phi), []
    for _ in range(5000):
        behaviour.begin()
        drawn.append(behaviour.act(STATE).actor is Actor.EXPERT)
    assert abs(np.mean(drawn) - phi) < 4 * np.sqrt(phi * (1 - phi) / 5000)
    after_expert = np.array(drawn[1:])[np.array(drawn[:-1])]
    assert abs(np.mean(after_expert) - phi) < 4 * np.sqrt(phi * (1 - phi) / len(after_expert))


def test_one_actor_drives_a_whole_episode():
    behaviour, episodes = biased(0.5), []
    for _ in range(50):
        behaviour.begin()
        choices = [behaviour.act(STATE) for _ in range(20)]
        episodes.append({choice.actor for choice in choices})
        expected = EXPERT if Actor.EXPERT in episodes[-1] else AGENT
        assert all(np.array_equal(choice.action, expected) for choice in choices)
    assert sorted(map(len, episodes)) == [1] * 50
    assert {Actor.EXPERT} in episodes
    assert {Actor.AGENT} in episodes


def test_an_episode_costs_one_draw():
    behaviour, same = biased(0.5, seed=3), np.random.default_rng(3)
    for _ in range(10):
        behaviour.begin()
        assert behaviour.expert_episode == (same.random() < 0.5)
        for _ in range(5):
            behaviour.act(STATE)
    assert behaviour.generator.bit_generator.state == same.bit_generator.state


@pytest.mark.parametrize(("phi", "expert"), [(0.0, lambda _: EXPERT), (1.0, None)])
def test_without_phi_or_without_an_expert_the_agent_always_acts(phi, expert):
    behaviour = biased(phi, expert=expert)
    for _ in range(100):
        behaviour.begin()
        assert behaviour.act(STATE).actor is Actor.AGENT


def test_with_phi_of_one_the_expert_always_acts():
    behaviour = biased(1.0)
    for _ in range(100):
        behaviour.begin()
        assert behaviour.act(STATE).actor is Actor.EXPERT


def test_the_expert_acts_without_noise():
    behaviour = biased(1.0, noise=Noise(0.5, np.random.default_rng(0)))
    behaviour.begin()
    np.testing.assert_array_equal(behaviour.act(STATE).action, EXPERT)


def test_biased_exploration_reports_the_uncertainty_it_was_told_to_estimate():
    behaviour = BiasedExploration(
        lambda _: AGENT, None, SILENT, 0.0, np.random.default_rng(0), lambda _: Estimate(AGENT, {"qcd": 0.7})
    )
    behaviour.begin()
    assert behaviour.act(STATE).uncertainty == {"qcd": 0.7}
    assert biased(0.0).act(STATE).uncertainty == {}


def test_the_gate_lets_the_expert_act_from_the_threshold_on():
    assert gate(0.5, qcd=np.nextafter(0.5, 0)).act(STATE).actor is Actor.AGENT
    assert gate(0.5, qcd=0.5).act(STATE).actor is Actor.EXPERT
    assert gate(0.5, qcd=np.inf).act(STATE).actor is Actor.EXPERT
    assert gate(0.0, qcd=0.0).act(STATE).actor is Actor.EXPERT


def test_the_gate_takes_an_uncertainty_that_is_no_number_for_unsure():
    assert gate(0.5, qcd=math.nan).act(STATE).actor is Actor.EXPERT


def test_the_gate_gives_the_mean_or_the_experts_action():
    np.testing.assert_array_equal(gate(0.5, qcd=0.1).act(STATE).action, AGENT)
    np.testing.assert_array_equal(gate(0.5, qcd=0.9).act(STATE).action, EXPERT)


@pytest.mark.parametrize(("measure", "actor"), [("qcd", Actor.EXPERT), ("iqr", Actor.AGENT)])
def test_the_gate_compares_the_chosen_measure_and_reports_both(measure, actor):
    choice = gate(0.5, measure, qcd=0.9, iqr=0.1).act(STATE)
    assert choice.actor is actor
    assert choice.uncertainty == {"qcd": 0.9, "iqr": 0.1}


def test_the_gate_explores_around_the_mean():
    same = np.random.default_rng(4).normal(0.0, 0.1, 2)
    choice = gate(0.5, noise=Noise(0.1, np.random.default_rng(4)), qcd=0.1).act(STATE)
    np.testing.assert_allclose(choice.action, AGENT + same, rtol=1e-6)


def test_noise_has_its_deviation_and_is_clipped():
    noise = Noise(0.2, np.random.default_rng(0))
    actions = np.array([noise.added_to(np.array([0.0, 0.9], dtype=np.float32)) for _ in range(4000)])
    assert actions.dtype == np.float32
    assert actions[:, 0].std() == pytest.approx(0.2, rel=0.05)
    assert abs(actions[:, 0].mean()) < 0.015
    assert actions.max() == 1.0
    assert (actions[:, 1] == 1.0).mean() == pytest.approx(0.309, abs=0.03)  # P(N(0, 1) > 0.5)


def test_an_actor_acts_without_dropout_and_its_action_outlives_the_next():
    actor = Perceptron(4, 2, Architecture(hidden=(16,), dropout=0.5), torch.Generator().manual_seed(0), squash=True)
    act = actor_source(actor)
    first = act(STATE)
    before = first.copy()
    np.testing.assert_array_equal(act(STATE), before)
    act(STATE + 1)
    np.testing.assert_array_equal(first, before)


def test_a_policy_in_other_units_acts_alike(make_policy):
    policy = make_policy()
    other = scaling_of_bounds((np.full(4, -3.0), np.full(4, 5.0)), (np.full(2, -0.2), np.full(2, 0.2)))
    observation = np.array([0.6, 0.1, 0.7, -0.1])
    action = policy_source(policy, other)(other.normalize_observation(observation))
    np.testing.assert_allclose(other.denormalize_action(action), policy.act(observation), atol=1e-7)
