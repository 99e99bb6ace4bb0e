"""The actor with noise, random first actions, episodes that the expert drives or begins; of one seed."""

import math

import numpy as np
import pytest
import torch
from rled_agent.exploration.agent import Agent, Expert, RandomStart
from rled_agent.exploration.jump_start import JumpStart
from rled_agent.exploration.policy_reuse import PolicyReuse
from rled_agent.exploration.proposals import Proposals
from rled_agent.exploration.strategy import network_function, policy_function
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.scaling import scaling_of_bounds
from rled_agent.uncertainty.uncertainty import Estimate
from rled_msgs_py.records import GateCode
from torch import Tensor

from .strategies import AGENT, EXPERT, NO, STATE, YES, actor, always, carry, noise


def estimate(observation) -> Estimate:
    return Estimate(AGENT, {"qcd": torch.tensor([0.7])})


def reuse(phi: float, seed: int = 0, std: float = 0.0, uncertainty=None) -> PolicyReuse:
    return PolicyReuse(Agent(always(AGENT), noise(std), uncertainty), always(EXPERT), phi, Draws([seed]))


@pytest.mark.parametrize("phi", [0.1, 0.3])
def test_the_share_of_expert_episodes_is_phi(phi):
    strategy, drawn = reuse(phi), []
    for _ in range(5000):
        strategy.begin(YES)
        drawn.append(actor(strategy.act(STATE)) == "e")
    assert abs(np.mean(drawn) - phi) < 4 * np.sqrt(phi * (1 - phi) / 5000)
    after_expert = np.array(drawn[1:])[np.array(drawn[:-1])]
    assert abs(np.mean(after_expert) - phi) < 4 * np.sqrt(phi * (1 - phi) / len(after_expert))


def test_one_actor_drives_a_whole_episode():
    strategy, episodes = reuse(0.5), []
    for _ in range(50):
        choices = []
        for step in range(20):
            strategy.begin(NO if step else YES)
            choices.append(strategy.act(STATE))
        episodes.append({(actor(choice), choice.code.item()) for choice in choices})
        expected = EXPERT if strategy.expert_episode.item() else AGENT
        assert all(torch.equal(choice.action, expected) for choice in choices)
    assert sorted(map(len, episodes)) == [1] * 50
    assert set.union(*episodes) == {("e", GateCode.DRAWN), ("a", GateCode.UNGATED)}


def test_a_step_costs_one_draw_and_the_first_of_an_episode_decides():
    strategy, same = reuse(0.5, seed=3), Draws([3])
    for _ in range(10):
        strategy.begin(YES)
        decided = same.uniform() < 0.5
        for _ in range(4):
            assert torch.equal(strategy.expert_episode, decided)
            strategy.act(STATE)
            strategy.begin(NO)
            same.uniform()
    assert strategy.draws.taken == same.taken == 50


@pytest.mark.parametrize(("phi", "who"), [(0.0, "a"), (1.0, "e")])
def test_at_either_end_of_phi_always_the_same_one_acts(phi, who):
    strategy = reuse(phi)
    for _ in range(100):
        strategy.begin(YES)
        assert actor(strategy.act(STATE)) == who


def test_the_expert_acts_without_noise():
    strategy = reuse(1.0, std=0.5)
    strategy.begin(YES)
    assert torch.equal(strategy.act(STATE).action, EXPERT)
    alone = Expert(always(EXPERT)).act(STATE)
    assert torch.equal(alone.action, EXPERT)
    assert (actor(alone), alone.code.item(), alone.measure) == ("e", GateCode.UNGATED, "none")


@pytest.mark.parametrize("phi", [0.0, 1.0])
def test_the_uncertainty_is_recorded_where_it_is_estimated_and_compared_with_nothing(phi):
    strategy = reuse(phi, uncertainty=estimate)
    strategy.begin(YES)
    choice = strategy.act(STATE)
    assert (choice.uncertainty, choice.measure) == ({"qcd": torch.tensor([0.7])}, "none")
    assert math.isnan(choice.threshold)
    assert reuse(phi).act(STATE).uncertainty == {}


