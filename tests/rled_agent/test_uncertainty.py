"""Estimates of how sure a policy is, worked out pass by pass and member by member, and measures of their spread."""

import math

import numpy as np
import pytest
import torch
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.dropout import dropout_masks
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.policy import GateSettings
from rled_agent.uncertainty.measures import iqr, qcd, quartiles
from rled_agent.uncertainty.uncertainty import ActorEnsemble, CriticEnsemble, MonteCarloDropout, make_uncertainty
from rled_msgs_py.errors import ContractError


@pytest.fixture
def actor() -> Perceptron:
    settings = Architecture(hidden=(16, 12), dropout=0.3)
    return Perceptron(4, 2, settings, torch.Generator().manual_seed(0), squash=True)


def passes_one_by_one(actor: Perceptron, observation: np.ndarray, passes: int, seed: int) -> np.ndarray:
    """Each pass by itself, with the units dropped that the generator says, in plain numpy."""
    masks = [each.numpy() for each in dropout_masks([(passes, 16), (passes, 12)], 0.3, np.random.default_rng(seed))]
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
    estimate = MonteCarloDropout(actor, passes, np.random.default_rng(9))(observation)
    np.testing.assert_allclose(estimate.mean, actions.mean(axis=0), atol=1e-6)
    expected = np.mean([abs((b - a) / (b + a)) for a, b in zip(first, third, strict=True)])
    assert estimate.uncertainty["qcd"] == pytest.approx(expected, rel=1e-4)
    assert estimate.uncertainty["iqr"] == pytest.approx(np.mean(third - first) / 2, rel=1e-4)


def test_every_call_drops_other_units(actor):
    estimate, observation = MonteCarloDropout(actor, 30, np.random.default_rng(0)), np.ones(4, dtype=np.float32)
    assert estimate(observation).uncertainty != estimate(observation).uncertainty


def test_the_mean_outlives_the_next_pass(actor):
    estimate, observation = MonteCarloDropout(actor, 30, np.random.default_rng(0)), np.ones(4, dtype=np.float32)
    mean = estimate(observation).mean
    before = mean.copy()
    estimate(-observation)
    np.testing.assert_array_equal(mean, before)


def test_an_actor_without_dropout_is_sure():
    actor = Perceptron(4, 2, Architecture(hidden=(8,)), torch.Generator().manual_seed(0), squash=True)
    estimate = MonteCarloDropout(actor, 30, np.random.default_rng(0))(np.ones(4, dtype=np.float32))
    assert estimate.uncertainty == {"qcd": 0.0, "iqr": 0.0}


def linear(outputs: int, *members: tuple[list[list[float]], list[float]], squash: bool) -> Perceptron:
    """Members without hidden layers, each of its weights (inputs, outputs) and biases."""
    inputs = len(members[0][0])
    network = Perceptron(
        inputs, outputs, Architecture(hidden=()), torch.Generator(), members=len(members), squash=squash
    )
    state = network.state_dict()
    for k, (weights, biases) in enumerate(members):
        state["weights.0"][k] = torch.tensor(weights)
        state["biases.0"][k, 0] = torch.tensor(biases)
    return network


def test_an_ensemble_of_actors_acts_by_its_mean_and_is_as_unsure_as_they_lie_apart():
    still = [[0.0], [0.0]]
    actions = [0.1, 0.2, 0.4, 0.5, 0.8]
    actor = linear(1, *((still, [float(np.arctanh(action))]) for action in actions), squash=True)
    estimate = ActorEnsemble(actor)(np.array([3.0, -1.0], dtype=np.float32))
    assert estimate.mean.tolist() == pytest.approx([0.4])
    # the quartiles of five are the second and the fourth
    assert estimate.uncertainty["qcd"] == pytest.approx((0.5 - 0.2) / (0.5 + 0.2), rel=1e-5)
    assert estimate.uncertainty["iqr"] == pytest.approx((0.5 - 0.2) / 2, rel=1e-5)


def test_members_see_the_observation():
    actor = linear(1, ([[1.0], [0.0]], [0.0]), ([[0.0], [1.0]], [0.0]), squash=True)
    agree, apart = (ActorEnsemble(actor)(np.array(each, dtype=np.float32)) for each in ([0.5, 0.5], [0.5, -0.5]))
    assert agree.uncertainty == {"qcd": 0.0, "iqr": 0.0}
    # of two actions, half their distance, over the action range of 2
    assert apart.uncertainty["iqr"] == pytest.approx(np.tanh(0.5) / 2, rel=1e-5)


