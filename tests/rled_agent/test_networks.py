import itertools

import pytest
import torch
from rled_agent.architecture import Architecture
from rled_agent.dropout import dropout_masks
from rled_agent.memory import Rows
from rled_agent.networks import Network

ROWS = 5


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def make(seed=0, members=2, squash=True, **architecture) -> Network:
    settings = Architecture(**{"hidden": (4, 3)} | architecture)
    return Network(3, 2, settings, generator(seed), members=members, squash=squash)


def numbers(*shape, seed=1) -> torch.Tensor:
    return torch.randn(*shape, generator=generator(seed))


def plain_forward(network: Network, x: torch.Tensor, parameters: dict[str, torch.Tensor], masks=None) -> torch.Tensor:
    """The network in the words of a textbook, for autograd."""
    settings = network.architecture
    outputs = []
    for member in range(network.members):
        h = x
        for k in range(len(network.layers)):
            h = h @ parameters[f"{k}.weight"][member] + parameters[f"{k}.bias"][member]
            if k == len(network.layers) - 1:
                break
            if settings.layer_norm:
                h = (h - h.mean(dim=1, keepdim=True)) / (h.var(dim=1, unbiased=False, keepdim=True) + 1e-5).sqrt()
            h = torch.relu(h) if settings.activation == "relu" else torch.where(h > 0, h, 0.01 * h)
            if masks:
                h = h * masks[k][member]
        outputs.append(torch.tanh(h) if network.squash else h)
    return torch.stack(outputs)


def masks_of(network: Network, rows: int, drawing: torch.Generator) -> list[torch.Tensor]:
    """The dropout factors that a pass draws, (e, rows, width) of each hidden layer."""
    settings = network.architecture
    if not settings.dropout:
        return []
    shapes = [(network.members, rows, width) for width in settings.hidden]
    return dropout_masks(shapes, settings.dropout, drawing)


def leaves(network: Network) -> dict[str, torch.Tensor]:
    return {name: each.clone().requires_grad_() for name, each in network.named_parameters().items()}


def gradients(network: Network) -> dict[str, torch.Tensor]:
    views = {}
    for k, layer in enumerate(network.layers):
        views |= {f"{k}.weight": layer.gradient[:, 1:], f"{k}.bias": layer.gradient[:, :1]}
    return views


VARIANTS = [
    dict(zip(("activation", "layer_norm", "dropout", "squash", "members"), values, strict=True))
    for values in itertools.product(("relu", "leaky_relu"), (False, True), (0.0, 0.4), (False, True), (1, 2))
]


@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("variant", VARIANTS, ids=lambda each: "-".join(str(value) for value in each.values()))
def test_forward_and_backward_equal_autograd(variant):
    network = make(**variant)
    x, weight = numbers(ROWS, 3), numbers(variant["members"], ROWS, 2, seed=2)
    drawing = generator(7)
    masks = masks_of(network, ROWS, drawing)
    parameters, inputs = leaves(network), x.clone().requires_grad_()
    expected = plain_forward(network, inputs, parameters, masks)
    (expected * weight).sum().backward()

    out = network.forward(x, generator=generator(7))
    torch.testing.assert_close(out, expected.detach(), rtol=1e-12, atol=1e-12)
    at_inputs = network.backward(weight.clone(), inputs_from=0)
    torch.testing.assert_close(at_inputs.sum(dim=0), inputs.grad, rtol=1e-10, atol=1e-12)
    for name, gradient in gradients(network).items():
        torch.testing.assert_close(gradient, parameters[name].grad, rtol=1e-10, atol=1e-12, msg=name)


