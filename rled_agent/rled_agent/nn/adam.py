"""Adam whose state has a name from the start, so that a checkpoint holds it like weights."""

from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import NamedTuple

import torch
from torch import Tensor
from torch.optim.adam import adam

from rled_agent.nn.perceptron import Perceptron

VECTOR = 16
"""Numbers of float32 in the longest vector of a processor."""


class _Group(NamedTuple):
    """Seeds of one learning rate: views of the whole, and the steps of each parameter."""

    parameters: list[Tensor]
    exp_avg: list[Tensor]
    exp_avg_sq: list[Tensor]
    steps: list[Tensor]


class Adam:
    """PyTorch's fused Adam (Kingma and Ba, 2015) over a network, with moments of zero before the first step.

    It is the function behind ``torch.optim.Adam`` with gradients handed over as they come from autograd: on networks as
    small as these, the optimizer object and the accumulation of gradients are a twentieth of an update.

    Args:
        network: whose parameters are changed.
        seeds: how many seeds of the network's population, one after the other, share each learning rate.
    """

    def __init__(self, network: Perceptron, seeds: Sequence[int]) -> None:
        self._names = [name for name, _ in network.named_parameters()]
        self._parameters: list[Tensor] = [*network.parameters()]
        self._exp_avg = [torch.zeros_like(each) for each in self._parameters]
        self._exp_avg_sq = [torch.zeros_like(each) for each in self._parameters]
        ends = [network.ensemble * end for end in accumulate(seeds, initial=0)]
        rows = [slice(*each) for each in pairwise(ends)]
        self._groups = [self._group(each) for each in rows]
        self._rows = rows

    def _group(self, rows: slice) -> _Group:
        parameters = [each.detach() for each in self._parameters]
        parts = [_parts(rows, each) for each in (parameters, self._exp_avg, self._exp_avg_sq)]
        steps = [torch.zeros((), device=each.device) for each in parts[0]]
        return _Group(parts[0], parts[1], parts[2], steps)

    def step(self, loss: Tensor, rates: Sequence[float]) -> None:
        """One step against the gradient of a loss, by a learning rate for each group of seeds."""
        gradients = [*torch.autograd.grad(loss, self._parameters)]
        with torch.no_grad():
            for group, rows, rate in zip(self._groups, self._rows, rates, strict=True):
                adam(
                    group.parameters,
                    _parts(rows, gradients),
                    group.exp_avg,
                    group.exp_avg_sq,
                    [],
                    group.steps,
                    fused=True,
                    amsgrad=False,
                    beta1=0.9,
                    beta2=0.999,
                    lr=rate,
                    weight_decay=0.0,
                    eps=1e-8,
                    maximize=False,
                )

    def tensors(self) -> dict[str, Tensor]:
        """Moments by the names of the network's parameters; they share memory with the optimiser."""
        parts = {"exp_avg": self._exp_avg, "exp_avg_sq": self._exp_avg_sq}
        return {
            f"{name}.{part}": tensor
            for part, tensors in parts.items()
            for name, tensor in zip(self._names, tensors, strict=True)
        }

    @property
    def steps(self) -> int:
        """Steps taken."""
        return int(self._groups[0].steps[0])

    @steps.setter
    def steps(self, steps: int) -> None:
        for each in self._groups:
            for tensor in each.steps:
                tensor.fill_(float(steps))


def _parts(rows: slice, tensors: list[Tensor]) -> list[Tensor]:
    """Some rows of tensors; a row that is no whole number of vectors is a part of its own on the host.

    What is left over behind the last vector is rounded otherwise there than within one, so a seed's numbers would
    depend on how many seeds lie behind each other.
    """
    parts: list[Tensor] = []
    for each in tensors:
        chosen = each if rows.stop - rows.start == len(each) else each[rows]
        if len(chosen) > 1 and each.device.type == "cpu" and (each.shape[1] * each.shape[2]) % VECTOR:
            parts += chosen.split(1)
        else:
            parts.append(chosen)
    return parts