def test_an_episode_of_the_expert_goes_on_from_its_state(tmp_path):
    strategy, again = reuse(1.0), reuse(0.0)
    strategy.begin(YES)
    carry(strategy, again, tmp_path)
    assert actor(again.act(STATE)) == "e"
    again.begin(NO)
    assert actor(again.act(STATE)) == "e"
    again.begin(YES)
    assert actor(again.act(STATE)) == "a"


def test_noise_has_its_deviation_and_is_clipped():
    drawn = noise(0.2)
    actions = torch.cat([drawn.added_to(torch.tensor([[0.0, 0.9]])) for _ in range(4000)]).numpy()
    assert actions.dtype == np.float32
    assert actions[:, 0].std() == pytest.approx(0.2, rel=0.05)
    assert abs(actions[:, 0].mean()) < 0.015
    assert actions.max() == 1.0
    assert (actions[:, 1] == 1.0).mean() == pytest.approx(0.309, abs=0.03)  # P(N(0, 1) > 0.5)


def test_no_noise_leaves_the_action_and_costs_what_noise_does():
    silent, loud = noise(0.0), noise(0.1)
    for _ in range(3):
        assert torch.equal(silent.added_to(AGENT), AGENT)
        loud.added_to(AGENT)
    assert silent.draws.taken == loud.draws.taken > 0


def random_start(steps: int, seed: int = 6, phi: float = 0.0) -> RandomStart:
    return RandomStart(reuse(phi), steps, 2, Draws([seed]))


def test_the_first_actions_are_random_across_episodes_and_then_the_strategy_acts():
    strategy, same = random_start(5), Draws([6])
    for step in range(5):
        strategy.begin(YES if step in (0, 3) else NO)
        choice = strategy.act(STATE)
        assert torch.equal(choice.action, 2.0 * same.uniform(2) - 1.0)
        assert (choice.action.dtype, actor(choice), choice.code.item()) == (torch.float32, "a", GateCode.UNGATED)
    for _ in range(3):
        assert torch.equal(strategy.act(STATE).action, AGENT)
    assert strategy.draws.taken == same.taken


def test_random_first_actions_are_uniform_over_the_action_range():
    strategy = random_start(4000)
    actions = torch.cat([strategy.act(STATE).action for _ in range(4000)]).numpy()
    assert abs(actions).max() < 1.0
    counts = np.histogram(actions, bins=10, range=(-1.0, 1.0))[0]
    assert ((counts - 800) ** 2 / 800).sum() < 27.9  # χ² of 9 degrees, of which one in a thousand is more


def test_random_first_actions_go_on_where_they_were(tmp_path):
    one, other = random_start(5), random_start(5, seed=9)
    for _ in range(3):
        one.act(STATE)
    carry(one, other, tmp_path)
    drawn = [not torch.equal(other.act(STATE).action, AGENT) for _ in range(4)]
    assert drawn == [True, True, False, False]


def test_what_stands_behind_random_first_actions_hears_of_episodes_and_keeps_its_state(tmp_path):
    strategy, again = random_start(1, phi=1.0), random_start(1)
    strategy.begin(YES)
    strategy.act(STATE)
    assert actor(strategy.act(STATE)) == "e"
    carry(strategy, again, tmp_path)
    assert actor(again.act(STATE)) == "e"


def test_an_actor_acts_without_dropout_and_its_action_outlives_the_next():
    act = network_function(Perceptron(4, 2, Architecture(hidden=(16,), dropout=0.5), Draws([0]), squash=True))
    first = act(STATE)
    before = first.clone()
    assert torch.equal(act(STATE), before)
    assert not torch.equal(act(STATE + 1), before)
    assert torch.equal(first, before)


def test_of_an_ensemble_of_actors_the_mean_acts():
    network = Perceptron(4, 2, Architecture(hidden=(5,)), Draws([0]), ensemble=3, squash=True)
    rows = torch.linspace(-1, 1, 24).view(1, 6, 4)
    expected = network(rows).mean(dim=0)
    act = network_function(network)
    torch.testing.assert_close(act(rows)[0], expected, rtol=0, atol=1e-7)
    torch.testing.assert_close(act(rows[:, 2])[0], expected[2], rtol=0, atol=1e-6)


