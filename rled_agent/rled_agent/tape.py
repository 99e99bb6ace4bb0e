"""Memory of a forward pass and its backward pass, allocated once and cut into the operands of the matrix products."""

from collections.abc import Sequence
from dataclasses import dataclass
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


class Product(NamedTuple):
    """``a @ b``, written to ``out``."""

    a: Tensor
    b: Tensor
    out: Tensor


def multiply(products: Sequence[Product]) -> None:
    """Compute products; one by one, as batched ones would take contiguous memory and gain nothing."""
    for a, b, out in products:
        torch.mm(a, b, out=out)


class Tape:
    """What one pass through an ensemble keeps, for the rows it reads.

    Attributes:
        inputs: rows that the first layer reads, the same for all members.
        count: b.
        hidden: units of each hidden layer.
        linear: output of each layer; where it is not normalised, that is the memory of the units.
        gradients: gradient at the output of each layer; of a hidden one, its units have ones that nobody reads.
        masks: dropout factors of the hidden layers, (e, b, outputs), none where nothing is dropped.
        statistics: mean and reciprocal deviation of the hidden layers that are normalised.
        forward: products of each layer's output.
        to_parameters: products of each layer's parameter gradient.
        to_units: products of the gradient at each layer's input units, none for the first layer.
    """

    def __init__(self, layers: Sequence[Layer], inputs: Rows, *, normalised: bool) -> None:
        members, count = len(layers[0].block), inputs.memory.shape[1]
        widths = [layer.block.shape[2] for layer in layers]
        self.inputs, self.count = inputs, count
        self.hidden = [Rows.empty(members, count, width) for width in widths[:-1]]
        self.slopes = [Rows.empty(members, count, width) for width in widths[:-1]]
        units = [rows.units for rows in self.hidden]
        self.linear = [torch.empty(each.shape) if normalised else each for each in units]
        self.linear.append(torch.empty(members, count, widths[-1]))
        self.gradients = [*(rows.units for rows in self.slopes), torch.empty_like(self.linear[-1])]
        self.masks: list[Tensor] = []
        self.statistics: list[tuple[Tensor, Tensor]] = []
        read = [inputs.inputs.expand(members, -1, -1), *(rows.inputs for rows in self.hidden)]
        blocks = [layer.block for layer in layers]
        self.forward = _products(read, blocks, self.linear)
        transposed = [each.transpose(1, 2) for each in read]
        self.to_parameters = _products(transposed, self.gradients, [layer.gradient for layer in layers])
        weights = [block[:, 1:].transpose(1, 2) for block in blocks]
        self.to_units = _products(self.gradients, weights, [None, *self.gradients[:-1]])


def _products(a: Sequence[Tensor], b: Sequence[Tensor], out: Sequence[Tensor | None]) -> list[list[Product]]:
    """The members' products of each layer."""
    layers = zip(a, b, out, strict=True)
    return [[] if z is None else [Product(*each) for each in zip(x, y, z, strict=True)] for x, y, z in layers]
