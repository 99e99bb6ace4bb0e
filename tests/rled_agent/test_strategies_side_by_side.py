"""Strategies of several seeds that are in different states at once: each seed does what it would do alone."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import pytest
import torch
from rled_agent.exploration.agent import Agent, Noise, RandomStart
from rled_agent.exploration.jump_start import JumpStart
from rled_agent.exploration.policy_reuse import PolicyReuse
from rled_agent.exploration.proposals import Proposals
from rled_agent.exploration.strategy import Strategy, network_function, policy_function
from rled_agent.exploration.uncertainty_gate import UncertaintyGate
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.training.checkpoint import Checkpoint
from rled_agent.training.learning_state import pack, part_of, seed_of, together
from rled_agent.uncertainty.measures import quartiles
from rled_agent.uncertainty.uncertainty import CriticEnsemble, Estimate, MonteCarloDropout, Uncertainty
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import GateCode
from torch import Tensor

from .strategies import AGENT, EXPERT, always, noise

SEEDS, STEPS = (7, 3, 11), 120
LENGTHS = torch.tensor([4, 7, 9])
"""Steps of an episode of each seed."""
AGENTS = AGENT.expand(3, 2)


class Numbers(NamedTuple):
    """That may differ between seeds: of each one."""

    std: Sequence[float] = (0.1, 0.0, 0.5)
    phi: Sequence[float] = (0.5, 0.3, 0.7)
    threshold: Sequence[float] = (0.023, 0.03, 0.039)
    tolerance: Sequence[float] = (0.0, 0.3, 1.0)


SWEPT, SAME = Numbers(), Numbers((0.1,) * 3, (0.5,) * 3, (0.03,) * 3, (0.25,) * 3)


class Made:
    """Networks of some of the seeds, and the numbers of their strategies."""

    def __init__(self, chosen: Sequence[int], numbers: Numbers) -> None:
        seeds = [SEEDS[k] for k in chosen]
        self.draws, weights = Draws(seeds), Draws(seeds, stream=9)
        shape = Architecture(hidden=(12, 8), dropout=0.1)
        self.actor = Perceptron(10, 7, shape, weights, squash=True)
        self.expert = network_function(Perceptron(10, 7, Architecture(hidden=(6,)), weights, squash=True))
        self.critic = Perceptron(17, 1, Architecture(hidden=(10,)), weights, ensemble=2)
        self.policy, self.numbers, self.chosen = network_function(self.actor), numbers, chosen
        self.noise = Noise(self.number("std"), self.draws)

    def number(self, name: str) -> float | Tensor:
        """As the methods give it: one number where it is one."""
        values = [getattr(self.numbers, name)[k] for k in self.chosen]
        return values[0] if len({*values}) == 1 else torch.tensor(values, dtype=torch.float64)

    def value(self, observation: Tensor, action: Tensor) -> Tensor:
        with torch.no_grad():
            values = self.critic(torch.cat((observation, action), dim=2))
        return values.view(len(self.chosen), 2, *values.shape[1:]).amin(dim=1)

    @property
    def dropped(self) -> Uncertainty:
        return MonteCarloDropout(self.actor, 10, self.draws)

    def gate(self, uncertainty: Uncertainty, measure: str, **settings: float) -> UncertaintyGate:
        threshold = self.number("threshold")
        return UncertaintyGate(uncertainty, self.expert, self.noise, measure, threshold, **settings)

    def reuse(self, strategy: Strategy) -> PolicyReuse:
        return PolicyReuse(strategy, self.expert, self.number("phi"), self.draws)


STRATEGIES: dict[str, Callable[[Made], Strategy]] = {
    "agent": lambda made: Agent(made.policy, made.noise),
    "random start": lambda made: RandomStart(made.reuse(Agent(made.policy, made.noise)), 20, 7, made.draws),
    "reuse": lambda made: made.reuse(Agent(made.policy, made.noise, made.dropped)),
    "jump start": lambda made: JumpStart(made.policy, made.expert, made.noise, 6, 3, made.number("tolerance")),
    "proposals": lambda made: Proposals(made.policy, made.expert, made.noise, made.value),
    "gate": lambda made: made.gate(made.dropped, "iqr"),
    "gate that holds": lambda made: made.gate(made.dropped, "iqr", hysteresis=0.25, dwell=3),
    "gate of critics": lambda made: made.gate(CriticEnsemble(made.actor, made.critic), "std", dwell=2),
    "gate in reuse": lambda made: made.reuse(made.gate(made.dropped, "iqr", hysteresis=0.25, dwell=3)),
}
ALWAYS_THE_AGENT = {"agent"}


@pytest.mark.parametrize(("passes", "joints"), [(30, 7), (100, 3), (17, 1), (10, 2)])
def test_a_seeds_quartiles_do_not_depend_on_how_many_lie_beside_it(passes, joints):
    actions = Draws(range(20)).normal(passes, joints)
    whole = quartiles(actions)
    for k in range(20):
        for one, alone in zip(whole, quartiles(actions[k : k + 1]), strict=True):
            assert torch.equal(one[k], alone[0])


@pytest.mark.parametrize("ensemble", [2, 3, 10])
def test_how_far_a_seeds_critics_disagree_does_not_depend_on_the_others(ensemble):
    def of(seeds: Sequence[int]) -> Tensor:
        weights, shape = Draws(seeds), Architecture(hidden=(6,))
        critics = CriticEnsemble(
            Perceptron(4, 2, shape, weights, squash=True), Perceptron(6, 1, shape, weights, ensemble=ensemble)
        )
        return critics(Draws(seeds, stream=1).normal(4)).uncertainty["std"]

    assert of(range(20)).tolist() == [of([seed]).item() for seed in range(20)]


@pytest.mark.parametrize("hidden", [(6,), (12, 8), (48, 48), (128, 128)])
@pytest.mark.parametrize("rows", [1, 2, 20, 30])
def test_an_action_and_a_gradient_do_not_depend_on_where_a_seed_lies_in_memory(hidden, rows):
    """Of the sizes of the Panda: the slabs of odd seeds begin within a vector."""

    def of(seeds: Sequence[int]) -> list[Tensor]:
        shape, draws = Architecture(hidden=hidden, dropout=0.1), Draws(seeds, stream=1)
        network = Perceptron(10, 7, shape, Draws(seeds), squash=True)
        action = network(Draws(seeds, stream=2).normal(rows, 10), draws)
        return [action, *torch.autograd.grad(action.square().sum(), [*network.parameters()])]

    whole = of(range(5))
    for seed in range(5):
        for one, alone in zip(whole, of([seed]), strict=True):
            assert torch.equal(one[seed], alone[0])


def episodes(step: int) -> tuple[Tensor, Tensor]:
    """Where episodes begin with a step, and where they end."""
    return step % LENGTHS == 0, step % LENGTHS == LENGTHS - 1


def run(made: Made, strategy: Strategy, steps: range = range(STEPS)) -> list[tuple[Tensor, ...]]:
    """What was chosen in each step, in (P, ...); each seed has observations, episodes and returns of its own."""
    chosen, told, rows = list(made.chosen), Draws(SEEDS, stream=5), []
    observations, returns = told.normal(STEPS, 10)[chosen], told.normal(STEPS)[chosen]
    for step in steps:
        begins, ends = (each[chosen] for each in episodes(step))
        strategy.begin(begins)
        choice = strategy.act(observations[:, step])
        strategy.end(ends, returns[:, step])
        told_of = [torch.as_tensor(each).float().expand(len(chosen)) for each in (choice.threshold, choice.held)]
        rows.append((choice.action, choice.by_expert, choice.code, *choice.uncertainty.values(), *told_of))
    return rows


def same(whole: Sequence[Tensor], alone: Sequence[Tensor], seed: int) -> bool:
    """Whether a seed's part is the same, to the bit; NaN is NaN."""
    pairs = [(one[seed], other[0]) for one, other in zip(whole, alone, strict=True)]
    return all(torch.allclose(one, other, rtol=0.0, atol=0.0, equal_nan=True) for one, other in pairs)