@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("layer_norm", [False, True])
@pytest.mark.parametrize("activation", ["relu", "leaky_relu"])
def test_backward_equals_finite_differences(activation, layer_norm):
    network = make(activation=activation, layer_norm=layer_norm, dropout=0.3)
    x, weight = numbers(ROWS, 3), numbers(2, ROWS, 2, seed=2)

    def loss() -> float:
        return float((network.forward(x, generator=generator(7)) * weight).sum())

    def difference(vector: torch.Tensor, k: int, step: float = 1e-6) -> float:
        before = float(vector[k])
        values = []
        for each in (before + step, before - step):
            vector[k] = each
            values.append(loss())
        vector[k] = before
        return (values[0] - values[1]) / (2 * step)

    network.forward(x, generator=generator(7))
    at_inputs = network.backward(weight.clone(), inputs_from=1)
    analytic = network.gradients.clone(), at_inputs.sum(dim=0).clone()
    numeric = [difference(network.parameters, k) for k in range(len(network.parameters))]
    torch.testing.assert_close(analytic[0], torch.tensor(numeric), rtol=1e-5, atol=1e-8)
    flat = x.view(-1)
    numeric = [[difference(flat, 3 * row + column) for column in (1, 2)] for row in range(ROWS)]
    torch.testing.assert_close(analytic[1], torch.tensor(numeric), rtol=1e-5, atol=1e-8)


def test_backward_without_parameters_leaves_their_gradients_alone():
    network = make()
    network.forward(numbers(ROWS, 3))
    network.gradients.fill_(7.0)
    network.backward(numbers(2, ROWS, 2), parameters=False, inputs_from=0)
    assert (network.gradients == 7.0).all()


def test_one_number_as_gradient_stands_for_all_of_it():
    network, x = make(), numbers(ROWS, 3)
    network.forward(x)
    network.backward(torch.full((2, ROWS, 2), -0.25))
    expected = network.gradients.clone()
    network.gradients.zero_()
    network.backward(-0.25)
    assert torch.equal(network.gradients, expected)


@pytest.mark.parametrize("squash", [False, True])
def test_output_goes_where_it_is_asked_to_and_the_way_back_starts_there(squash):
    network, x, rows, weight = make(squash=squash), numbers(ROWS, 3), Rows.empty(1, ROWS, 3), numbers(2, ROWS, 2)
    expected = network.forward(x).clone()
    network.backward(weight)
    gradients = network.gradients.clone()
    rows.units.copy_(x)
    wide = torch.zeros(2, ROWS, 5)
    out = network.forward(rows, out=wide[..., 2:4])
    assert torch.equal(out, expected)
    assert torch.equal(wide[..., 2:4], expected)
    assert not wide[..., :2].any()
    network.gradients.zero_()
    network.backward(weight)
    assert torch.equal(network.gradients, gradients)


def test_rows_of_units_and_weights_begin_with_a_cache_line_behind_a_one():
    rows = Rows.empty(2, ROWS, 20)
    assert (rows.memory.shape[2] * 4) % 64 == 0
    assert rows.inputs.shape == (2, ROWS, 21)
    assert (rows.inputs[..., 0] == 1.0).all()
    assert (rows.units.storage_offset() - rows.memory.storage_offset()) * 4 == 64
    assert make(hidden=(20, 3)).layers[0].block.stride(1) * 4 == 128


def test_output_of_known_weights_is_the_one_worked_out_by_hand():
    network = Network(2, 1, Architecture(hidden=(2,)), generator())
    values = {"0.weight": [[1.0, -1.0], [2.0, 1.0]], "0.bias": [[0.5, -4.0]], "1.weight": [[3.0], [100.0]]}
    for name, value in (values | {"1.bias": [[-2.0]]}).items():
        network.named_parameters()[name].copy_(torch.tensor(value)[None])
    # hidden: relu(1*1 + 2*2 + 0.5) = 5.5, relu(-1 + 2 - 4) = 0; output: 3 * 5.5 - 2
    assert network.forward(torch.tensor([[1.0, 2.0]])).item() == 14.5


def test_rows_are_read_where_they_are_and_so_is_the_head_of_wider_ones():
    network, x = make(), numbers(ROWS, 3)
    whole = network.forward(x).clone()
    rows = Rows.empty(1, ROWS, 5)
    rows.units.copy_(numbers(ROWS, 5, seed=3))
    rows.head(3).units.copy_(x)
    assert torch.equal(network.forward(rows.head(3)), whole)
    rows.units.zero_()
    assert (whole != network.forward(rows.head(3))).all()


