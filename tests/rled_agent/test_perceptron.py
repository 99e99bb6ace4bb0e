"""Networks: layers, dropout and the scaling around them."""

import itertools

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron, joined, parameter_shapes
from rled_agent.nn.scaling import Affine, Scaling, scaling_of_bounds, scaling_of_points, scaling_of_samples
from rled_msgs_py.errors import RledError
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

ROWS = 5


def make(*seeds: int, ensemble=2, squash=True, **architecture) -> Perceptron:
    """Networks of each seed, of 0 where none is named."""
    settings = Architecture(**{"hidden": (4, 3)} | architecture)
    return Perceptron(3, 2, settings, Draws(seeds or (0,)), ensemble=ensemble, squash=squash)


def numbers(*shape, seed=1) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


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


def masks_of(network: Perceptron, rows: int, draws: Draws) -> list[torch.Tensor]:
    """The dropout factors that a pass of a single seed draws, (e, rows, width) of each hidden layer: one draw."""
    settings = network.architecture
    if not settings.dropout:
        return []
    sizes = [network.ensemble * rows * width for width in settings.hidden]
    parts = draws.kept(settings.dropout, sum(sizes))[0].split(sizes)
    shapes = [(network.ensemble, rows, width) for width in settings.hidden]
    return [part.view(shape).to(network.weights[0]) for part, shape in zip(parts, shapes, strict=True)]


def gradients(loss: torch.Tensor, network: Perceptron) -> list[torch.Tensor]:
    return list(torch.autograd.grad(loss, [*network.parameters()]))


VARIANTS = [
    dict(zip(("activation", "layer_norm", "dropout", "squash", "ensemble"), values, strict=True))
    for values in itertools.product(("relu", "leaky_relu"), (False, True), (0.0, 0.4), (False, True), (1, 2))
]


@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("variant", VARIANTS, ids=lambda each: "-".join(str(value) for value in each.values()))
def test_outputs_and_gradients_are_those_of_the_members_one_by_one(variant):
    network = make(**variant)
    x, weight = numbers(ROWS, 3).requires_grad_(), numbers(variant["ensemble"], ROWS, 2, seed=2)
    expected = plain_forward(network, x, masks_of(network, ROWS, Draws([7])))
    out = network(x, Draws([7]))
    torch.testing.assert_close(out, expected, rtol=1e-12, atol=1e-12)
    for mine, theirs in zip(
        gradients((out * weight).sum(), network), gradients((expected * weight).sum(), network), strict=True
    ):
        torch.testing.assert_close(mine, theirs, rtol=1e-10, atol=1e-12)