@pytest.mark.parametrize("numbers", [SAME, SWEPT], ids=["one number", "swept"])
@pytest.mark.parametrize("name", STRATEGIES)
def test_each_seed_does_what_it_does_alone(name, numbers):
    made = Made((0, 1, 2), numbers)
    strategy = STRATEGIES[name](made)
    whole = run(made, strategy)
    by_expert = torch.stack([row[1] for row in whole])  # (T, P)
    differ = by_expert.any(dim=1) & ~by_expert.all(dim=1)
    assert differ.sum() > 10 or name in ALWAYS_THE_AGENT
    for k in range(3):
        part = Made((k,), numbers)
        one = STRATEGIES[name](part)
        alone = run(part, one)
        assert all(same(row, other, k) for row, other in zip(whole, alone, strict=True))
        assert same([*strategy.state_dict().values()], [*one.state_dict().values()], k)
        assert made.draws.taken == part.draws.taken


@pytest.mark.parametrize("name", STRATEGIES)
def test_seeds_go_on_apart_and_together_again(name):
    made, parts = Made((0, 1, 2), SWEPT), [Made((k,), SWEPT) for k in range(3)]
    thirds = [range(41), range(41, 80), range(80, STEPS)]

    def of(part: Made, checkpoint: Checkpoint) -> Strategy:
        strategy = STRATEGIES[name](part)
        strategy.load_state_dict(part_of(checkpoint, "strategy", may_lack=True))
        return strategy

    unbroken, strategy = Made((0, 1, 2), SWEPT), STRATEGIES[name](made)
    expected = run(unbroken, STRATEGIES[name](unbroken))[80:]
    run(made, strategy, thirds[0])
    kept = pack(strategy={each: value.clone() for each, value in strategy.state_dict().items()})
    apart = [of(part, seed_of(kept, k, 3)) for k, part in enumerate(parts)]
    for part, each in zip(parts, apart, strict=True):
        part.draws.taken = made.draws.taken
        run(part, each, thirds[1])
    again = Made((0, 1, 2), SWEPT)
    again.draws.taken = parts[0].draws.taken
    found = run(again, of(again, together([pack(strategy=each.state_dict()) for each in apart])), thirds[2])
    for row, other in zip(found, expected, strict=True):
        assert all(torch.equal(one.nan_to_num(-1.0), two.nan_to_num(-1.0)) for one, two in zip(row, other, strict=True))


