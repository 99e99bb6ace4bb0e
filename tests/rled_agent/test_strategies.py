"""The actor with noise, random first actions, episodes that the expert drives or begins, and the gate."""

import json
import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from rled_agent.exploration.agent import Agent, Expert, Noise, RandomStart
from rled_agent.exploration.jump_start import JumpStart
from rled_agent.exploration.policy_reuse import PolicyReuse
from rled_agent.exploration.proposals import Proposals
from rled_agent.exploration.strategy import Choice, network_function, policy_function
from rled_agent.exploration.uncertainty_gate import UncertaintyGate
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.scaling import scaling_of_bounds
from rled_agent.uncertainty.uncertainty import Estimate
from rled_msgs_py.records import Actor, GateCode

STATE = np.zeros(4, dtype=np.float32)
AGENT, EXPERT = (np.array(action, dtype=np.float32) for action in ([0.5, -0.5], [0.25, 0.75]))
SILENT = Noise(0.0, np.random.default_rng(0))


def estimate(observation) -> Estimate:
    return Estimate(AGENT, {"qcd": 0.7})


def reuse(phi: float, seed: int = 0, noise: Noise = SILENT, uncertainty=None) -> PolicyReuse:
    acting = Agent(lambda _: AGENT, noise, uncertainty)
    return PolicyReuse(acting, lambda _: EXPERT, phi, np.random.default_rng(seed), uncertainty)


@pytest.mark.parametrize("phi", [0.1, 0.3])
def test_the_share_of_expert_episodes_is_phi(phi):
    strategy, drawn = reuse(phi), []
    for _ in range(5000):
        strategy.begin()
        drawn.append(strategy.act(STATE).actor is Actor.EXPERT)
    assert abs(np.mean(drawn) - phi) < 4 * np.sqrt(phi * (1 - phi) / 5000)
    after_expert = np.array(drawn[1:])[np.array(drawn[:-1])]
    assert abs(np.mean(after_expert) - phi) < 4 * np.sqrt(phi * (1 - phi) / len(after_expert))


def test_one_actor_drives_a_whole_episode():
    strategy, episodes = reuse(0.5), []
    for _ in range(50):
        strategy.begin()
        choices = [strategy.act(STATE) for _ in range(20)]
        episodes.append({(choice.actor, choice.code) for choice in choices})
        expected = EXPERT if strategy.expert_episode else AGENT
        assert all(np.array_equal(choice.action, expected) for choice in choices)
    assert sorted(map(len, episodes)) == [1] * 50
    assert set.union(*episodes) == {(Actor.EXPERT, GateCode.DRAWN), (Actor.AGENT, GateCode.UNGATED)}


def test_an_episode_costs_one_draw():
    strategy, same = reuse(0.5, seed=3), np.random.default_rng(3)
    for _ in range(10):
        strategy.begin()
        assert strategy.expert_episode == (same.random() < 0.5)
        for _ in range(5):
            strategy.act(STATE)
    assert strategy.generator.bit_generator.state == same.bit_generator.state


@pytest.mark.parametrize(("phi", "actor"), [(0.0, Actor.AGENT), (1.0, Actor.EXPERT)])
def test_at_either_end_of_phi_always_the_same_one_acts(phi, actor):
    strategy = reuse(phi)
    for _ in range(100):
        strategy.begin()
        assert strategy.act(STATE).actor is actor


def test_the_expert_acts_without_noise():
    strategy = reuse(1.0, noise=Noise(0.5, np.random.default_rng(0)))
    strategy.begin()
    np.testing.assert_array_equal(strategy.act(STATE).action, EXPERT)
    np.testing.assert_array_equal(Expert(lambda _: EXPERT).act(STATE).action, EXPERT)


