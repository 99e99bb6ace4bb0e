"""Multilayer perceptrons with a backward pass of their own, in memory that is allocated once.

A gradient step on networks of this size spends as long in a general autograd's bookkeeping as in its matrix
products. Here every parameter lies in one flat vector, so that Adam and the soft update are one operation each,
and an ensemble (the twin critics of Eq. 4.2) is one batched product per layer.
"""

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal, NamedTuple

import torch
from torch import Tensor

Activation = Literal["relu", "leaky_relu"]
SLOPE: dict[Activation, float] = {"relu": 0.0, "leaky_relu": 0.01}
NORM_EPSILON = 1e-5


@dataclass(frozen=True)
class Architecture:
    """The hidden part of a network.

    Attributes:
        hidden: widths of the hidden layers.
        activation: after each hidden layer.
        dropout: probability that a hidden unit is dropped, where dropout is asked for.
        layer_norm: normalise each hidden layer, without gain and shift, before its activation.
    """

    hidden: tuple[int, ...] = (400, 300)
    activation: Activation = "relu"
    dropout: float = 0.0
    layer_norm: bool = False


class Layer(NamedTuple):
    """Views of one layer's parameters in the flat vectors, for e members; the last row of a block is the bias.

    Attributes:
        block: (e, inputs + 1, outputs).
        gradient: like block.
        weight_transposed: the block without its bias, (e, outputs, inputs).
    """

    block: Tensor
    gradient: Tensor
    weight_transposed: Tensor


@dataclass
class Tape:
    """Memory of one forward pass and its backward pass, for b rows.

    The input of every layer ends in a column of ones, which the bias belongs to: so bias and bias gradient come out of
    the same products as the weights.

    Attributes:
        inputs: input of each layer, (e, b, inputs + 1); that of a hidden layer is the activation before it.
        units: the same without the ones, (e, b, inputs).
        transposed: inputs, (e, inputs + 1, b).
        linear: output of each layer before norm and activation, (e, b, outputs).
        gradients: gradient at each layer's output, (e, b, outputs).
        masks: dropout factors of the hidden layers, (e, b, outputs), none where nothing was dropped.
        statistics: mean and reciprocal deviation of the hidden layers that are normalised.
    """

    inputs: list[Tensor]
    units: list[Tensor]
    transposed: list[Tensor]
    linear: list[Tensor]
    gradients: list[Tensor]
    masks: list[Tensor] = field(default_factory=list)
    statistics: list[tuple[Tensor, Tensor]] = field(default_factory=list)


def _tape(members: int, rows: int, sizes: tuple[int, ...]) -> Tape:
    inputs = [torch.ones(members, rows, width + 1) for width in sizes[:-1]]
    linear = [torch.empty(members, rows, width) for width in sizes[1:]]
    units, transposed = [each[..., :-1] for each in inputs], [each.transpose(1, 2) for each in inputs]
    return Tape(inputs, units, transposed, linear, [torch.empty_like(each) for each in linear])


