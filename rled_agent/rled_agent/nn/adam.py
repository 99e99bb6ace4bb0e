"""Adam whose state has a name from the start, so that a checkpoint holds it like weights."""

import torch
from torch import Tensor, nn


def adam(network: nn.Module, rate: float) -> torch.optim.Adam:
    """PyTorch's fused Adam (Kingma and Ba, 2015) over a network, with moments of zero before the first step."""
    optimizer = torch.optim.Adam(network.parameters(), lr=rate, fused=True)
    for parameter in network.parameters():
        zeros = {name: torch.zeros_like(parameter) for name in ("exp_avg", "exp_avg_sq")}
        optimizer.state[parameter] = {"step": torch.zeros((), device=parameter.device), **zeros}
    return optimizer


def step(optimizer: torch.optim.Adam, loss: Tensor, rate: float) -> None:
    """One step against the gradient of a loss."""
    optimizer.param_groups[0]["lr"] = rate
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()


def state_of(optimizer: torch.optim.Adam, network: nn.Module) -> dict[str, Tensor]:
    """Moments and steps by the names of the network's parameters; they share memory with the optimiser."""
    return {
        f"{name}.{part}": tensor
        for name, parameter in network.named_parameters()
        for part, tensor in optimizer.state[parameter].items()
    }
