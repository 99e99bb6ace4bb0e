"""Adam: against PyTorch's own, with a learning rate for each group of seeds, and each seed as if it were alone."""

import numpy as np
import pytest
import torch
from rled_agent.nn.adam import Adam
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron

STEPS = 12


def make(*seeds: int, ensemble: int = 1, hidden: tuple[int, ...] = (5, 3)) -> Perceptron:
    return Perceptron(3, 2, Architecture(hidden=hidden), Draws(seeds), ensemble=ensemble, squash=True)


def losses(network: Perceptron, seeds: tuple[int, ...]) -> torch.Tensor:
    """A loss of each seed, shape (P,), whose minimum depends on the seed."""
    goals = torch.tensor([[[0.1 * (seed + 1)]] for seed in seeds], dtype=network.weights[0].dtype)
    rows = torch.linspace(-1.0, 1.0, 12, dtype=goals.dtype).view(1, 4, 3) * (1.0 + goals)
    out = network(rows).view(len(seeds), network.ensemble, 4, 2)
    return (out - goals[:, None]).square().sum(dim=(1, 2, 3))


def trained(seeds: tuple[int, ...], groups: list[int], rates: list[float], **shape) -> tuple[Perceptron, Adam]:
    """After some steps, whose rates shrink."""
    network = make(*seeds, **shape)
    optimizer = Adam(network, groups)
    for k in range(STEPS):
        optimizer.step(losses(network, seeds).sum(), [rate / (1.0 + 0.1 * k) for rate in rates])
    return network, optimizer


def parts(network: Perceptron, optimizer: Adam, seed: int) -> list[torch.Tensor]:
    """Weights and moments of one seed."""
    tensors = [each.detach() for each in network.parameters()] + list(optimizer.tensors().values())
    return [each[seed * network.ensemble : (seed + 1) * network.ensemble] for each in tensors]


@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("ensemble", [1, 2])
def test_steps_are_those_of_pytorchs_adam(ensemble):
    seeds = (4, 5, 6)
    network, optimizer = trained(seeds, [3], [0.05], ensemble=ensemble)
    reference = make(*seeds, ensemble=ensemble)
    adam = torch.optim.Adam(reference.parameters())
    for k in range(STEPS):
        adam.param_groups[0]["lr"] = 0.05 / (1.0 + 0.1 * k)
        adam.zero_grad()
        losses(reference, seeds).sum().backward()
        adam.step()
    np.testing.assert_allclose(network.vector(), reference.vector(), rtol=1e-10, atol=1e-12)
    assert optimizer.steps == STEPS
    for name, parameter in reference.named_parameters():
        for part in ("exp_avg", "exp_avg_sq"):
            torch.testing.assert_close(optimizer.tensors()[f"{name}.{part}"], adam.state[parameter][part])


@pytest.mark.usefixtures("double")
def test_the_first_step_is_the_learning_rate_against_the_sign_of_the_gradient():
    """m/(1 − β₁) = g and v/(1 − β₂) = g², so α g / (|g| + 1e-8) is left."""
    network = make(0, 1)
    before = [each.detach().clone() for each in network.parameters()]
    loss = losses(network, (0, 1)).sum()
    gradients = torch.autograd.grad(loss, [*network.parameters()], retain_graph=True)
    Adam(network, [1, 1]).step(loss, [0.5, 0.25])
    rate = torch.tensor([0.5, 0.25]).view(2, 1, 1)
    for old, parameter, gradient in zip(before, network.parameters(), gradients, strict=True):
        expected = old - rate * gradient / (gradient.abs() + 1e-8)
        torch.testing.assert_close(parameter.detach(), expected, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("hidden", [(5, 3), (16, 32), (7,), ()])
@pytest.mark.parametrize("ensemble", [1, 2, 3])
@pytest.mark.parametrize("population", [2, 5])
def test_a_seed_is_changed_as_it_is_alone_bit_for_bit(hidden, ensemble, population):
    together = trained(tuple(range(population)), [population], [0.01], hidden=hidden, ensemble=ensemble)
    for seed in range(population):
        alone = trained((seed,), [1], [0.01], hidden=hidden, ensemble=ensemble)
        for one, other in zip(parts(*alone, 0), parts(*together, seed), strict=True):
            assert torch.equal(one, other)


@pytest.mark.parametrize(
    ("groups", "rates"), [([2, 3], [0.01, 0.03]), ([1, 1, 3], [0.01, 0.0, 0.01]), ([4, 1], [1e-3, 1.0])]
)
def test_groups_of_rates_are_changed_as_runs_of_their_own_bit_for_bit(groups, rates):
    together, begin = trained((0, 1, 2, 3, 4), groups, rates, ensemble=2), 0
    for count, rate in zip(groups, rates, strict=True):
        seeds = tuple(range(begin, begin + count))
        alone = trained(seeds, [count], [rate], ensemble=2)
        for k, seed in enumerate(seeds):
            for one, other in zip(parts(*alone, k), parts(*together, seed), strict=True):
                assert torch.equal(one, other)
        begin += count


def test_a_rate_of_zero_changes_nothing_but_the_moments():
    network, optimizer = trained((3, 4), [1, 1], [0.0, 0.01])
    still, moved = network.member(0), network.member(1)
    assert (still.vector() == make(3).vector()).all()
    assert (moved.vector() != make(4).vector()).any()
    assert all((each[0] != 0).any() for each in optimizer.tensors().values())


def test_there_has_to_be_a_rate_for_each_group():
    network = make(0, 1)
    with pytest.raises(ValueError, match="zip"):
        Adam(network, [1, 1]).step(losses(network, (0, 1)).sum(), [0.1])


def test_moments_begin_at_zero_and_share_memory_with_the_optimiser():
    network = make(0, 1)
    optimizer = Adam(network, [1, 1])
    tensors = optimizer.tensors()
    names = [name for name, _ in network.named_parameters()]
    assert list(tensors) == [f"{name}.{part}" for part in ("exp_avg", "exp_avg_sq") for name in names]
    assert optimizer.steps == 0
    assert not any(each.any() for each in tensors.values())
    assert all(tensors[f"{name}.exp_avg"].shape == each.shape for name, each in network.named_parameters())
    optimizer.step(losses(network, (0, 1)).sum(), [0.1, 0.1])
    assert all(each.any() for each in tensors.values())


@pytest.mark.parametrize("groups", [[3], [1, 2]])
def test_weights_moments_and_steps_are_all_there_is(groups):
    seeds, rates = (0, 1, 2), [0.01, 0.02][: len(groups)]
    network, optimizer = trained(seeds, groups, rates)
    twin = make(7, 8, 9)
    twin.load_vector(network.vector())
    resumed = Adam(twin, groups)
    for name, tensor in resumed.tensors().items():
        tensor.copy_(optimizer.tensors()[name])
    resumed.steps = optimizer.steps
    assert resumed.steps == STEPS
    for each, adam in ((network, optimizer), (twin, resumed)):
        for _ in range(5):
            adam.step(losses(each, seeds).sum(), rates)
    assert (network.vector() == twin.vector()).all()
    assert resumed.steps == STEPS + 5