def test_same_seed_gives_the_same_weights_within_the_bound_of_the_fan_in():
    one, same, other = make(0), make(0), make(1)
    assert torch.equal(one.parameters, same.parameters)
    assert not torch.equal(one.parameters, other.parameters)
    wide = Network(4, 500, Architecture(hidden=(9,)), generator())
    for layer, fan_in in zip(wide.layers, (4, 9), strict=True):
        weight = layer.block[:, 1:]
        for each in (weight, layer.block[:, :1]):
            assert each.abs().max() <= fan_in**-0.5
    assert weight.abs().max() > 0.99 / 3.0
    assert abs(float(weight.mean())) < 0.01


def test_glorots_weights_lie_within_the_bound_of_both_fans_and_biases_begin_at_zero():
    network = Network(4, 500, Architecture(hidden=(9,), weights="glorot"), generator())
    for layer, fans in zip(network.layers, (4 + 9, 9 + 500), strict=True):
        weight, bound = layer.block[:, 1:], (6.0 / fans) ** 0.5
        assert 0.9 * bound < weight.abs().max() <= bound
        assert not layer.block[:, :1].any()
    assert abs(float(weight.mean())) < 0.01


def test_a_copy_has_the_weights_and_memory_of_its_own():
    network, x = make(), numbers(ROWS, 3)
    twin, before = network.copy(), network.forward(x).clone()
    assert torch.equal(twin.forward(x), before)
    network.parameters.add_(1.0)
    assert torch.equal(twin.forward(x), before)
    assert not torch.equal(network.forward(x), before)


def test_the_first_member_shares_its_weights():
    network, x = make(), numbers(ROWS, 3)
    first = network.first()
    assert torch.equal(first.forward(x)[0], network.forward(x)[0])
    network.parameters.mul_(0.5)
    assert torch.equal(first.forward(x)[0], network.forward(x)[0])


def test_a_backward_pass_of_the_first_member_writes_its_gradients_and_no_weight():
    network, x, weight = make(), numbers(ROWS, 3), numbers(2, ROWS, 2)
    network.forward(x)
    network.backward(weight.clone())
    before, expected = network.parameters.clone(), [each.gradient[:1].clone() for each in network.layers]
    network.gradients.zero_()
    first = network.first()
    first.forward(x)
    first.backward(weight[:1].clone())
    assert torch.equal(network.parameters, before)
    for layer, gradient in zip(network.layers, expected, strict=True):
        torch.testing.assert_close(layer.gradient[:1], gradient)
        assert not layer.gradient[1:].any()


def test_dropout_is_off_without_a_generator():
    network, x = make(dropout=0.5), numbers(ROWS, 3)
    whole = network.forward(x).clone()
    assert torch.equal(make(dropout=0.0).forward(x), whole)
    assert not torch.equal(network.forward(x, generator=generator()), whole)
    assert torch.equal(network.forward(x), whole)


def test_backward_after_a_pass_without_dropout_forgets_the_dropped_units():
    network, same, x, weight = make(dropout=0.5), make(dropout=0.0), numbers(ROWS, 3), numbers(2, ROWS, 2)
    network.forward(x, generator=generator())
    for each in (network, same):
        each.forward(x)
        each.backward(weight.clone())
    assert torch.equal(network.gradients, same.gradients)


def test_passes_on_one_input_equal_a_batch_of_it_with_the_same_dropped_units():
    network, x = make(hidden=(16, 12), dropout=0.5), numbers(3)
    batch = network.forward(x.expand(30, -1), generator=generator(3)).clone()
    torch.testing.assert_close(network.forward_once(x, 30, generator(3)), batch)
    assert len(batch[0].unique(dim=0)) > 10


def test_passes_of_a_network_without_dropout_are_all_the_same():
    network, x = make(), numbers(3)
    passes = network.forward_once(x, 4, generator())
    assert passes.shape == (2, 4, 2)
    torch.testing.assert_close(passes, network.forward(x[None]).expand(-1, 4, -1))


def test_dropout_differs_in_every_row_and_member():
    network = make(hidden=(64,), dropout=0.5)
    network.forward(torch.ones(30, 3), generator=generator())
    (mask,) = masks_of(network, 30, generator())
    assert len(mask.view(60, 64).unique(dim=0)) == 60