@pytest.mark.parametrize("phi", [0.0, 1.0])
def test_the_uncertainty_is_recorded_where_it_is_estimated_and_compared_with_nothing(phi):
    strategy = reuse(phi, uncertainty=estimate)
    strategy.begin()
    choice = strategy.act(STATE)
    assert (choice.uncertainty, choice.measure) == ({"qcd": 0.7}, "none")
    assert np.isnan(choice.compared)
    assert reuse(phi).act(STATE).uncertainty == {}


def test_what_compares_a_measure_says_its_value():
    assert Choice(AGENT, Actor.AGENT, GateCode.SURE, {"qcd": 0.7, "iqr": 0.1}, "iqr").compared == 0.1


def test_an_episode_of_the_expert_goes_on_from_its_state():
    strategy, again = reuse(1.0), reuse(0.0)
    strategy.begin()
    again.load_state_dict(json.loads(json.dumps(strategy.state_dict())))
    assert again.act(STATE).actor is Actor.EXPERT


def test_noise_has_its_deviation_and_is_clipped():
    noise = Noise(0.2, np.random.default_rng(0))
    actions = np.array([noise.added_to(np.array([0.0, 0.9], dtype=np.float32)) for _ in range(4000)])
    assert actions.dtype == np.float32
    assert actions[:, 0].std() == pytest.approx(0.2, rel=0.05)
    assert abs(actions[:, 0].mean()) < 0.015
    assert actions.max() == 1.0
    assert (actions[:, 1] == 1.0).mean() == pytest.approx(0.309, abs=0.03)  # P(N(0, 1) > 0.5)


def random_start(steps: int, seed: int = 6) -> RandomStart:
    return RandomStart(reuse(0.0), steps, 2, np.random.default_rng(seed))


def test_the_first_actions_are_random_across_episodes_and_then_the_strategy_acts():
    strategy, same = random_start(5), np.random.default_rng(6)
    for step in range(5):
        if step in (0, 3):
            strategy.begin()
        choice = strategy.act(STATE)
        np.testing.assert_array_equal(choice.action, same.uniform(-1.0, 1.0, 2).astype(np.float32))
        assert (choice.action.dtype, choice.actor, choice.code) == (np.float32, Actor.AGENT, GateCode.UNGATED)
    for _ in range(3):
        np.testing.assert_array_equal(strategy.act(STATE).action, AGENT)
    assert strategy.generator.bit_generator.state == same.bit_generator.state


def test_random_first_actions_go_on_where_they_were():
    one, other = random_start(5), random_start(5, seed=9)
    for _ in range(3):
        one.act(STATE)
    other.load_state_dict(json.loads(json.dumps(one.state_dict())))
    drawn = [not np.array_equal(other.act(STATE).action, AGENT) for _ in range(4)]
    assert drawn == [True, True, False, False]


def test_what_stands_behind_random_first_actions_hears_of_episodes_and_keeps_its_state():
    strategy = RandomStart(reuse(1.0), 1, 2, np.random.default_rng(0))
    strategy.begin()
    strategy.act(STATE)
    assert strategy.act(STATE).actor is Actor.EXPERT
    again = random_start(1)
    again.load_state_dict(strategy.state_dict())
    assert again.act(STATE).actor is Actor.EXPERT


def test_an_actor_acts_without_dropout_and_its_action_outlives_the_next():
    actor = Perceptron(4, 2, Architecture(hidden=(16,), dropout=0.5), torch.Generator().manual_seed(0), squash=True)
    act = network_function(actor)
    first = act(STATE)
    before = first.copy()
    np.testing.assert_array_equal(act(STATE), before)
    act(STATE + 1)
    np.testing.assert_array_equal(first, before)


def test_a_policy_in_other_units_acts_alike(make_policy):
    policy = make_policy()
    other = scaling_of_bounds((np.full(4, -3.0), np.full(4, 5.0)), (np.full(2, -0.2), np.full(2, 0.2)))
    observation = np.array([0.6, 0.1, 0.7, -0.1])
    action = policy_function(policy, other)(other.normalize_observation(observation))
    np.testing.assert_allclose(other.denormalize_action(action), policy.act(observation), atol=1e-7)


