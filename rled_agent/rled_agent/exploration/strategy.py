"""A strategy says who acts in a state; the same object serves training and the agent node."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import NamedTuple

import torch
from rled_msgs_py.records import GateCode
from torch import Tensor

from rled_agent.nn.perceptron import Perceptron, joined
from rled_agent.nn.policy import Policy
from rled_agent.nn.scaling import Affine, Scaling

PolicyFunction = Callable[[Tensor], Tensor]
"""A deterministic map of normalised observations of each seed, (P, o) or (P, b, o), to normalised actions."""


class Choice(NamedTuple):
    """One action of each of P seeds, whose it is, and why.

    Attributes:
        action: normalised, shape (P, n).
        by_expert: whether it is the expert's, not the agent's, shape (P,).
        code: a ``GateCode``, why that one acts, shape (P,).
        uncertainty: u_t by measure, shape (P,); empty where it is not estimated.
        measure: the one that was compared with the threshold; ``none`` where nothing was.
        threshold: ξ that it was compared with, shape (P,), or one for all.
        held: steps that the expert has stood in for where he acts for no other reason than that, else 0, shape (P,).
    """

    action: Tensor
    by_expert: Tensor
    code: Tensor
    uncertainty: Mapping[str, Tensor] = {}
    measure: str = "none"
    threshold: Tensor | float = math.nan
    held: Tensor | int = 0


class Strategy:
    """What drives the episodes of P seeds.

    It draws the same numbers in each step, whatever happens in an episode, so that no seed's draws depend on another.
    """

    def begin(self, where: Tensor) -> None:
        """Episodes begin where the mask, shape (P,), holds; called before each step."""

    def act(self, observation: Tensor) -> Choice:
        """Choose an action for a normalised observation of each seed, shape (P, o)."""
        raise NotImplementedError

    def end(self, where: Tensor, episode_return: Tensor) -> None:
        """Episodes have ended where the mask, shape (P,), holds, with those sums of rewards, shape (P,)."""

    def state_dict(self) -> dict[str, Tensor]:
        """What a checkpoint keeps of it: attributes by name, the seeds first."""
        return {}

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Go on from ``state``; what is not in it stays."""
        for name, tensor in self.state_dict().items():
            if name in state:
                setattr(self, name, state[name].to(tensor, copy=True))


def is_anywhere(mask: Tensor) -> bool:
    """Whether a mask holds for a seed; on a device that would have to be waited for, it is taken to."""
    return mask.device.type != "cpu" or bool(mask.any())


def by_agent(action: Tensor, estimated: Mapping[str, Tensor] | None = None) -> Choice:
    """The choice of a policy that always acts."""
    return Choice(action, *_agents(len(action), action.device), estimated or {})


@cache
def _agents(seeds: int, device: torch.device) -> tuple[Tensor, Tensor]:
    """That nobody's action is the expert's, and why the agents act; made once, since a step of a robot is short."""
    nobody = torch.zeros(seeds, dtype=torch.bool, device=device)
    return nobody, torch.full((seeds,), GateCode.UNGATED, device=device)


def network_function(network: Perceptron) -> PolicyFunction:
    """Actions without dropout, of an ensemble the mean."""

    @torch.inference_mode()
    def act(observation: Tensor) -> Tensor:
        if network.members == 1 and observation.ndim == 2:
            single: Tensor = network(observation)[0]
            return single
        rows = observation if observation.ndim == 3 else observation[:, None]
        action: Tensor = network(rows)
        if network.ensemble > 1:
            action = action.view(network.population, network.ensemble, *action.shape[1:]).mean(dim=1)
        return action if observation.ndim == 3 else action[:, 0]

    return act


def policy_function(policies: Sequence[Policy], scaling: Scaling, device: torch.device | str = "cpu") -> PolicyFunction:
    """Actions of policies, one for each seed, for observations and actions normalised by another scaling than theirs.

    Raises:
        RledError: their networks are of several shapes.
    """
    network = network_function(joined([each.network for each in policies]).to(device))
    into = Affine([scaling.observation_into(each.scaling) for each in policies], device)
    back = Affine([each.scaling.action_into(scaling) for each in policies], device)
    return lambda observation: back(network(into(observation)))