class Network:
    """An ensemble of e equal perceptrons that read the same input.

    Dropout has no mode that could be forgotten: it is active exactly where a generator is passed.

    Args:
        inputs: width of the input.
        outputs: width of the output.
        architecture: the hidden part.
        generator: draws weights and biases uniformly in ±1/√fan-in.
        members: e.
        squash: end in a hyperbolic tangent.
    """

    def __init__(
        self,
        inputs: int,
        outputs: int,
        architecture: Architecture,
        generator: torch.Generator,
        *,
        members: int = 1,
        squash: bool = False,
    ) -> None:
        self.architecture, self.squash, self.members = architecture, squash, members
        self.sizes = (inputs, *architecture.hidden, outputs)
        count = members * sum((a + 1) * b for a, b in pairwise(self.sizes))
        self.parameters = torch.zeros(count)
        self.gradients = torch.zeros(count)
        self.layers = self._views()
        self._tapes: dict[int, Tape] = {}
        for layer in self.layers:
            bound = 1.0 / math.sqrt(layer.block.shape[1] - 1)
            for part in (layer.block[:, :-1], layer.block[:, -1:]):
                part.copy_(torch.empty(part.shape).uniform_(-bound, bound, generator=generator))

    def _views(self) -> list[Layer]:
        shapes = [(self.members, inputs + 1, outputs) for inputs, outputs in pairwise(self.sizes)]
        sizes = [math.prod(shape) for shape in shapes]
        blocks = [part.view(shape) for part, shape in zip(self.parameters.split(sizes), shapes, strict=True)]
        gradients = [part.view(shape) for part, shape in zip(self.gradients.split(sizes), shapes, strict=True)]
        return [_layer(block, gradient) for block, gradient in zip(blocks, gradients, strict=True)]

    def copy(self) -> "Network":
        """A network of the same weights with memory of its own: a target network (Eq. 4.3)."""
        twin = Network(
            self.sizes[0],
            self.sizes[-1],
            self.architecture,
            torch.Generator(),
            members=self.members,
            squash=self.squash,
        )
        twin.parameters.copy_(self.parameters)
        return twin

    def first(self) -> "Network":
        """The first member alone, sharing its weights and the memory of their gradients."""
        view = object.__new__(Network)
        view.architecture, view.squash, view.members, view.sizes = self.architecture, self.squash, 1, self.sizes
        view.parameters, view.gradients = self.parameters, self.gradients
        view.layers = [_layer(each.block[:1], each.gradient[:1]) for each in self.layers]
        view._tapes = {}
        return view

    def named_parameters(self) -> dict[str, Tensor]:
        """Views by name: ``0.weight`` of shape (e, inputs, outputs), ``0.bias`` of shape (e, 1, outputs), ..."""
        parts: dict[str, Tensor] = {}
        for k, layer in enumerate(self.layers):
            parts |= {f"{k}.weight": layer.block[:, :-1], f"{k}.bias": layer.block[:, -1:]}
        return parts

    def forward(self, *parts: Tensor, generator: torch.Generator | None = None) -> Tensor:
        """Output for a batch, in memory that the next call with as many rows overwrites.

        Args:
            parts: columns of the input, (b, ...) each.
            generator: drops hidden units independently in every row.

        Returns:
            Shape (e, b, outputs).
        """
        tape = self._tape(len(parts[0]))
        start = 0
        for part in parts:
            tape.units[0][..., start : start + part.shape[-1]] = part
            start += part.shape[-1]
        tape.masks.clear()
        tape.statistics.clear()
        for k, layer in enumerate(self.layers):
            _multiply(tape.inputs[k], layer.block, tape.linear[k])
            if k + 1 < len(self.layers):
                self._hidden(tape, k, generator)
        return tape.linear[-1].tanh_() if self.squash else tape.linear[-1]

    def _tape(self, rows: int) -> Tape:
        if rows not in self._tapes:
            self._tapes[rows] = _tape(self.members, rows, self.sizes)
        return self._tapes[rows]

    def _hidden(self, tape: Tape, k: int, generator: torch.Generator | None) -> None:
        x, out = tape.linear[k], tape.units[k + 1]
        if self.architecture.layer_norm:
            x, mean, scale = torch.native_layer_norm(x, x.shape[-1:], None, None, NORM_EPSILON)
            tape.statistics.append((mean, scale))
        if self.architecture.activation == "relu":
            torch.clamp_min(x, 0.0, out=out)
        else:
            torch.ops.aten.leaky_relu.out(x, SLOPE[self.architecture.activation], out=out)
        if generator is not None and self.architecture.dropout:
            mask = dropout_mask(tuple(out.shape), self.architecture.dropout, generator)
            tape.masks.append(mask)
            out.mul_(mask)

    def backward(self, gradient: Tensor, *, parameters: bool = True, inputs_from: int | None = None) -> Tensor | None:
        """Propagate the gradient of a loss back through the last forward pass of as many rows.

        Args:
            gradient: of the loss at the output, (e, b, outputs).
            parameters: write ``gradients``.
            inputs_from: also return the gradient at the inputs from this column on.

        Returns:
            The gradient at the inputs, (e, b, inputs − inputs_from), or None.
        """
        tape = self._tape(gradient.shape[1])
        if self.squash:
            out = tape.linear[-1]
            gradient = torch.ops.aten.tanh_backward.grad_input(gradient, out, grad_input=tape.gradients[-1])
        for k in range(len(self.layers) - 1, -1, -1):
            layer = self.layers[k]
            if parameters:
                _multiply(tape.transposed[k], gradient, layer.gradient)
            if k > 0:
                before = torch.bmm(gradient, layer.weight_transposed, out=tape.gradients[k - 1])
                gradient = self._hidden_backward(tape, k - 1, before)
        if inputs_from is None:
            return None
        return torch.bmm(gradient, self.layers[0].weight_transposed[..., inputs_from:])

    def _hidden_backward(self, tape: Tape, k: int, gradient: Tensor) -> Tensor:
        if tape.masks:
            gradient.mul_(tape.masks[k])
        slope = SLOPE[self.architecture.activation]
        if slope:
            torch.ops.aten.leaky_relu_backward.grad_input(gradient, tape.units[k + 1], slope, True, grad_input=gradient)
        else:
            torch.ops.aten.threshold_backward.grad_input(gradient, tape.units[k + 1], 0.0, grad_input=gradient)
        if self.architecture.layer_norm:
            x, (mean, scale) = tape.linear[k], tape.statistics[k]
            gradient, _, _ = torch.ops.aten.native_layer_norm_backward(
                gradient, x, x.shape[-1:], mean, scale, None, None, [True, False, False]
            )
        return gradient


def _multiply(a: Tensor, b: Tensor, out: Tensor) -> None:
    """Batched product; a single column, as a critic's last layer has it, is quicker member by member."""
    if out.shape[-1] > 1:
        torch.bmm(a, b, out=out)
        return
    for member in range(len(out)):
        torch.mm(a[member], b[member], out=out[member])


def _layer(block: Tensor, gradient: Tensor) -> Layer:
    return Layer(block, gradient, block[:, :-1].transpose(1, 2))


def dropout_mask(shape: tuple[int, ...], probability: float, generator: torch.Generator) -> Tensor:
    """Inverted dropout: 0 with ``probability``, else the reciprocal of the probability to stay.

    Four units share one 64-bit draw, several times faster than a Bernoulli draw each; the probability is met to 2⁻¹⁶.
    """
    count = math.prod(shape)
    draws = torch.empty((count + 3) // 4, dtype=torch.int64).random_(-(2**63), None, generator=generator)
    dropped = round(probability * 2**16)
    kept = draws.view(torch.int16)[:count] >= dropped - 2**15
    return kept.to(torch.float32).mul_(2**16 / (2**16 - dropped)).view(shape)