# Expert and actor share an episode: a guide that begins it, proposals that critics choose from.


def jump_start() -> JumpStart:
    return JumpStart(lambda _: AGENT, lambda _: EXPERT, SILENT, guide_steps=4, stages=2, tolerance=0.1)


def episodes(strategy: JumpStart, returns: list[float]) -> list[str]:
    """Who acted in five steps of each: e of the expert, a of the agent."""
    acted = []
    for each in returns:
        strategy.begin()
        acted.append("".join(strategy.act(STATE).actor.value[0] for _ in range(5)))
        strategy.end(each)
    return acted


def test_the_guide_begins_each_episode_and_is_shorter_in_each_stage():
    strategy = jump_start()
    assert episodes(strategy, [100.0] * 6) == ["eeeea"] * 5 + ["eeaaa"]
    # the last five of 100, 75, 75, 75, 75, 150 have 80 on average, too little beside 100, and then 90, which will do
    assert episodes(strategy, [75.0] * 4 + [150.0]) == ["eeaaa"] * 5
    assert episodes(strategy, [0.0] * 12) == ["aaaaa"] * 12


def test_what_lacks_is_a_share_of_negative_returns_too():
    strategy = jump_start()
    assert episodes(strategy, [-100.0] * 5 + [-112.0] * 6) == ["eeeea"] * 5 + ["eeaaa"] * 6
    # with one of −105 the last five have −110.6 on average, with two of them −109.2
    assert episodes(strategy, [-105.0] * 3) == ["eeaaa"] * 2 + ["aaaaa"]


def test_a_jump_start_goes_on_from_its_state():
    one, other = jump_start(), jump_start()
    assert json.loads(json.dumps(one.state_dict())) == one.state_dict()
    for results in ([], [100.0] * 7 + [90.0] * 2):
        episodes(one, results)
        one.begin()
        one.act(STATE)
        other.begin()
        other.load_state_dict(json.loads(json.dumps(one.state_dict())))
        assert [one.act(STATE).actor for _ in range(6)] == [other.act(STATE).actor for _ in range(6)]
        one.end(90.0)
        other.end(90.0)
        assert episodes(one, [90.0] * 9) == episodes(other, [90.0] * 9)


def test_the_critics_choose_between_two_proposals():
    wants = Proposals(lambda _: AGENT, lambda _: EXPERT, SILENT, lambda observation, action: float(action[1]))
    assert wants.act(STATE).actor is Actor.EXPERT
    assert np.array_equal(wants.act(STATE).action, EXPERT)
    shuns = Proposals(lambda _: AGENT, lambda _: EXPERT, SILENT, lambda observation, action: -float(action[1]))
    assert np.array_equal(shuns.act(STATE).action, AGENT)
    assert shuns.act(STATE).actor is Actor.AGENT


def test_noise_is_on_the_actors_proposal_when_the_critics_see_it():
    seen = []
    noisy = Proposals(
        lambda _: AGENT,
        lambda _: EXPERT,
        Noise(0.3, np.random.default_rng(5)),
        lambda observation, action: seen.append(action) or float(np.array_equal(action, EXPERT)) - 1.0,
    )
    assert noisy.act(STATE).actor is Actor.EXPERT
    same = np.random.default_rng(5).normal(0.0, 0.3, 2)
    assert any(np.allclose(each, np.clip(AGENT + same, -1.0, 1.0)) for each in seen)


# The gate: decisions worked out by hand.


class Told:
    """Says the uncertainties that it is told to say, one after the other."""

    def __init__(self, *values: float, **measures: float) -> None:
        self.left, self.measures = list(values), measures

    def __call__(self, observation: np.ndarray) -> Estimate:
        return Estimate(AGENT, self.measures or {"qcd": self.left.pop(0)})


