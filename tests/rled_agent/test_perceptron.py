import itertools

import pytest
import torch
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.dropout import dropout_masks
from rled_agent.nn.perceptron import Perceptron

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
