"""Multilayer perceptrons with a leading dimension of seeds and ensembles."""

import copy
import math
import os
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError
from torch import Tensor, nn
from torch.nn import functional

from rled_agent.nn.architecture import MAX_WEIGHTS, SLOPE, Architecture, Weights
from rled_agent.nn.draws import Draws

# MKL rounds by where a matrix lies in memory unless told otherwise before its first product: a seed's numbers would
# depend on how many lie before it
os.environ.setdefault("MKL_CBWR", "AUTO,STRICT")


class Perceptron(nn.Module):
    """An ensemble of e equal perceptrons for each of P seeds, each with weights of its own.

    All P e members are one batched product a layer, so that many small networks take little longer than one. Dropout
    has no mode that could be forgotten: it is active exactly where draws are passed.

    Args:
        inputs: width of the input.
        outputs: width of the output.
        architecture: the hidden part.
        draws: draws the weights, of its population P.
        ensemble: e.
        squash: end in a hyperbolic tangent.

    Raises:
        RledError: more weights than ``MAX_WEIGHTS`` for a seed, before any memory is taken.

    Attributes:
        weights: of each layer, (P e, inputs, outputs); the ensemble of a seed lies together.
        biases: of each layer, (P e, 1, outputs).
    """

    def __init__(
        self,
        inputs: int,
        outputs: int,
        architecture: Architecture,
        draws: Draws,
        *,
        ensemble: int = 1,
        squash: bool = False,
    ) -> None:
        super().__init__()
        self.architecture, self.ensemble, self.squash = architecture, ensemble, squash
        self.sizes = (inputs, *architecture.hidden, outputs)
        shapes = list(pairwise(self.sizes))
        if ensemble * sum((fan_in + 1) * fan_out for fan_in, fan_out in shapes) > MAX_WEIGHTS:
            units = " x ".join(map(str, self.sizes))
            raise RledError(f"networks of {units} units", f"{MAX_WEIGHTS:,} weights at most", "choose fewer units")
        self._hold([_drawn(ensemble, *shape, architecture.weights, draws) for shape in shapes])

    def _hold(self, layers: Sequence[tuple[nn.Parameter, nn.Parameter]]) -> None:
        self.weights = nn.ParameterList(weight for weight, _ in layers)
        self.biases = nn.ParameterList(bias for _, bias in layers)
        self._layers = tuple(layers)  # a ParameterList is looked through by name, slowly
        self.members = len(layers[0][0])
        self.population = self.members // self.ensemble

    def frozen(self) -> "Perceptron":
        """A copy of the same weights that no gradient reaches: a target network (Eq. 4.3)."""
        return copy.deepcopy(self).requires_grad_(False)

    def first(self) -> "Perceptron":
        """The first of each ensemble; it shares its weights, and a gradient passes through it without reaching them."""
        return self._part(lambda each: each[:: self.ensemble], 1)

    def member(self, seed: int) -> "Perceptron":
        """The networks of one seed, 0 to P - 1; they share their weights, and no gradient reaches them."""
        return self._part(lambda each: each[seed * self.ensemble : (seed + 1) * self.ensemble], self.ensemble)

    def _part(self, chosen: Callable[[Tensor], Tensor], ensemble: int) -> "Perceptron":
        return self._of([(chosen(weight), chosen(bias)) for weight, bias in self._layers], ensemble)

    def _of(self, layers: Sequence[tuple[Tensor, Tensor]], ensemble: int) -> "Perceptron":
        """The same with other weights, which no gradient reaches."""
        other = copy.copy(self)
        other.ensemble, other._modules = ensemble, {}
        other._hold([(nn.Parameter(w.detach(), False), nn.Parameter(b.detach(), False)) for w, b in layers])
        return other

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

    def forward(self, x: Tensor, draws: Draws | None = None) -> Tensor:
        """Output for a batch.

        Args:
            x: the same rows for all members, (b, inputs), or rows for each seed, (P, b, inputs).
            draws: drops hidden units independently in every row.

        Returns:
            Shape (P e, b, outputs).
        """
        masks = self._masks(x.shape[-2], draws)
        return self._rest(self._first_layer(x), masks)

    def forward_once(self, x: Tensor, passes: int, draws: Draws) -> Tensor:
        """Outputs of stochastic passes on one input of each seed, whose first layer is computed once.

        Args:
            x: the inputs, (P, inputs).
            passes: number of them.
            draws: drops hidden units independently in every pass.

        Returns:
            Shape (P e, passes, outputs); as of ``forward`` with as many equal rows.
        """
        masks = self._masks(passes, draws)
        output = self._rest(self._first_layer(x[:, None]), masks)
        return output if masks else output.expand(-1, passes, -1)

    def _first_layer(self, x: Tensor) -> Tensor:
        weight, bias = self._layers[0]
        if x.ndim == 2:
            x = x.expand(self.members, -1, -1)
        elif self.ensemble > 1:
            x = x[:, None].expand(-1, self.ensemble, -1, -1).flatten(0, 1)
        return self._product(x, weight, bias)

    def _rest(self, x: Tensor, masks: list[Tensor]) -> Tensor:
        """From the linear output of the first layer, (P e, b, outputs) or with one row for all of the masks, on."""
        slope, normalised = SLOPE[self.architecture.activation], self.architecture.layer_norm
        for k, (weight, bias) in enumerate(self._layers[1:]):
            if normalised:
                x = functional.layer_norm(x, x.shape[-1:])
            x = functional.leaky_relu(x, slope, inplace=True) if slope else functional.relu(x, inplace=True)
            if masks:
                x = x * masks[k]
            x = self._product(x, weight, bias)
        return torch.tanh(x) if self.squash else x

    def _product(self, x: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
        if self.ensemble == 1 and weight.shape[2] == 1:
            # a single matrix by a vector is summed in another order than several: one would differ from one of many
            return (x * weight.transpose(1, 2)).sum(dim=2, keepdim=True) + bias
        return torch.baddbmm(bias, x, weight)

    def _masks(self, rows: int, draws: Draws | None) -> list[Tensor]:
        """Dropout factors of each hidden layer, (P e, rows, outputs); none where nothing is dropped."""
        probability, hidden = self.architecture.dropout, self.architecture.hidden
        if draws is None or not probability:
            return []
        units = [self.ensemble * rows * width for width in hidden]
        factors = draws.kept(probability, sum(units)).to(self._layers[0][0]).split(units, dim=1)
        return [each.reshape(self.members, rows, width) for each, width in zip(factors, hidden, strict=True)]


def joined(networks: Sequence[Perceptron]) -> Perceptron:
    """Equal perceptrons of several seeds as one population; no gradient reaches them.

    Raises:
        RledError: they are of other shapes.
    """
    first, *others = networks
    shape = first.architecture, first.sizes, first.ensemble, first.squash
    for each in others:
        if (each.architecture, each.sizes, each.ensemble, each.squash) != shape:
            raise RledError("networks of several shapes", "one shape for all seeds", "clone the experts alike")
    if not others:
        return first
    layers = [[*zip(*layer, strict=True)] for layer in zip(*(each._layers for each in networks), strict=True)]
    return first._of([(torch.cat(weights), torch.cat(biases)) for weights, biases in layers], first.ensemble)


def parameter_shapes(
    inputs: int, outputs: int, architecture: Architecture, ensemble: int = 1
) -> dict[str, tuple[int, ...]]:
    """Shapes of the parameters, by name, of a perceptron of one seed, which is not made for it."""
    shapes: dict[str, tuple[int, ...]] = {}
    for k, (before, after) in enumerate(pairwise((inputs, *architecture.hidden, outputs))):
        shapes |= {f"weights.{k}": (ensemble, before, after), f"biases.{k}": (ensemble, 1, after)}
    return shapes


def _drawn(
    ensemble: int, fan_in: int, fan_out: int, scheme: Weights, draws: Draws
) -> tuple[nn.Parameter, nn.Parameter]:
    """Random weights and biases of one layer."""
    if scheme == "glorot":
        bound = math.sqrt(6.0 / (fan_in + fan_out))
        weight = _between(bound, draws, ensemble, fan_in, fan_out)
        bias = weight.new_zeros(len(weight), 1, fan_out)
    else:
        bound = 1.0 / math.sqrt(fan_in)
        weight = _between(bound, draws, ensemble, fan_in, fan_out)
        bias = _between(bound, draws, ensemble, 1, fan_out)
    return nn.Parameter(weight), nn.Parameter(bias)


def _between(bound: float, draws: Draws, *shape: int) -> Tensor:
    """Uniform numbers of ±bound of each seed, shape (P e, ...), for ``shape`` (e, ...)."""
    return (draws.uniform(*shape).to(torch.get_default_dtype()) * 2.0 - 1.0).mul_(bound).flatten(0, 1)