def test_stages_lie_apart_by_what_each_has_come_to():
    strategy = JumpStart(always(AGENTS), always(EXPERT), Noise(0.0, Draws(SEEDS)), 4, 2, 0.1)
    everywhere, state, acted = torch.ones(3, dtype=torch.bool), torch.zeros(3, 4), []
    returns = torch.tensor([[100.0] * 11, [100.0, 0.0] * 5 + [100.0], [-10.0] * 5 + [-20.0] * 6]).T
    for each in returns:
        strategy.begin(everywhere)
        acted.append([strategy.act(state).by_expert for _ in range(5)])
        strategy.end(everywhere, each)
    shown = ["".join("ae"[int(who[k])] for who in episode) for k in range(3) for episode in acted]
    assert shown[:11] == ["eeeea"] * 5 + ["eeaaa"] * 5 + ["aaaaa"]
    # means of 60 pass; of the next stage those of 0, 100, 0, 100, 0 are 40 and do not, of the sixth episode on 60 do
    assert shown[11:22] == ["eeeea"] * 5 + ["eeaaa"] * 6
    # −10 pass, −20 are twice as bad
    assert shown[22:] == ["eeeea"] * 5 + ["eeaaa"] * 6
    assert strategy.stage.tolist() == [2, 2, 1]


def test_an_episode_that_goes_on_keeps_its_driver_while_others_begin():
    strategy, drawn = PolicyReuse(Agent(always(AGENTS), noise()), always(EXPERT), 0.5, Draws(SEEDS)), Draws(SEEDS)
    expected = torch.zeros(3, dtype=torch.bool)
    for step in range(60):
        begins = episodes(step)[0]
        strategy.begin(begins)
        expected = torch.where(begins, drawn.uniform() < 0.5, expected)
        choice = strategy.act(torch.zeros(3, 4))
        assert torch.equal(choice.by_expert, expected)
        assert torch.equal(choice.action, torch.where(expected[:, None], EXPERT, AGENT))
        assert torch.equal(choice.code == GateCode.DRAWN, expected)


class Table(Uncertainty):
    """Says the uncertainties of a table, (T, P)."""

    def __init__(self, rows: list[list[float]]) -> None:
        self._rows = iter(torch.tensor(rows, dtype=torch.float64))

    def __call__(self, observation: Tensor) -> Estimate:
        return Estimate(AGENTS, {"qcd": next(self._rows)})


def test_the_gate_stands_in_for_one_and_not_for_another():
    table = [[0.6, 0.1, 0.1], [0.1, 0.6, 0.1], [0.1, 0.1, 0.1], [0.1, 0.6, 0.5], [0.1, 0.3, 0.2], [0.1, 0.2, 0.2]]
    silent = Noise(0.0, Draws(SEEDS))
    one = UncertaintyGate(Table(table), always(EXPERT), silent, "qcd", 0.5, hysteresis=0.5, dwell=2)
    choices = [one.act(torch.zeros(3, 4)) for _ in table]
    assert ["".join("ae"[int(each.by_expert[k])] for each in choices) for k in range(3)] == [
        "eeaaaa",
        "aeeeea",
        "aaaeea",
    ]
    assert [each.held.tolist() for each in choices] == [
        [0, 0, 0],
        [1, 0, 0],
        [0, 1, 0],
        [0, 0, 0],
        [0, 0, 1],
        [0, 0, 0],
    ]
    thresholds = [[0.5, 0.25, 0.25, 0.5, 0.5, 0.5], [0.5, 0.5, 0.25, 0.25, 0.25, 0.25], [0.5] * 4 + [0.25] * 2]
    assert torch.stack([each.threshold for each in choices], dim=1).tolist() == thresholds
    for choice in choices:
        assert torch.equal(choice.action, torch.where(choice.by_expert[:, None], EXPERT, AGENT))
        codes = torch.where(choice.by_expert, int(GateCode.UNSURE), int(GateCode.SURE))
        assert torch.equal(choice.code, codes)


def test_experts_of_other_units_are_each_brought_into_those_of_the_learner(make_policy):
    policies = [make_policy(seed) for seed in range(3)]
    scaling = policies[1].scaling
    rows = Draws(SEEDS).normal(5, 4)
    whole = policy_function(policies, scaling)(rows)
    for k, policy in enumerate(policies):
        assert torch.equal(whole[k], policy_function([policy], scaling)(rows[k : k + 1])[0])
        torch.testing.assert_close(whole[k], policy.network(rows[k])[0].detach(), rtol=0, atol=1e-6)


def test_experts_of_several_shapes_are_refused(make_policy):
    policies = [make_policy(0), make_policy(1, hidden=(8, 7))]
    with pytest.raises(RledError, match="networks of several shapes; accepted: one shape for all seeds"):
        policy_function(policies, policies[0].scaling)