def test_each_seed_may_have_rows_of_its_own_which_its_ensemble_shares():
    network, rows = make(0, 1), numbers(2, ROWS, 3)
    apart = torch.stack([network(rows[member // 2])[member] for member in range(4)])
    torch.testing.assert_close(network(rows), apart)


def alone(seed: int, **settings) -> Perceptron:
    """What a seed has without others beside it."""
    network = make(seed, **settings)
    assert (network.population, network.members) == (1, network.ensemble)
    return network


SIZES = [
    pytest.param({"hidden": (4, 3)}, ROWS, id="small"),
    pytest.param({"hidden": (5,), "ensemble": 1}, 1, id="one-row"),
    pytest.param({"hidden": (), "ensemble": 3}, 7, id="linear"),
    pytest.param({"hidden": (), "ensemble": 1}, 100, id="linear-alone"),
    pytest.param({"hidden": (33, 17), "ensemble": 1, "dropout": 0.3}, 9, id="dropout"),
    pytest.param({"hidden": (20, 19), "dropout": 0.5, "layer_norm": True, "activation": "leaky_relu"}, 30, id="all"),
    pytest.param({"hidden": (400, 300), "ensemble": 1}, 100, id="actor-of-the-thesis"),
    pytest.param({"hidden": (400, 300), "squash": False}, 100, id="critics-of-the-thesis"),
]


@pytest.mark.parametrize(("settings", "rows"), SIZES)
@pytest.mark.parametrize("outputs", [1, 2, 7])
@pytest.mark.parametrize("population", [2, 3, 5])
def test_a_seed_has_the_outputs_and_gradients_that_it_has_alone_bit_for_bit(settings, rows, outputs, population):
    architecture = Architecture(**{name: each for name, each in settings.items() if name not in ("ensemble", "squash")})
    options = {"ensemble": settings.get("ensemble", 2), "squash": settings.get("squash", True)}
    x, weight = numbers(population, rows, 6), numbers(population, options["ensemble"], rows, outputs, seed=2)

    def learned(seeds, x, weight):
        network = Perceptron(6, outputs, architecture, draws := Draws(seeds), **options)
        x = x.clone().requires_grad_()
        out = network(x, draws)
        found = torch.autograd.grad((out.view(weight.shape) * weight).sum(), [x, *network.parameters()])
        with torch.inference_mode():
            passes = network.forward_once(x[:, 0], 5, draws)
        each_seed = (out.detach(), passes, *network.parameters(), *found)
        return [each.detach().reshape(len(seeds), -1) for each in each_seed]

    together = learned(range(population), x, weight)
    for k in range(population):
        by_itself = learned([k], x[k : k + 1], weight[k : k + 1])
        for mine, theirs in zip(by_itself, together, strict=True):
            assert torch.equal(mine[0], theirs[k])


def test_the_networks_of_one_seed_are_its_own_and_share_their_weights():
    network, x = make(5, 6, 7), numbers(ROWS, 3)
    for k in range(3):
        member = network.member(k)
        assert (member.population, member.ensemble) == (1, 2)
        assert torch.equal(member(x), network(x)[2 * k : 2 * k + 2])
        assert (member.vector() == alone(5 + k).vector()).all()
        assert not member(x).requires_grad
    second = network.member(1)
    network.load_vector(2.0 * network.vector())
    assert (second.vector() == 2.0 * alone(6).vector()).all()
    assert torch.equal(second(x), network(x)[2:4])


def test_networks_are_joined_seed_by_seed():
    parts, x = [alone(seed, dropout=0.4) for seed in (5, 6, 7)], numbers(3, ROWS, 3)
    whole = joined(parts)
    assert (whole.population, whole.ensemble, whole.members) == (3, 2, 6)
    assert (whole.vector() == make(5, 6, 7, dropout=0.4).vector()).all()
    assert torch.equal(whole(x, Draws([1, 2, 3])), torch.cat([
        part(x[k : k + 1], Draws([k + 1])) for k, part in enumerate(parts)
    ]))  # fmt: skip
    assert not whole(x).requires_grad
    assert all((whole.member(k).vector() == part.vector()).all() for k, part in enumerate(parts))
    assert joined(parts[:1]) is parts[0]


@pytest.mark.parametrize("other", [{"hidden": (4, 4)}, {"ensemble": 1}, {"squash": False}, {"dropout": 0.1}])
def test_networks_of_several_shapes_are_not_joined(other):
    with pytest.raises(RledError, match="networks of several shapes; accepted: one shape for all seeds"):
        joined([make(0), make(1, **other)])


@pytest.mark.parametrize("settings", [{}, {"hidden": ()}, {"hidden": (5, 6, 7), "ensemble": 3}])
def test_the_shapes_of_parameters_are_known_before_a_network_is_made(settings):
    network = make(**settings)
    shapes = parameter_shapes(3, 2, network.architecture, network.ensemble)
    assert shapes == {name: tuple(each.shape) for name, each in network.named_parameters()}


def test_too_many_weights_are_refused_whatever_the_population():
    with pytest.raises(RledError, match=r"networks of 3 x 9000 x 9000 x 2 units; accepted: 33,554,432 weights"):
        make(hidden=(9000, 9000), ensemble=1)
    with pytest.raises(RledError, match="networks of 3 x 4500 x 4500 x 2 units"):
        make(hidden=(4500, 4500), ensemble=2)


def test_output_of_known_weights_is_the_one_worked_out_by_hand():
    network = Perceptron(2, 1, Architecture(hidden=(2,)), Draws([0]))
    values = {"weights.0": [[1.0, -1.0], [2.0, 1.0]], "biases.0": [[0.5, -4.0]], "weights.1": [[3.0], [100.0]]}
    for name, value in (values | {"biases.1": [[-2.0]]}).items():
        network.state_dict()[name].copy_(torch.tensor(value)[None])
    # hidden: relu(1*1 + 2*2 + 0.5) = 5.5, relu(-1 + 2 - 4) = 0; output: 3 * 5.5 - 2
    assert network(torch.tensor([[1.0, 2.0]])).item() == 14.5


def test_same_seed_gives_the_same_weights_within_the_bound_of_the_fan_in():
    one, same, other = make(0), make(0), make(1)
    assert (one.vector() == same.vector()).all()
    assert not (one.vector() == other.vector()).all()
    wide = Perceptron(4, 500, Architecture(hidden=(9,)), Draws([0]))
    for weight, bias, fan_in in zip(wide.weights, wide.biases, (4, 9), strict=True):
        for each in (weight, bias):
            assert each.abs().max() <= fan_in**-0.5
    assert wide.weights[1].abs().max() > 0.99 / 3.0
    assert abs(wide.weights[1].mean().item()) < 0.01


def test_glorots_weights_lie_within_the_bound_of_both_fans_and_biases_begin_at_zero():
    network = Perceptron(4, 500, Architecture(hidden=(9,), weights="glorot"), Draws([0]))
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
    network, x = make(0, 1, ensemble=3), numbers(2, ROWS, 3).requires_grad_()
    first = network.first()
    assert (first.population, first.ensemble) == (2, 1)
    torch.testing.assert_close(first(x), network(x)[[0, 3]])
    network.load_vector(network.vector() * 0.5)
    torch.testing.assert_close(first(x), network(x)[[0, 3]])
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


def test_dropout_is_off_without_draws():
    network, x = make(dropout=0.5), numbers(ROWS, 3)
    whole = network(x)
    assert torch.equal(make(dropout=0.0)(x), whole)
    assert not torch.equal(network(x, Draws([0])), whole)
    assert torch.equal(network(x), whole)


def test_passes_on_one_input_equal_a_batch_of_it_with_the_same_dropped_units():
    network, x = make(0, 1, hidden=(16, 12), dropout=0.5), numbers(2, 3)
    batch = network(x[:, None].expand(-1, 30, -1), Draws([3, 4]))
    torch.testing.assert_close(network.forward_once(x, 30, Draws([3, 4])), batch)
    assert all(len(each.unique(dim=0)) > 10 for each in batch)


def test_passes_of_a_network_without_dropout_are_all_the_same():
    network, x = make(), numbers(1, 3)
    passes = network.forward_once(x, 4, Draws([0]))
    assert passes.shape == (2, 4, 2)
    torch.testing.assert_close(passes, network(x).expand(-1, 4, -1))


def test_dropout_differs_in_every_row_and_member():
    network = make(0, 1, hidden=(64,), dropout=0.5)
    (mask,) = network._masks(30, Draws([0, 1]))
    assert mask.shape == (4, 30, 64)
    assert len(mask.view(120, 64).unique(dim=0)) == 120


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


def some_scaling(seed: int) -> Scaling:
    drawing = np.random.default_rng(seed)
    return Scaling(*(drawing.uniform(0.5, 2.0, size) for size in (3, 3, 2, 2)))


def test_normalised_numbers_go_from_one_scaling_into_another_as_by_way_of_their_units():
    """Each seed by maps of its own, of one row or of many."""
    one, others = some_scaling(0), [some_scaling(k) for k in (1, 2)]
    rows = numbers(2, ROWS, 3)
    into = Affine([one.observation_into(each) for each in others])
    physical = [one.denormalize_observation(each.numpy()) for each in rows]
    expected = [other.normalize_observation(each) for other, each in zip(others, physical, strict=True)]
    np.testing.assert_allclose(into(rows), np.stack(expected), atol=1e-6)
    assert torch.equal(into(rows[:, 2]), into(rows)[:, 2])
    back = Affine([each.action_into(one) for each in others])
    action = one.normalize_action(others[1].denormalize_action(rows[1, :, :2].numpy()))
    np.testing.assert_allclose(back(rows[..., :2])[1], action, atol=1e-6)


def test_a_scaling_into_itself_changes_nothing_and_a_seed_is_mapped_as_alone():
    one, rows = some_scaling(0), numbers(3, ROWS, 3)
    assert Affine([one.observation_into(one)] * 3)(rows) is rows
    maps = [one.observation_into(some_scaling(k)) for k in range(3)]  # the first leaves it as it is
    together = Affine(maps)(rows)
    for k, each in enumerate(maps):
        assert torch.equal(together[k : k + 1], Affine([each])(rows[k : k + 1]))
