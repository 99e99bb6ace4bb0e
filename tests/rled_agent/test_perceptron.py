"""Networks: layers, dropout and the scaling around them."""

import itertools

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.dropout import dropout_masks
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.scaling import scaling_of_bounds, scaling_of_points, scaling_of_samples
from rled_msgs_py.errors import RledError
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

ROWS = 5


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def make(seed=0, members=2, squash=True, **architecture) -> Perceptron:
    settings = Architecture(**{"hidden": (4, 3)} | architecture)
    return Perceptron(3, 2, settings, generator(seed), members=members, squash=squash)


def numbers(*shape, seed=1) -> torch.Tensor:
    return torch.randn(*shape, generator=generator(seed))


def plain_forward(network: Perceptron, x: torch.Tensor, masks=None) -> torch.Tensor:
    """The members one by one, in the words of a textbook."""
    settings, outputs = network.architecture, []
    for member in range(network.members):
        h = x
        for k, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
            h = h @ weight[member] + bias[member]
            if k == len(network.weights) - 1:
                break
            if settings.layer_norm:
                h = (h - h.mean(dim=1, keepdim=True)) / (h.var(dim=1, unbiased=False, keepdim=True) + 1e-5).sqrt()
            h = torch.relu(h) if settings.activation == "relu" else torch.where(h > 0, h, 0.01 * h)
            if masks:
                h = h * masks[k][member]
        outputs.append(torch.tanh(h) if network.squash else h)
    return torch.stack(outputs)


def masks_of(network: Perceptron, rows: int, drawing: torch.Generator) -> list[torch.Tensor]:
    """The dropout factors that a pass draws, (e, rows, width) of each hidden layer."""
    settings = network.architecture
    if not settings.dropout:
        return []
    shapes = [(network.members, rows, width) for width in settings.hidden]
    return [mask.to(network.weights[0]) for mask in dropout_masks(shapes, settings.dropout, drawing)]


def gradients(loss: torch.Tensor, network: Perceptron) -> list[torch.Tensor]:
    return list(torch.autograd.grad(loss, [*network.parameters()]))


VARIANTS = [
    dict(zip(("activation", "layer_norm", "dropout", "squash", "members"), values, strict=True))
    for values in itertools.product(("relu", "leaky_relu"), (False, True), (0.0, 0.4), (False, True), (1, 2))
]


@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("variant", VARIANTS, ids=lambda each: "-".join(str(value) for value in each.values()))
def test_outputs_and_gradients_are_those_of_the_members_one_by_one(variant):
    network = make(**variant)
    x, weight = numbers(ROWS, 3).requires_grad_(), numbers(variant["members"], ROWS, 2, seed=2)
    expected = plain_forward(network, x, masks_of(network, ROWS, generator(7)))
    out = network(x, generator(7))
    torch.testing.assert_close(out, expected, rtol=1e-12, atol=1e-12)
    for mine, theirs in zip(
        gradients((out * weight).sum(), network), gradients((expected * weight).sum(), network), strict=True
    ):
        torch.testing.assert_close(mine, theirs, rtol=1e-10, atol=1e-12)


def test_each_member_may_have_rows_of_its_own():
    network, rows = make(), numbers(2, ROWS, 3)
    apart = torch.stack([network(rows[member])[member] for member in range(2)])
    torch.testing.assert_close(network(rows), apart)


def test_output_of_known_weights_is_the_one_worked_out_by_hand():
    network = Perceptron(2, 1, Architecture(hidden=(2,)), generator())
    values = {"weights.0": [[1.0, -1.0], [2.0, 1.0]], "biases.0": [[0.5, -4.0]], "weights.1": [[3.0], [100.0]]}
    for name, value in (values | {"biases.1": [[-2.0]]}).items():
        network.state_dict()[name].copy_(torch.tensor(value)[None])
    # hidden: relu(1*1 + 2*2 + 0.5) = 5.5, relu(-1 + 2 - 4) = 0; output: 3 * 5.5 - 2
    assert network(torch.tensor([[1.0, 2.0]])).item() == 14.5


def test_same_seed_gives_the_same_weights_within_the_bound_of_the_fan_in():
    one, same, other = make(0), make(0), make(1)
    assert (one.vector() == same.vector()).all()
    assert not (one.vector() == other.vector()).all()
    wide = Perceptron(4, 500, Architecture(hidden=(9,)), generator())
    for weight, bias, fan_in in zip(wide.weights, wide.biases, (4, 9), strict=True):
        for each in (weight, bias):
            assert each.abs().max() <= fan_in**-0.5
    assert wide.weights[1].abs().max() > 0.99 / 3.0
    assert abs(wide.weights[1].mean().item()) < 0.01


