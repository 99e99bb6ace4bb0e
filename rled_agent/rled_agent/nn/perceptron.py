"""Multilayer perceptrons with a leading population dimension."""

import copy
import math
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError
from torch import Tensor, nn
from torch.nn import functional

from rled_agent.nn.architecture import MAX_WEIGHTS, SLOPE, Architecture, Weights
from rled_agent.nn.dropout import Generator, dropout_masks


class Perceptron(nn.Module):
    """A population of e equal perceptrons, each with weights of its own: an ensemble of critics, or seeds side by side.

    All members are one batched product a layer, so e small networks take little longer than one. Dropout has no mode
    that could be forgotten: it is active exactly where a generator is passed.

    Args:
        inputs: width of the input.
        outputs: width of the output.
        architecture: the hidden part.
        generator: draws the weights.
        members: e.
        squash: end in a hyperbolic tangent.

    Raises:
        RledError: more weights than ``MAX_WEIGHTS``, before any memory is taken.

    Attributes:
        weights: of each layer, (e, inputs, outputs).
        biases: of each layer, (e, 1, outputs).
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
        super().__init__()
        self.architecture, self.members, self.squash = architecture, members, squash
        self.sizes = (inputs, *architecture.hidden, outputs)
        shapes = list(pairwise(self.sizes))
        if members * sum((fan_in + 1) * fan_out for fan_in, fan_out in shapes) > MAX_WEIGHTS:
            units = " x ".join(map(str, self.sizes))
            raise RledError(f"networks of {units} units", f"{MAX_WEIGHTS:,} weights at most", "choose fewer units")
        drawn = [_drawn(members, *shape, architecture.weights, generator) for shape in shapes]
        self.weights = nn.ParameterList(weight for weight, _ in drawn)
        self.biases = nn.ParameterList(bias for _, bias in drawn)
        self._layers = tuple(drawn)  # a ParameterList is looked through by name, slowly

    def frozen(self) -> "Perceptron":
        """A copy of the same weights that no gradient reaches: a target network (Eq. 4.3)."""
        return copy.deepcopy(self).requires_grad_(False)

    def first(self) -> "Perceptron":
        """The first member alone; it shares its weights, and a gradient passes through it without reaching them."""
        view = copy.copy(self)
        view.members, view._modules = 1, {}
        for name, parameters in (("weights", self.weights), ("biases", self.biases)):
            view.add_module(name, nn.ParameterList(nn.Parameter(each[:1].detach(), False) for each in parameters))
        view._layers = tuple(zip(view.weights, view.biases, strict=True))
        return view

    @torch.no_grad()
    def vector(self) -> NDArray[np.float32]:
        """All weights and biases as one vector."""
        return torch.cat([each.flatten() for each in self.parameters()]).cpu().numpy()

    @torch.no_grad()
    def load_vector(self, vector: NDArray[np.float32]) -> None:
        """Take the weights and biases that ``vector`` gave."""
        parameters = [*self.parameters()]
        parts = torch.from_numpy(vector).split([each.numel() for each in parameters])
        for parameter, part in zip(parameters, parts, strict=True):
            parameter.copy_(part.view_as(parameter))

    def forward(self, x: Tensor, generator: Generator | None = None) -> Tensor:
        """Output for a batch.

        Args:
            x: the same rows for all members, (b, inputs), or rows for each, (e, b, inputs).
            generator: drops hidden units independently in every row.

        Returns:
            Shape (e, b, outputs).
        """
        masks = self._masks(x.shape[-2], generator)
        return self._rest(self._first_layer(x), masks)

    def forward_once(self, x: Tensor, passes: int, generator: Generator) -> Tensor:
        """Outputs of stochastic passes on one input, whose first layer is computed once.

        Args:
            x: the input, (inputs,).
            passes: number of them.
            generator: drops hidden units independently in every pass.

        Returns:
            Shape (e, passes, outputs); as of ``forward`` with as many equal rows.
        """
        masks = self._masks(passes, generator)
        output = self._rest(self._first_layer(x[None]), masks)
        return output if masks else output.expand(-1, passes, -1)

    def _first_layer(self, x: Tensor) -> Tensor:
        weight, bias = self._layers[0]
        return torch.baddbmm(bias, x.expand(self.members, -1, -1), weight)

    def _rest(self, x: Tensor, masks: list[Tensor]) -> Tensor:
        """From the linear output of the first layer, (e, b, outputs) or with one row for all of the masks, on."""
        slope, normalised = SLOPE[self.architecture.activation], self.architecture.layer_norm
        for k, (weight, bias) in enumerate(self._layers[1:]):
            if normalised:
                x = functional.layer_norm(x, x.shape[-1:])
            x = functional.leaky_relu(x, slope, inplace=True) if slope else functional.relu(x, inplace=True)
            if masks:
                x = x * masks[k]
            x = torch.baddbmm(bias, x, weight)
        return torch.tanh(x) if self.squash else x

    def _masks(self, rows: int, generator: Generator | None) -> list[Tensor]:
        """Dropout factors of each hidden layer, (e, rows, outputs); none where nothing is dropped."""
        if generator is None or not self.architecture.dropout:
            return []
        shapes = [(self.members, rows, width) for width in self.architecture.hidden]
        return [mask.to(self._layers[0][0]) for mask in dropout_masks(shapes, self.architecture.dropout, generator)]


def parameter_shapes(
    inputs: int, outputs: int, architecture: Architecture, members: int = 1
) -> dict[str, tuple[int, ...]]:
    """Shapes of the parameters, by name, of a perceptron, which is not made for it."""
    shapes: dict[str, tuple[int, ...]] = {}
    for k, (before, after) in enumerate(pairwise((inputs, *architecture.hidden, outputs))):
        shapes |= {f"weights.{k}": (members, before, after), f"biases.{k}": (members, 1, after)}
    return shapes


def _drawn(
    members: int, fan_in: int, fan_out: int, scheme: Weights, generator: torch.Generator
) -> tuple[nn.Parameter, nn.Parameter]:
    """Random weights and biases of one layer."""
    weight, bias = (
        torch.zeros(members, *shape, device=generator.device) for shape in ((fan_in, fan_out), (1, fan_out))
    )
    if scheme == "glorot":
        bound = math.sqrt(6.0 / (fan_in + fan_out))
        weight.uniform_(-bound, bound, generator=generator)
    else:
        bound = 1.0 / math.sqrt(fan_in)
        weight.uniform_(-bound, bound, generator=generator)
        bias.uniform_(-bound, bound, generator=generator)
    return nn.Parameter(weight), nn.Parameter(bias)
