"""Multilayer perceptrons with a backward pass of their own, in memory that is allocated once.

A gradient step on networks of this size spends as long in a general autograd's bookkeeping as in its matrix
products. Here every parameter lies in one flat vector, so that Adam and the soft update are one operation each, and
whatever happens between two products happens in place.
"""

import math
from itertools import pairwise

import torch
from rled_msgs_py.errors import RledError
from torch import Tensor

from rled_agent.architecture import MOST_WEIGHTS, Architecture, Weights
from rled_agent.dropout import Generator, dropout_masks
from rled_agent.memory import Layer, Rows, whole_lines
from rled_agent.tape import Tape, run


class Network:
    """An ensemble of e equal perceptrons that read the same input.

    Dropout has no mode that could be forgotten: it is active exactly where a generator is passed.

    Args:
        inputs: width of the input.
        outputs: width of the output.
        architecture: the hidden part.
        generator: draws the weights.
        members: e.
        squash: end in a hyperbolic tangent.

    Raises:
        RledError: more weights than ``MOST_WEIGHTS``, before any memory is taken.

    Attributes:
        parameters: all of them in one vector, with zeros that fill the rows of hidden layers to whole cache lines.
        gradients: like parameters.
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
        shapes = self._shapes()
        if sum(map(math.prod, shapes)) > MOST_WEIGHTS:
            units = " x ".join(map(str, self.sizes))
            raise RledError(f"networks of {units} units", f"{MOST_WEIGHTS:,} weights at most", "choose fewer units")
        self.parameters = torch.zeros(sum(map(math.prod, shapes)))
        self.gradients = torch.zeros_like(self.parameters)
        self.layers = [Layer(*each) for each in zip(*map(self._blocks, (self.parameters, self.gradients)), strict=True)]
        self._tapes: dict[int | Rows, Tape] = {}
        for layer in self.layers:
            _draw(layer.block, architecture.weights, generator)

    def _shapes(self) -> list[tuple[int, int, int]]:
        widths = [*map(whole_lines, self.architecture.hidden), self.sizes[-1]]
        return [(self.members, 1 + inputs, width) for inputs, width in zip(self.sizes[:-1], widths, strict=True)]

    def _blocks(self, vector: Tensor) -> list[Tensor]:
        shapes = self._shapes()
        parts = zip(vector.split([*map(math.prod, shapes)]), shapes, self.sizes[1:], strict=True)
        return [part.view(shape)[..., :width] for part, shape, width in parts]

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
        view.layers = [Layer(each.block[:1], each.gradient[:1]) for each in self.layers]
        view._tapes = {}
        return view

    def named_parameters(self) -> dict[str, Tensor]:
        """Views by name: ``0.weight`` of shape (e, inputs, outputs), ``0.bias`` of shape (e, 1, outputs), ..."""
        parts: dict[str, Tensor] = {}
        for k, layer in enumerate(self.layers):
            parts |= {f"{k}.weight": layer.block[:, 1:], f"{k}.bias": layer.block[:, :1]}
        return parts

    def forward(self, x: Tensor | Rows, generator: Generator | None = None, out: Tensor | None = None) -> Tensor:
        """Output for a batch, in memory that the next call with as many rows overwrites.

        Args:
            x: the input, (b, inputs), which is copied, or rows of it, which are read where they are.
            generator: drops hidden units independently in every row.
            out: where the output of these rows goes from their first pass on, (e, b, outputs).

        Returns:
            Shape (e, b, outputs).
        """
        if isinstance(x, Rows):
            tape = self._tape(x, out)
        else:
            tape = self._tape(x.shape[0], out)
            tape.memory.inputs.units.copy_(x)
        tape.masks = self._masks(tape.memory.count, generator) if generator is not None else []
        return tape.run_forward()

    def forward_once(self, x: Tensor, passes: int, generator: Generator) -> Tensor:
        """Outputs of stochastic passes on one input, whose first layer is computed once; no backward pass follows.

        Args:
            x: the input, (inputs,).
            passes: number of them.
            generator: drops hidden units independently in every pass.

        Returns:
            Shape (e, passes, outputs); as of ``forward`` with as many equal rows.
        """
        masks = self._masks(passes, generator)
        if not masks:
            return self.forward(x[None]).expand(-1, passes, -1)
        alone, tape = self._tape(1), self._tape(passes)
        alone.memory.inputs.units.copy_(x)
        alone.masks, tape.masks = [], masks
        run(alone.forward[0])
        torch.mul(alone.memory.hidden[0].units, masks[0], out=tape.memory.hidden[0].units)
        return tape.run_forward(1)

    def _tape(self, key: int | Rows, out: Tensor | None = None) -> Tape:
        if key not in self._tapes:
            rows = key if isinstance(key, Rows) else Rows.empty(1, key, self.sizes[0])
            self._tapes[key] = Tape(self.layers, self.architecture, rows, out, squash=self.squash)
        self._last = self._tapes[key]
        return self._last

    def _masks(self, rows: int, generator: Generator) -> list[Tensor]:
        """Dropout factors of each hidden layer, (e, rows, outputs); none of a network without dropout."""
        if not self.architecture.dropout:
            return []
        shapes = [(self.members, rows, width) for width in self.architecture.hidden]
        return dropout_masks(shapes, self.architecture.dropout, generator)

    def backward(
        self, gradient: Tensor | float, *, parameters: bool = True, inputs_from: int | None = None
    ) -> Tensor | None:
        """Propagate the gradient of a loss back through the last forward pass.

        Args:
            gradient: of the loss at the output, (e, b, outputs), or one number for all of it.
            parameters: write ``gradients``.
            inputs_from: also return the gradient at the inputs from this column on.

        Returns:
            The gradient at the inputs, (e, b, inputs − inputs_from), or None.
        """
        tape = self._last
        tape.start_backward(gradient)
        run(tape.backward if parameters else tape.backward_to_units)
        return None if inputs_from is None else tape.at_inputs(inputs_from)


def parameter_shapes(inputs: int, outputs: int, architecture: Architecture) -> dict[str, tuple[int, ...]]:
    """Shapes of ``named_parameters`` of a network of one member, which is not made for it."""
    sizes = (inputs, *architecture.hidden, outputs)
    shapes: dict[str, tuple[int, ...]] = {}
    for k, (before, after) in enumerate(pairwise(sizes)):
        shapes |= {f"{k}.weight": (1, before, after), f"{k}.bias": (1, 1, after)}
    return shapes


def _draw(block: Tensor, way: Weights, generator: torch.Generator) -> None:
    """Begin with random weights."""
    fan_in, fan_out = block.shape[1] - 1, block.shape[2]
    bound, parts = 1.0 / math.sqrt(fan_in), [block[:, 1:], block[:, :1]]
    if way == "glorot":
        bound, parts = math.sqrt(6.0 / (fan_in + fan_out)), [block[:, 1:]]
    for part in parts:
        part.copy_(torch.empty(part.shape).uniform_(-bound, bound, generator=generator))
