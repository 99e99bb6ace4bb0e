"""Estimates of how sure a policy is, worked out pass by pass and member by member, and measures of their spread."""

import math

import numpy as np
import pytest
import torch
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.policy import GateSettings
from rled_agent.uncertainty.measures import iqr, qcd, quartiles
from rled_agent.uncertainty.uncertainty import ActorEnsemble, CriticEnsemble, MonteCarloDropout, make_uncertainty
from rled_msgs_py.errors import ContractError


@pytest.fixture
def actor() -> Perceptron:
    settings = Architecture(hidden=(16, 12), dropout=0.3)
    return Perceptron(4, 2, settings, Draws([0]), squash=True)


def passes_one_by_one(actor: Perceptron, observation: np.ndarray, passes: int, seed: int) -> np.ndarray:
    """Each pass by itself, with the units dropped that the generator says, in plain numpy."""
    factors = Draws([seed]).kept(0.3, passes * 28)[0].numpy()
    masks = [factors[: passes * 16].reshape(passes, 16), factors[passes * 16 :].reshape(passes, 12)]
    weights = {name: each[0].numpy().astype(np.float64) for name, each in actor.state_dict().items()}
    actions = []
    for k in range(passes):
        h = observation.astype(np.float64)
        for layer in range(3):
            h = h @ weights[f"weights.{layer}"] + weights[f"biases.{layer}"][0]
            if layer < 2:
                h = np.maximum(h, 0.0) * masks[layer][k]
        actions.append(np.tanh(h))
    return np.array(actions)


@pytest.mark.parametrize("passes", [2, 30])
def test_estimate_equals_a_loop_over_the_passes(actor, passes):
    observation = np.random.default_rng(1).normal(size=4).astype(np.float32)
    actions = passes_one_by_one(actor, observation, passes, seed=9)
    first, third = np.percentile(actions, [25, 75], axis=0)
    estimate = MonteCarloDropout(actor, passes, Draws([9]))(torch.from_numpy(observation)[None])
    np.testing.assert_allclose(estimate.mean, actions.mean(axis=0)[None], atol=1e-6)
    expected = np.mean([abs((b - a) / (b + a)) for a, b in zip(first, third, strict=True)])
    assert estimate.uncertainty["qcd"].tolist() == pytest.approx([expected], rel=1e-4)
    assert estimate.uncertainty["iqr"].tolist() == pytest.approx([np.mean(third - first) / 2], rel=1e-4)


def test_every_call_drops_other_units(actor):
    estimate, observation = MonteCarloDropout(actor, 30, Draws([0])), torch.ones(1, 4)
    assert estimate(observation).uncertainty != estimate(observation).uncertainty


def test_the_mean_outlives_the_next_pass(actor):
    estimate, observation = MonteCarloDropout(actor, 30, Draws([0])), torch.ones(1, 4)
    mean = estimate(observation).mean
    before = mean.clone()
    estimate(-observation)
    assert torch.equal(mean, before)


def test_an_actor_without_dropout_is_sure():
    actor = Perceptron(4, 2, Architecture(hidden=(8,)), Draws([0]), squash=True)
    estimate = MonteCarloDropout(actor, 30, Draws([0]))(torch.ones(1, 4))
    assert estimate.uncertainty == {"qcd": 0.0, "iqr": 0.0}


def linear(outputs: int, *members: tuple[list[list[float]], list[float]], squash: bool) -> Perceptron:
    """Members without hidden layers, each of its weights (inputs, outputs) and biases."""
    inputs = len(members[0][0])
    network = Perceptron(inputs, outputs, Architecture(hidden=()), Draws([0]), ensemble=len(members), squash=squash)
    state = network.state_dict()
    for k, (weights, biases) in enumerate(members):
        state["weights.0"][k] = torch.tensor(weights)
        state["biases.0"][k, 0] = torch.tensor(biases)
    return network