def test_glorots_weights_lie_within_the_bound_of_both_fans_and_biases_begin_at_zero():
    network = Perceptron(4, 500, Architecture(hidden=(9,), weights="glorot"), generator())
    for weight, bias, fans in zip(network.weights, network.biases, (4 + 9, 9 + 500), strict=True):
        bound = (6.0 / fans) ** 0.5
        assert 0.9 * bound < weight.abs().max() <= bound
        assert not bias.any()
    assert abs(network.weights[1].mean().item()) < 0.01


def test_a_frozen_copy_has_the_weights_and_memory_of_its_own_and_takes_no_gradient():
    network, x = make(), numbers(ROWS, 3)
    twin, before = network.frozen(), network(x)
    assert torch.equal(twin(x), before)
    assert not twin(x).requires_grad
    network.load_vector(network.vector() + 1.0)
    assert torch.equal(twin(x), before)
    assert not torch.equal(network(x), before)


def test_the_first_member_shares_its_weights_and_passes_gradients_on_without_taking_them():
    network, x = make(), numbers(ROWS, 3).requires_grad_()
    first = network.first()
    assert torch.equal(first(x)[0], network(x)[0])
    network.load_vector(network.vector() * 0.5)
    assert torch.equal(first(x)[0], network(x)[0])
    first(x).sum().backward()
    assert x.grad.abs().sum() > 0
    assert all(parameter.grad is None for parameter in network.parameters())


def test_a_vector_of_another_network_makes_this_one_act_like_it():
    one, other, x = make(0), make(1), numbers(ROWS, 3)
    vector = other.vector()
    one.load_vector(vector)
    assert torch.equal(one(x), other(x))
    vector[:] = 0.0
    assert torch.equal(one(x), other(x))


def test_dropout_is_off_without_a_generator():
    network, x = make(dropout=0.5), numbers(ROWS, 3)
    whole = network(x)
    assert torch.equal(make(dropout=0.0)(x), whole)
    assert not torch.equal(network(x, generator()), whole)
    assert torch.equal(network(x), whole)


def test_passes_on_one_input_equal_a_batch_of_it_with_the_same_dropped_units():
    network, x = make(hidden=(16, 12), dropout=0.5), numbers(3)
    batch = network(x.expand(30, -1), generator(3))
    torch.testing.assert_close(network.forward_once(x, 30, generator(3)), batch)
    assert len(batch[0].unique(dim=0)) > 10


def test_passes_of_a_network_without_dropout_are_all_the_same():
    network, x = make(), numbers(3)
    passes = network.forward_once(x, 4, generator())
    assert passes.shape == (2, 4, 2)
    torch.testing.assert_close(passes, network(x[None]).expand(-1, 4, -1))


def test_dropout_differs_in_every_row_and_member():
    network = make(hidden=(64,), dropout=0.5)
    network(torch.ones(30, 3), generator())
    (mask,) = masks_of(network, 30, generator())
    assert len(mask.view(60, 64).unique(dim=0)) == 60


MAKERS = [
    pytest.param(lambda seed: torch.Generator().manual_seed(seed), id="torch"),
    pytest.param(np.random.default_rng, id="numpy"),
]


def mask_of(count, probability, generator):
    return dropout_masks([(count,)], probability, generator)[0]


@pytest.mark.parametrize("probability", [0.1, 0.5])
@pytest.mark.parametrize("generator", MAKERS)
def test_each_unit_is_dropped_with_its_probability_and_by_itself(generator, probability):
    mask = mask_of(100_300, probability, generator(0)).view(100, 1003)
    dropped = (mask == 0).double()
    deviation = (probability * (1 - probability) / mask.numel()) ** 0.5
    assert abs(float(dropped.mean()) - probability) < 5 * deviation + 2**-16
    torch.testing.assert_close(mask.unique(), torch.tensor([0.0, 1 / (1 - probability)]), rtol=1e-4, atol=0)
    for lag in (1, 2, 3, 4):  # four units share a draw
        together = float((dropped[:, lag:] * dropped[:, :-lag]).mean())
        assert abs(together - probability**2) < 5 * (probability**2 / mask.numel()) ** 0.5


@pytest.mark.parametrize("probability", [0.1, 0.3, 0.95])
def test_the_probability_is_met_to_a_thousandth(probability):
    """The mask keeps its mean: 2⁻¹⁶ of the probability is all that is rounded."""
    kept = float(mask_of(1000, probability, np.random.default_rng(0)).max())
    assert 1 - 1 / kept == pytest.approx(probability, abs=1e-3 * probability)


@pytest.mark.parametrize("generator", MAKERS)
def test_the_same_generator_state_drops_the_same_units(generator):
    one, same, other = (mask_of(105, 0.3, generator(seed)) for seed in (4, 4, 5))
    assert torch.equal(one, same)
    assert not torch.equal(one, other)


@pytest.mark.parametrize("generator", MAKERS)
def test_the_next_mask_is_another_one(generator):
    drawing = generator(4)
    assert not torch.equal(mask_of(105, 0.3, drawing), mask_of(105, 0.3, drawing))