def test_critics_are_as_unsure_as_their_values_of_the_actors_action_lie_apart():
    actor = linear(1, ([[0.0]], [float(np.arctanh(0.5))]), squash=True)
    critic = linear(1, ([[1.0], [2.0]], [0.0]), ([[0.0], [0.0]], [1.0]), ([[0.0], [4.0]], [5.0]), squash=False)
    estimate = CriticEnsemble(actor, critic)(np.array([3.0], dtype=np.float32))
    assert estimate.mean.tolist() == pytest.approx([0.5])
    # 3 + 2/2 = 4, 1 and 4/2 + 5 = 7: 3, 0 and 3 from their mean
    assert estimate.uncertainty == {"std": pytest.approx(6**0.5)}


def test_a_gate_gets_the_estimate_that_it_names(actor):
    pair = linear(1, ([[1.0]], [0.0]), ([[0.0]], [1.0]), squash=True)
    critics = linear(1, ([[1.0], [0.0]], [0.0]), ([[0.0], [0.0]], [1.0]), squash=False)
    draws = np.random.default_rng(0)
    assert isinstance(make_uncertainty(GateSettings(), actor, None, draws), MonteCarloDropout)
    assert isinstance(make_uncertainty(GateSettings(estimator="actors"), pair, None, draws), ActorEnsemble)
    by_critics = GateSettings("std", estimator="critics")
    assert isinstance(make_uncertainty(by_critics, actor, critics, draws), CriticEnsemble)
    sure = Perceptron(4, 2, Architecture(hidden=(8,)), torch.Generator(), squash=True)
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
    low, high, _ = quartiles(np.array([[5.0, -1.0], [1.0, -2.0], [4.0, -3.0], [2.0, -4.0], [3.0, -5.0]]))
    assert low == [2.0, -4.0]
    assert high == [4.0, -2.0]


def test_quartiles_between_values_are_interpolated():
    low, high, _ = quartiles(np.array([[1.0], [2.0], [3.0], [10.0]]))
    assert (low[0], high[0]) == (1.75, 4.75)  # places 0.75 and 2.25


@pytest.mark.parametrize("passes", [2, 3, 4, 7, 30, 101])
def test_quartiles_equal_numpys(passes):
    actions = np.random.default_rng(passes).normal(size=(passes, 7))
    low, high, mean = quartiles(actions)
    np.testing.assert_allclose([low, high], np.percentile(actions, [25, 75], axis=0), rtol=1e-12)
    np.testing.assert_allclose(mean, actions.mean(axis=0), rtol=1e-12)


def test_qcd_is_the_mean_over_the_components():
    # |4 - 2| / |4 + 2| = 1/3 and |-2 + 4| / |-2 - 4| = 1/3; |1 - 0| / |1 + 0| = 1
    assert qcd(np.array([2.0, -4.0]), np.array([4.0, -2.0])) == pytest.approx(1 / 3)
    assert qcd(np.array([2.0, -4.0, 0.0]), np.array([4.0, -2.0, 1.0])) == pytest.approx(5 / 9)


def test_qcd_of_two_quartiles_at_zero_is_no_dispersion():
    assert qcd(np.zeros(2), np.zeros(2)) == 0.0
    assert qcd(np.array([0.0, 2.0]), np.array([0.0, 4.0])) == pytest.approx(1 / 6)


@pytest.mark.filterwarnings("error")
def test_qcd_has_no_bound_around_zero():
    assert qcd(np.array([-1.0]), np.array([1.0])) == math.inf
    assert qcd(np.array([-0.99]), np.array([1.0])) == pytest.approx(199.0)


def test_iqr_is_a_share_of_the_action_range():
    assert iqr(np.array([-1.0, -1.0]), np.array([1.0, 1.0])) == 1.0
    assert iqr(np.array([0.1, 0.3]), np.array([0.2, 0.6])) == pytest.approx((0.1 + 0.3) / 2 / 2)
    assert iqr(np.array([0.3]), np.array([0.3])) == 0.0
