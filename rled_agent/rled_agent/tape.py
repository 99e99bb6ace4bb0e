"""A pass through an ensemble, forward and back: lists of operations bound to memory that is allocated once."""

from collections.abc import Iterable, Sequence
from functools import partial

import torch
from torch import Tensor

from rled_agent.architecture import SLOPE, Architecture
from rled_agent.memory import Layer, Memory, Rows, Step

NORM_EPSILON = 1e-5
RELU_BACKWARD = torch.ops.aten.threshold_backward.grad_input
LEAKY_RELU_BACKWARD = torch.ops.aten.leaky_relu_backward.grad_input
TANH_BACKWARD = torch.ops.aten.tanh_backward.grad_input
NORM_BACKWARD = torch.ops.aten.native_layer_norm_backward


class Tape:
    """What one pass does and keeps.

    Args:
        layers: parameters.
        architecture: the hidden part.
        inputs: rows to read.
        out: memory for the output, (e, b, outputs), None to allocate it.
        squash: end in a hyperbolic tangent.

    Attributes:
        memory: where everything lies.
        out: the output, (e, b, outputs).
        masks: dropout factors of the hidden layers, (e, b, outputs), none where nothing is dropped.
        forward: operations of each layer.
        backward: operations from the gradient at the output to those of the parameters and at the first layer.
        backward_to_units: the same without the parameters.
    """

    def __init__(
        self, layers: Sequence[Layer], architecture: Architecture, inputs: Rows, out: Tensor | None, *, squash: bool
    ) -> None:
        self.memory = memory = Memory(layers, inputs, normalised=architecture.layer_norm)
        self.out = memory.linear[-1] if out is None else out
        self._squash = squash
        self.masks: list[Tensor] = []
        self._statistics: dict[int, tuple[Tensor, Tensor]] = {}
        self._at_inputs: dict[int, tuple[list[Step], Tensor]] = {}
        last = len(layers) - 1
        self.forward = [memory.outputs(k) + self._hidden(k, architecture) for k in range(last)]
        self.forward.append(memory.outputs(last))
        if squash:
            self.forward[-1].append(partial(torch.tanh, memory.linear[-1], out=self.out))
        elif out is not None:
            self.forward[-1].append(partial(out.copy_, memory.linear[-1]))
        self.backward: list[Step] = []
        self.backward_to_units: list[Step] = []
        for k in range(last, -1, -1):
            steps = self._hidden_backward(k, architecture) if k < last else []
            self.backward += steps + memory.parameter_gradients(k) + memory.unit_gradients(k)
            self.backward_to_units += steps + memory.unit_gradients(k)

    def run_forward(self, start: int = 0) -> Tensor:
        """Output of the layers from ``start`` on, (e, b, outputs)."""
        for steps in self.forward[start:]:
            run(steps)
        return self.out

    def start_backward(self, gradient: Tensor | float) -> None:
        """Bring the gradient at the output to where the first step expects it."""
        at_out = self.memory.gradients[-1]
        if isinstance(gradient, float):
            gradient = at_out.fill_(gradient)
        if self._squash:
            TANH_BACKWARD(gradient, self.out, grad_input=at_out)
        elif gradient is not at_out:
            at_out.copy_(gradient)

    def at_inputs(self, start: int) -> Tensor:
        """Gradient at the inputs from a column on, (e, b, inputs − start), after a backward pass."""
        if start not in self._at_inputs:
            self._at_inputs[start] = self.memory.input_gradients(start)
        steps, out = self._at_inputs[start]
        run(steps)
        return out

    def _hidden(self, k: int, architecture: Architecture) -> list[Step]:
        rows, slope = self.memory.hidden[k].memory, SLOPE[architecture.activation]
        steps: list[Step] = [partial(self._normalise, k)] if architecture.layer_norm else []
        steps.append(partial(torch.nn.functional.leaky_relu_, rows, slope) if slope else partial(torch.relu_, rows))
        return [*steps, partial(self._drop, k, self.memory.hidden[k].units)] if architecture.dropout else steps

    def _hidden_backward(self, k: int, architecture: Architecture) -> list[Step]:
        at, rows, slope = self.memory.slopes[k], self.memory.hidden[k].memory, SLOPE[architecture.activation]
        steps: list[Step] = [partial(self._drop, k, at.units)] if architecture.dropout else []
        if slope:
            steps.append(partial(LEAKY_RELU_BACKWARD, at.memory, rows, slope, True, grad_input=at.memory))
        else:
            steps.append(partial(RELU_BACKWARD, at.memory, rows, 0.0, grad_input=at.memory))
        return [*steps, partial(self._normalise_backward, k)] if architecture.layer_norm else steps

    def _drop(self, k: int, units: Tensor) -> None:
        if self.masks:
            units.mul_(self.masks[k])

    def _normalise(self, k: int) -> None:
        x = self.memory.linear[k]
        normalised, mean, scale = torch.native_layer_norm(x, x.shape[-1:], None, None, NORM_EPSILON)
        self._statistics[k] = mean, scale
        self.memory.hidden[k].units.copy_(normalised)

    def _normalise_backward(self, k: int) -> None:
        x, at, (mean, scale) = self.memory.linear[k], self.memory.slopes[k].units, self._statistics[k]
        at.copy_(NORM_BACKWARD(at, x, x.shape[-1:], mean, scale, None, None, [True, False, False])[0])


def run(steps: Iterable[Step]) -> None:
    """Run operations in their order, with as little Python between them as can be: it finds its caches cold."""
    for step in steps:
        step()