def test_several_masks_are_one_draw_in_parts():
    first, second = dropout_masks([(2, 3, 5), (2, 3, 2)], 0.3, np.random.default_rng(1))
    assert (first.shape, second.shape) == ((2, 3, 5), (2, 3, 2))
    assert torch.equal(torch.cat([first.flatten(), second.flatten()]), mask_of(42, 0.3, np.random.default_rng(1)))


ACTION = (np.array([-0.1, -0.2]), np.array([0.1, 0.4]))


def test_bounds_become_one():
    scaling = scaling_of_bounds((np.array([-1.0, 2.0]), np.array([1.0, 6.0])), ACTION)
    low, middle, high = scaling.normalize_observation(np.array([[-1.0, 2.0], [0.0, 4.0], [1.0, 6.0]]))
    assert (low.tolist(), middle.tolist(), high.tolist()) == ([-1, -1], [0, 0], [1, 1])
    np.testing.assert_allclose(
        scaling.normalize_action(np.array([ACTION[0], [0, 0.1], ACTION[1]])), [[-1] * 2, [0] * 2, [1] * 2], atol=1e-7
    )


@pytest.mark.parametrize(("low", "high"), [(-np.inf, np.inf), (-np.inf, 1.0), (0.0, np.inf), (3.0, 3.0)])
def test_an_unbounded_or_empty_component_is_left_as_it_is(low, high):
    scaling = scaling_of_bounds((np.array([low]), np.array([high])), ACTION)
    assert scaling.normalize_observation(np.array([7.5])).tolist() == [7.5]


@pytest.mark.parametrize("bounds", [([-np.inf], [1.0]), ([0.0], [np.inf]), ([1.0], [1.0]), ([1.0], [-1.0])])
def test_actions_without_finite_bounds_are_refused(bounds):
    with pytest.raises(RledError, match="no finite bounds"):
        scaling_of_bounds((np.zeros(1), np.ones(1)), tuple(map(np.array, bounds)))


def test_samples_become_mean_0_and_deviation_1():
    samples = np.random.default_rng(0).normal([5.0, -2.0, 3.0], [0.01, 4.0, 0.0], (1000, 3))
    normal = scaling_of_samples(samples, ACTION).normalize_observation(samples)
    np.testing.assert_allclose(normal.mean(axis=0), 0.0, atol=1e-4)
    np.testing.assert_allclose(normal[:, :2].std(axis=0), 1.0, rtol=1e-4)
    assert (normal[:, 2] == 0.0).all()


@given(st.lists(st.floats(-1, 1), min_size=2, max_size=2))
def test_actions_come_back(action):
    scaling = scaling_of_bounds((np.zeros(1), np.ones(1)), ACTION)
    there = scaling.denormalize_action(np.array(action))
    np.testing.assert_allclose(scaling.normalize_action(there), action, atol=1e-6)
    assert (there >= ACTION[0] - 1e-12).all()
    assert (there <= ACTION[1] + 1e-12).all()


@given(st.lists(st.floats(-10, 10), min_size=2, max_size=2))
def test_observations_come_back(observation):
    scaling = scaling_of_bounds((np.array([-1.0, 2.0]), np.array([1.0, 6.0])), ACTION)
    back = scaling.denormalize_observation(scaling.normalize_observation(np.array(observation)))
    np.testing.assert_allclose(back, observation, atol=1e-5)


def test_lengths_are_measured_in_halves_of_the_demonstrated_extent_and_angles_in_radians():
    positions = np.array([[0.4, -0.25, 0.5], [0.6, 0.25, 0.5], [0.5, 0.0, 0.6]])
    joints = np.array([[0.1] * 7, [0.2] * 7, [0.6] * 7])
    scaling = scaling_of_points(reach_task(ROBOTS["panda"]).description, positions, joints)
    observation = np.array([0.25, 0.0, -0.125] + [1.3] * 7)  # half of the extent is 0.25 m, the mean angle 0.3 rad
    np.testing.assert_allclose(scaling.normalize_observation(observation), [1.0, 0.0, -0.5] + [1.0] * 7, rtol=1e-6)
    np.testing.assert_allclose(scaling.normalize_action(np.full(7, 0.04)), np.ones(7), rtol=1e-6)


def test_positions_are_measured_from_the_demonstrated_mean():
    positions = np.array([[0.4, -0.25, 0.1], [0.6, 0.25, 0.1], [0.5, 0.0, 0.1]])
    scaling = scaling_of_points(reach_task(ROBOTS["planar"]).description, positions, np.zeros((3, 2)))
    normal = scaling.normalize_observation(np.array([0.5, 0.25, 0.75, -0.25]))
    np.testing.assert_allclose(normal, [0.0, 1.0, 1.0, -1.0], atol=1e-6)