def test_a_policy_in_other_units_acts_alike(make_policy):
    policy = make_policy()
    other = scaling_of_bounds((np.full(4, -3.0), np.full(4, 5.0)), (np.full(2, -0.2), np.full(2, 0.2)))
    observation = np.array([[0.6, 0.1, 0.7, -0.1]])
    act = policy_function([policy], other)
    action = act(torch.from_numpy(other.normalize_observation(observation))).numpy()
    np.testing.assert_allclose(other.denormalize_action(action), policy.act(observation), atol=1e-7)


# Expert and actor share an episode: a guide that begins it, proposals that critics choose from.


def jump_start(std: float = 0.0) -> JumpStart:
    return JumpStart(always(AGENT), always(EXPERT), noise(std), guide_steps=4, stages=2, tolerance=0.1)


def episodes(strategy: JumpStart, returns: list[float]) -> list[str]:
    """Who acted in five steps of each: e of the expert, a of the agent."""
    acted = []
    for each in returns:
        for step in range(5):
            strategy.begin(NO if step else YES)
            choice = strategy.act(STATE)
            assert torch.equal(choice.action, EXPERT if choice.by_expert.item() else AGENT)
            acted += actor(choice)
            strategy.end(YES if step == 4 else NO, torch.tensor([each if step == 4 else 1e9]))
    return ["".join(acted[k : k + 5]) for k in range(0, len(acted), 5)]


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


def test_a_jump_start_goes_on_from_its_state(tmp_path):
    one, other = jump_start(), jump_start()
    for results in ([], [100.0] * 7 + [90.0] * 2):
        episodes(one, results)
        for each in (one, other):
            each.begin(YES)
        one.act(STATE)
        carry(one, other, tmp_path)
        assert [actor(one.act(STATE)) for _ in range(6)] == [actor(other.act(STATE)) for _ in range(6)]
        for each in (one, other):
            each.end(YES, torch.tensor([90.0]))
        assert episodes(one, [90.0] * 9) == episodes(other, [90.0] * 9)


def test_the_guide_acts_without_noise_and_the_actor_with_it():
    strategy, same = jump_start(0.1), Draws([0])
    strategy.begin(YES)
    for expected in [EXPERT] * 4 + [None]:
        noisy = AGENT + 0.1 * same.normal(2)
        assert torch.equal(strategy.act(STATE).action, noisy if expected is None else expected)


def test_the_critics_choose_between_two_proposals():
    wants = Proposals(always(AGENT), always(EXPERT), noise(), lambda observation, action: action[..., 1:])
    assert actor(wants.act(STATE)) == "e"
    assert torch.equal(wants.act(STATE).action, EXPERT)
    shuns = Proposals(always(AGENT), always(EXPERT), noise(), lambda observation, action: -action[..., 1:])
    assert torch.equal(shuns.act(STATE).action, AGENT)
    assert actor(shuns.act(STATE)) == "a"


def test_of_two_proposals_of_one_value_the_agents_is_taken():
    same = Proposals(always(AGENT), always(EXPERT), noise(), lambda observation, action: 0.0 * action[..., 1:])
    assert actor(same.act(STATE)) == "a"


def test_noise_is_on_the_actors_proposal_when_the_critics_see_it():
    seen = []

    def value(observation: Tensor, action: Tensor) -> Tensor:
        assert torch.equal(observation, STATE.expand(1, 2, 4))
        seen.extend(action[0])
        return (action == EXPERT).all(dim=2, keepdim=True).float() - 1.0

    noisy = Proposals(always(AGENT), always(EXPERT), noise(0.3, 5), value)
    assert actor(noisy.act(STATE)) == "e"
    expected = (AGENT + 0.3 * Draws([5]).normal(2)).clamp(-1.0, 1.0)
    assert any(torch.allclose(each, expected[0]) for each in seen)
