"""Memory of a forward pass and its backward pass, allocated once, and the matrix products bound to it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import torch
from torch import Tensor

LINE = 16
"""Numbers in a cache line; matrix products are a twentieth faster when every row begins with one."""


def whole_lines(width: int) -> int:
    """The width rounded up to whole cache lines."""
    return -(-width // LINE) * LINE


@dataclass(frozen=True, eq=False)
class Rows:
    """Values of a layer's units in b rows, each behind a one.

    The bias of the next layer belongs to the one: so bias and bias gradient come out of the products of the weights.

    Attributes:
        memory: the rows in whole cache lines, (e, b, ...); what belongs to no unit stays 0 or 1.
        units: (e, b, width).
        inputs: the units behind their one, (e, b, 1 + width).
    """

    memory: Tensor
    units: Tensor
    inputs: Tensor

    @staticmethod
    def empty(members: int, count: int, width: int) -> "Rows":
        """Memory for ``count`` rows."""
        memory = torch.zeros(members, count, LINE + whole_lines(width))
        memory[..., LINE - 1] = 1.0
        return Rows(memory, memory[..., LINE : LINE + width], memory[..., LINE - 1 : LINE + width])

    def head(self, width: int) -> "Rows":
        """The first units of each row, in the same memory."""
        return Rows(self.memory, self.units[..., :width], self.inputs[..., : 1 + width])


class Layer(NamedTuple):
    """Views of one layer's parameters in the flat vectors, for e members; the first row of a block is the bias.

    Attributes:
        block: (e, 1 + inputs, outputs).
        gradient: like block.
    """

    block: Tensor
    gradient: Tensor


Step = Callable[[], object]
"""One operation, bound to the memory it reads and writes."""


class Memory:
    """Memory of a pass through an ensemble, for the rows it reads.

    Attributes:
        inputs: rows that the first layer reads, the same for all members.
        count: b.
        hidden: units of each hidden layer.
        linear: output of each layer; where it is not normalised, that is the memory of the units.
        slopes: gradient at the units of each hidden layer, behind ones that nobody reads.
        gradients: gradient at the output of each layer.
    """

    def __init__(self, layers: Sequence[Layer], inputs: Rows, *, normalised: bool) -> None:
        members, count = len(layers[0].block), inputs.memory.shape[1]
        widths = [layer.block.shape[2] for layer in layers]
        self.inputs, self.count, self._layers = inputs, count, layers
        self.hidden = [Rows.empty(members, count, width) for width in widths[:-1]]
        self.slopes = [Rows.empty(members, count, width) for width in widths[:-1]]
        self.linear = [torch.empty(each.units.shape) if normalised else each.units for each in self.hidden]
        self.linear.append(torch.empty(members, count, widths[-1]))
        self.gradients = [*(each.units for each in self.slopes), torch.empty_like(self.linear[-1])]

    def _read(self, k: int) -> Tensor:
        inputs = self.inputs if k == 0 else self.hidden[k - 1]
        return inputs.inputs.expand(len(self._layers[k].block), -1, -1)

    def outputs(self, k: int) -> list[Step]:
        """Products that give the output of a layer."""
        return products(self._read(k), self._layers[k].block, self.linear[k])

    def parameter_gradients(self, k: int) -> list[Step]:
        """Products that give the gradient of a layer's parameters."""
        return products(self._read(k).transpose(1, 2), self.gradients[k], self._layers[k].gradient)

    def unit_gradients(self, k: int) -> list[Step]:
        """Products that give the gradient at the units that a layer reads, none for the first layer."""
        return products(self.gradients[k], self._weights(k), self.gradients[k - 1]) if k else []

    def input_gradients(self, start: int) -> tuple[list[Step], Tensor]:
        """Products that give the gradient at the inputs from a column on, and where: (e, b, inputs − start)."""
        weights = self._weights(0)[..., start:]
        out = torch.empty(*self.gradients[0].shape[:2], weights.shape[2])
        return products(self.gradients[0], weights, out), out

    def _weights(self, k: int) -> Tensor:
        return self._layers[k].block[:, 1:].transpose(1, 2)


def products(a: Tensor, b: Tensor, out: Tensor) -> list[Step]:
    """``a @ b`` for each member; one by one, as batched products would take contiguous memory and gain nothing."""
    return [partial(torch.mm, x, y, out=z) for x, y, z in zip(a, b, out, strict=True)]