def test_an_ensemble_of_actors_acts_by_its_mean_and_is_as_unsure_as_they_lie_apart():
    still = [[0.0], [0.0]]
    actions = [0.1, 0.2, 0.4, 0.5, 0.8]
    actor = linear(1, *((still, [float(np.arctanh(action))]) for action in actions), squash=True)
    estimate = ActorEnsemble(actor)(torch.tensor([[3.0, -1.0]]))
    assert estimate.mean.tolist() == [pytest.approx([0.4])]
    # the quartiles of five are the second and the fourth
    assert float(estimate.uncertainty["qcd"]) == pytest.approx((0.5 - 0.2) / (0.5 + 0.2), rel=1e-5)
    assert float(estimate.uncertainty["iqr"]) == pytest.approx((0.5 - 0.2) / 2, rel=1e-5)


def test_members_see_the_observation():
    actor = linear(1, ([[1.0], [0.0]], [0.0]), ([[0.0], [1.0]], [0.0]), squash=True)
    agree, apart = (ActorEnsemble(actor)(torch.tensor([each])) for each in ([0.5, 0.5], [0.5, -0.5]))
    assert agree.uncertainty == {"qcd": 0.0, "iqr": 0.0}
    # of two actions, half their distance, over the action range of 2
    assert float(apart.uncertainty["iqr"]) == pytest.approx(np.tanh(0.5) / 2, rel=1e-5)


def test_critics_are_as_unsure_as_their_values_of_the_actors_action_lie_apart():
    actor = linear(1, ([[0.0]], [float(np.arctanh(0.5))]), squash=True)
    critic = linear(1, ([[1.0], [2.0]], [0.0]), ([[0.0], [0.0]], [1.0]), ([[0.0], [4.0]], [5.0]), squash=False)
    estimate = CriticEnsemble(actor, critic)(torch.tensor([[3.0]]))
    assert estimate.mean.tolist() == [pytest.approx([0.5])]
    # 3 + 2/2 = 4, 1 and 4/2 + 5 = 7: 3, 0 and 3 from their mean
    assert estimate.uncertainty == {"std": pytest.approx(6**0.5)}


def test_a_gate_gets_the_estimate_that_it_names(actor):
    pair = linear(1, ([[1.0]], [0.0]), ([[0.0]], [1.0]), squash=True)
    critics = linear(1, ([[1.0], [0.0]], [0.0]), ([[0.0], [0.0]], [1.0]), squash=False)
    draws = Draws([0])
    assert isinstance(make_uncertainty(GateSettings(), actor, None, draws), MonteCarloDropout)
    assert isinstance(make_uncertainty(GateSettings(estimator="actors"), pair, None, draws), ActorEnsemble)
    by_critics = GateSettings("std", estimator="critics")
    assert isinstance(make_uncertainty(by_critics, actor, critics, draws), CriticEnsemble)
    sure = Perceptron(4, 2, Architecture(hidden=(8,)), Draws([0]), squash=True)
    for gate, network, critic, said in (
        (GateSettings(), sure, None, "the actor drops no units; accepted: dropout above 0"),
        (GateSettings("std"), actor, None, "measure is 'std' of dropout; accepted: qcd, iqr"),
        (GateSettings(estimator="actors"), actor, None, "actors that could disagree are missing; accepted: 2 or more"),
        (by_critics, actor, None, "critics that could disagree are missing; accepted: 2 or more"),
        (by_critics, actor, critics.first(), "critics that could disagree are missing; accepted: 2 or more"),
        (GateSettings("qcd", estimator="critics"), actor, critics, "measure is 'qcd' of critics; accepted: std"),
    ):
        with pytest.raises(ContractError) as caught:
            make_uncertainty(gate, network, critic, draws)
        assert said in str(caught.value)


def test_quartiles_of_five_values_are_the_second_and_the_fourth():
    low, high, _ = quartiles(torch.tensor([[[5.0, -1.0], [1.0, -2.0], [4.0, -3.0], [2.0, -4.0], [3.0, -5.0]]]))
    assert low.tolist() == [[2.0, -4.0]]
    assert high.tolist() == [[4.0, -2.0]]


