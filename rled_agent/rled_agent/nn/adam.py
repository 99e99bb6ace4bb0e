"""Adam whose state has a name from the start, so that a checkpoint holds it like weights."""

import torch
from torch import Tensor, nn
from torch.optim.adam import adam


class Adam:
    """PyTorch's fused Adam (Kingma and Ba, 2015) over a network, with moments of zero before the first step.

    It is the function behind ``torch.optim.Adam`` with gradients handed over as they come from autograd: on networks as
    small as these, the optimizer object and the accumulation of gradients are a twentieth of an update.

    Args:
        network: whose parameters are changed.
    """

    def __init__(self, network: nn.Module) -> None:
        self._names = [name for name, _ in network.named_parameters()]
        self._parameters: list[Tensor] = [*network.parameters()]
        self._exp_avg = [torch.zeros_like(each) for each in self._parameters]
        self._exp_avg_sq = [torch.zeros_like(each) for each in self._parameters]
        self._steps = [torch.zeros((), device=each.device) for each in self._parameters]

    def step(self, loss: Tensor, rate: float) -> None:
        """One step against the gradient of a loss, by a learning rate."""
        gradients = torch.autograd.grad(loss, self._parameters)
        with torch.no_grad():
            adam(
                self._parameters,
                [*gradients],
                self._exp_avg,
                self._exp_avg_sq,
                [],
                self._steps,
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
        """Moments and steps by the names of the network's parameters; they share memory with the optimiser."""
        parts = {"step": self._steps, "exp_avg": self._exp_avg, "exp_avg_sq": self._exp_avg_sq}
        return {
            f"{name}.{part}": tensor
            for part, tensors in parts.items()
            for name, tensor in zip(self._names, tensors, strict=True)
        }
