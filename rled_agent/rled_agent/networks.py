"""Multilayer perceptrons with a backward pass of their own, in memory that is allocated once.

A gradient step on networks of this size spends as long in a general autograd's bookkeeping as in its matrix
products. Here every parameter lies in one flat vector, so that Adam and the soft update are one operation each,
and an ensemble (the twin critics of Eq. 4.2) is one batched product per layer.
"""

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

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


@dataclass
class Layer:
    """Views of one layer's parameters and gradients in the flat vectors, for e members.

    Attributes:
        weight: (e, inputs, outputs).
        bias: (e, 1, outputs).
        weight_gradient: like weight.
        bias_gradient: like bias.
    """

    weight: Tensor
    bias: Tensor
    weight_gradient: Tensor
    bias_gradient: Tensor


@dataclass
class Tape:
    """What one forward pass leaves for its backward pass, for b rows.

    Attributes:
        inputs: input of each layer, (e, b, inputs); that of a hidden layer is the activation before it.
        linear: output of each layer before norm and activation, (e, b, outputs); without a norm, which alone needs it
            again, the activation is written over it.
        gradients: memory for the gradient at each layer's output, (e, b, outputs).
        masks: dropout factors of the hidden layers, (e, b, outputs), none where nothing was dropped.
        statistics: mean and reciprocal deviation of the hidden layers that are normalised.
    """

    inputs: list[Tensor]
    linear: list[Tensor]
    gradients: list[Tensor]
    masks: list[Tensor] = field(default_factory=list)
    statistics: list[tuple[Tensor, Tensor]] = field(default_factory=list)


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
            bound = 1.0 / math.sqrt(layer.weight.shape[1])
            layer.weight.uniform_(-bound, bound, generator=generator)
            layer.bias.uniform_(-bound, bound, generator=generator)

    def _views(self) -> list[Layer]:
        layers, start = [], 0
        for inputs, outputs in pairwise(self.sizes):
            views = []
            for rows in (inputs, 1):
                end = start + self.members * rows * outputs
                shape = (self.members, rows, outputs)
                views += [self.parameters[start:end].view(shape), self.gradients[start:end].view(shape)]
                start = end
            weight, weight_gradient, bias, bias_gradient = views
            layers.append(Layer(weight, bias, weight_gradient, bias_gradient))
        return layers

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
        view.layers = [
            Layer(each.weight[:1], each.bias[:1], each.weight_gradient[:1], each.bias_gradient[:1])
            for each in self.layers
        ]
        view._tapes = {}
        return view

    def named_parameters(self) -> dict[str, Tensor]:
        """Views by name: ``0.weight`` of shape (e, inputs, outputs), ``0.bias`` of shape (e, 1, outputs), ..."""
        return {
            f"{k}.{kind}": getattr(layer, kind) for k, layer in enumerate(self.layers) for kind in ("weight", "bias")
        }

    def _tape(self, rows: int) -> Tape:
        if rows not in self._tapes:
            linear = [torch.empty(self.members, rows, width) for width in self.sizes[1:]]
            hidden = [torch.empty_like(each) if self.architecture.layer_norm else each for each in linear[:-1]]
            first = torch.empty(self.members, rows, self.sizes[0])
            self._tapes[rows] = Tape([first, *hidden], linear, [torch.empty_like(each) for each in linear])
        return self._tapes[rows]

    def forward(self, *parts: Tensor, generator: torch.Generator | None = None) -> Tensor:
        """Output for a batch, in memory that the next call with as many rows overwrites.

        Args:
            parts: columns of the input, (b, ...) each.
            generator: drops hidden units independently in every row.

        Returns:
            Shape (e, b, outputs).
        """
        tape = self._tape(len(parts[0]))
        torch.cat([part.expand(self.members, -1, -1) for part in parts], dim=2, out=tape.inputs[0])
        tape.masks.clear()
        tape.statistics.clear()
        last = len(self.layers) - 1
        for k, layer in enumerate(self.layers):
            torch.baddbmm(layer.bias, tape.inputs[k], layer.weight, out=tape.linear[k])
            if k < last:
                self._hidden(tape, k, generator)
        out = tape.linear[last]
        return out.tanh_() if self.squash else out

    def _hidden(self, tape: Tape, k: int, generator: torch.Generator | None) -> None:
        x, out = tape.linear[k], tape.inputs[k + 1]
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
                torch.bmm(tape.inputs[k].transpose(1, 2), gradient, out=layer.weight_gradient)
                torch.sum(gradient, dim=1, keepdim=True, out=layer.bias_gradient)
            if k > 0:
                before = torch.bmm(gradient, layer.weight.transpose(1, 2), out=tape.gradients[k - 1])
                gradient = self._hidden_backward(tape, k - 1, before)
        if inputs_from is None:
            return None
        return torch.bmm(gradient, self.layers[0].weight[:, inputs_from:].transpose(1, 2))

    def _hidden_backward(self, tape: Tape, k: int, gradient: Tensor) -> Tensor:
        if tape.masks:
            gradient.mul_(tape.masks[k])
        slope = SLOPE[self.architecture.activation]
        if slope:
            torch.ops.aten.leaky_relu_backward.grad_input(
                gradient, tape.inputs[k + 1], slope, True, grad_input=gradient
            )
        else:
            torch.ops.aten.threshold_backward.grad_input(gradient, tape.inputs[k + 1], 0.0, grad_input=gradient)
        if self.architecture.layer_norm:
            x, (mean, scale) = tape.linear[k], tape.statistics[k]
            gradient, _, _ = torch.ops.aten.native_layer_norm_backward(
                gradient, x, x.shape[-1:], mean, scale, None, None, [True, False, False]
            )
        return gradient


def dropout_mask(shape: tuple[int, ...], probability: float, generator: torch.Generator) -> Tensor:
    """Inverted dropout: 0 with ``probability``, else the reciprocal of the probability to stay.

    Four units share one 64-bit draw, several times faster than a Bernoulli draw each; the probability is met to 2⁻¹⁶.
    """
    count = math.prod(shape)
    draws = torch.empty((count + 3) // 4, dtype=torch.int64).random_(-(2**63), None, generator=generator)
    dropped = round(probability * 2**16)
    kept = draws.view(torch.int16)[:count] >= dropped - 2**15
    return kept.to(torch.float32).mul_(2**16 / (2**16 - dropped)).view(shape)