def gate(told: Told, measure: str = "qcd", noise: Noise = SILENT, **settings: float) -> UncertaintyGate:
    return UncertaintyGate(told, lambda _: EXPERT, noise, measure, **{"threshold": 0.5} | settings)


def choices(*uncertainties: float, **settings: float) -> list[Choice]:
    one = gate(Told(*uncertainties), **settings)
    return [one.act(STATE) for _ in uncertainties]


def actors(*uncertainties: float, **settings: float) -> str:
    """a where the agent acts, e where the expert does."""
    return "".join(choice.actor.value[0] for choice in choices(*uncertainties, **settings))


def test_the_expert_acts_from_the_threshold_on():
    assert actors(np.nextafter(0.5, 0), 0.5, math.inf, 0.0) == "aeea"
    assert actors(0.0, threshold=0.0) == "e"


def test_an_uncertainty_that_is_no_number_is_unsure():
    assert actors(math.nan, 0.1, math.nan) == "eae"


def test_the_mean_or_the_experts_action_is_given_with_its_reason():
    sure, unsure = choices(0.25, 0.75)
    np.testing.assert_array_equal(sure.action, AGENT)
    assert sure[1:] == (Actor.AGENT, GateCode.SURE, {"qcd": 0.25}, "qcd", 0.5, "")
    np.testing.assert_array_equal(unsure.action, EXPERT)
    assert unsure[1:] == (Actor.EXPERT, GateCode.UNSURE, {"qcd": 0.75}, "qcd", 0.5, "")


@pytest.mark.parametrize(("measure", "actor"), [("qcd", Actor.EXPERT), ("iqr", Actor.AGENT)])
def test_the_chosen_measure_is_compared_and_both_are_reported(measure, actor):
    choice = gate(Told(qcd=0.9, iqr=0.1), measure).act(STATE)
    assert choice.actor is actor
    assert choice.uncertainty == {"qcd": 0.9, "iqr": 0.1}
    assert choice.compared == choice.uncertainty[measure]


def test_it_explores_around_the_mean():
    same = np.random.default_rng(4).normal(0.0, 0.1, 2)
    choice = gate(Told(0.1), noise=Noise(0.1, np.random.default_rng(4))).act(STATE)
    np.testing.assert_allclose(choice.action, AGENT + same, rtol=1e-6)


def test_hysteresis_asks_for_more_certainty_before_the_agent_returns():
    assert actors(0.4, 0.5, 0.4, 0.25, 0.24, 0.4, hysteresis=0.5) == "aeeeaa"
    thresholds = [choice.threshold for choice in choices(0.4, 0.5, 0.4, 0.24, 0.4, hysteresis=0.5)]
    assert thresholds == [0.5, 0.5, 0.25, 0.25, 0.5]


def test_the_expert_dwells():
    assert actors(0.6, 0.1, 0.1, 0.1, 0.1, dwell=3) == "eeeaa"
    notes = [choice.note for choice in choices(0.6, 0.1, 0.1, 0.1, dwell=3)]
    assert notes == ["", "for 1 of 3 steps", "for 2 of 3 steps", ""]
    assert actors(0.6, 0.1, 0.6, 0.1, 0.1, dwell=3) == "eeeaa"  # counted since the expert began


@given(st.lists(st.floats(0.0, 1.0), max_size=30))
def test_with_neither_it_is_the_equation(uncertainties):
    assert actors(*uncertainties) == "".join("a" if u < 0.5 else "e" for u in uncertainties)


def test_it_goes_on_from_its_state():
    settings = {"hysteresis": 0.5, "dwell": 3}
    one, other = gate(Told(0.6, 0.1), **settings), gate(Told(0.1, 0.4, 0.1), **settings)
    for _ in range(2):
        one.act(STATE)
    other.load_state_dict(json.loads(json.dumps(one.state_dict())))
    assert [other.act(STATE).actor for _ in range(3)] == [Actor.EXPERT, Actor.EXPERT, Actor.AGENT]