def test_quartiles_between_values_are_interpolated():
    low, high, _ = quartiles(torch.tensor([[[1.0], [2.0], [3.0], [10.0]]]))
    assert (float(low), float(high)) == (1.75, 4.75)  # places 0.75 and 2.25


@pytest.mark.parametrize("passes", [2, 3, 4, 7, 30, 101])
def test_quartiles_equal_numpys(passes):
    actions = np.random.default_rng(passes).normal(size=(3, passes, 7))
    low, high, mean = quartiles(torch.from_numpy(actions))
    np.testing.assert_allclose([low, high], np.percentile(actions, [25, 75], axis=1), rtol=1e-12)
    np.testing.assert_allclose(mean, actions.mean(axis=1), rtol=1e-12, atol=1e-15)


def rows(*quartile: list[float]) -> torch.Tensor:
    """A quartile of the actions of each seed."""
    return torch.tensor(quartile, dtype=torch.float64)


def test_qcd_is_the_mean_over_the_components():
    # |4 - 2| / |4 + 2| = 1/3 and |-2 + 4| / |-2 - 4| = 1/3; |1 - 0| / |1 + 0| = 1
    assert qcd(rows([2.0, -4.0], [0.0, 0.0]), rows([4.0, -2.0], [1.0, 1.0])).tolist() == pytest.approx([1 / 3, 1.0])
    assert float(qcd(rows([2.0, -4.0, 0.0]), rows([4.0, -2.0, 1.0]))) == pytest.approx(5 / 9)


def test_qcd_of_two_quartiles_at_zero_is_no_dispersion():
    assert float(qcd(rows([0.0, 0.0]), rows([0.0, 0.0]))) == 0.0
    assert float(qcd(rows([0.0, 2.0]), rows([0.0, 4.0]))) == pytest.approx(1 / 6)


def test_qcd_has_no_bound_around_zero():
    assert float(qcd(rows([-1.0]), rows([1.0]))) == math.inf
    assert float(qcd(rows([-0.99]), rows([1.0]))) == pytest.approx(199.0)


def test_iqr_is_a_share_of_the_action_range():
    assert float(iqr(rows([-1.0, -1.0]), rows([1.0, 1.0]))) == 1.0
    assert float(iqr(rows([0.1, 0.3]), rows([0.2, 0.6]))) == pytest.approx((0.1 + 0.3) / 2 / 2)
    assert float(iqr(rows([0.3]), rows([0.3]))) == 0.0


@pytest.mark.parametrize("population", [2, 5])
@pytest.mark.parametrize("gate", [GateSettings(), GateSettings(passes=7), GateSettings("std", estimator="critics"),
                                  GateSettings(estimator="actors")], ids=str)  # fmt: skip
def test_a_seed_is_as_unsure_as_it_is_alone_bit_for_bit(gate, population):
    def estimates(seeds: list[int], observations: torch.Tensor) -> list[torch.Tensor]:
        draws = Draws(seeds)
        dropping = Architecture(hidden=(33, 17), dropout=0.1)
        ensemble = 3 if gate.estimator == "actors" else 1
        actor = Perceptron(4, 7, dropping, draws, ensemble=ensemble, squash=True)
        critic = Perceptron(11, 1, Architecture(hidden=(33, 17)), draws, ensemble=2)
        uncertainty = make_uncertainty(gate, actor, critic, draws)
        found = [uncertainty(each) for each in observations]
        return [torch.stack([one.mean for one in found]), *(
            torch.stack([one.uncertainty[name] for one in found]) for name in found[0].uncertainty
        )]  # fmt: skip

    observations = torch.randn(5, population, 4, generator=torch.Generator().manual_seed(0))
    together = estimates(list(range(population)), observations)
    assert together[1].shape == (5, population)
    for seed in range(population):
        for whole, own in zip(together, estimates([seed], observations[:, seed : seed + 1]), strict=True):
            assert torch.equal(whole[:, seed : seed + 1], own)
