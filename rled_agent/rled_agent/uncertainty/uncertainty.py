"""What estimates how sure a policy is."""

from typing import NamedTuple, Protocol

import numpy as np
import torch
from rled_msgs_py.errors import ContractError
from torch import Tensor

from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.policy import GateSettings
from rled_agent.uncertainty.measures import MEASURES, quartiles

STD = "std"


class Estimate(NamedTuple):
    """What is known of one state of each of P seeds.

    Attributes:
        mean: action, normalised, shape (P, n).
        uncertainty: u_t by measure (1), shape (P,).
    """

    mean: Tensor
    uncertainty: dict[str, Tensor]


class Uncertainty(Protocol):
    """An action and how sure it is."""

    def __call__(self, observation: Tensor) -> Estimate:
        """For one normalised observation of each seed, shape (P, o)."""
        ...


class MonteCarloDropout(Uncertainty):
    """N stochastic passes of an actor, in one batch (Eq. 4.38, 4.39).

    Args:
        actor: its dropped units make the passes differ.
        passes: N.
        draws: draws the dropped units.
    """

    def __init__(self, actor: Perceptron, passes: int, draws: Draws) -> None:
        self._actor, self._passes, self._draws = actor, passes, draws

    def __call__(self, observation: Tensor) -> Estimate:
        """Mean of the passes, a_MC, and how far they lie apart."""
        with torch.inference_mode():
            return _estimate(self._actor.forward_once(observation, self._passes, self._draws))  # (P, N, n)


class ActorEnsemble(Uncertainty):
    """The actors of an ensemble.

    Args:
        actor: an ensemble, whose members differ.
    """

    def __init__(self, actor: Perceptron) -> None:
        self._actor = actor

    def __call__(self, observation: Tensor) -> Estimate:
        """Mean of the members, and how far they lie apart."""
        with torch.inference_mode():
            actions = self._actor(observation[:, None])
            return _estimate(actions.view(self._actor.population, self._actor.ensemble, -1))  # (P, e, n)


class CriticEnsemble(Uncertainty):
    """An actor, and how far the critics disagree about its action: the standard deviation of their values.

    Args:
        actor: one for each seed.
        critic: an ensemble for each seed.
    """

    def __init__(self, actor: Perceptron, critic: Perceptron) -> None:
        self._actor, self._critic = actor, critic

    def __call__(self, observation: Tensor) -> Estimate:
        """The actor's action, and ``std`` of the critics."""
        with torch.inference_mode():
            action = self._actor(observation[:, None])  # (P, 1, n)
            values = self._critic(torch.cat((observation[:, None], action), dim=2))
            values = values.view(self._critic.population, -1)
            # torch.std sums a single row in another order than several: one seed would differ from one of many
            std = (values - values.mean(dim=1, keepdim=True)).square().mean(dim=1).sqrt()
        return Estimate(action[:, 0], {STD: std})


def make_uncertainty(gate: GateSettings, actor: Perceptron, critic: Perceptron | None, draws: Draws) -> Uncertainty:
    """What a gate compares.

    Args:
        gate: names estimator and measure.
        actor: a = π(s).
        critic: Q(s, a), for an estimator that asks it.
        draws: draws dropped units.

    Raises:
        ContractError: networks that such an estimate cannot come from, or a measure that it does not give.
    """
    accepted = (STD,) if gate.estimator == "critics" else tuple(MEASURES)
    if gate.measure not in accepted:
        raise ContractError(f"measure is '{gate.measure[:80]}' of {gate.estimator}", ", ".join(accepted))
    if gate.estimator == "critics":
        if critic is None or critic.ensemble < 2:
            raise ContractError("critics that could disagree are missing", "2 or more")
        return CriticEnsemble(actor, critic)
    if gate.estimator == "actors":
        if actor.ensemble < 2:
            raise ContractError("actors that could disagree are missing", "2 or more")
        return ActorEnsemble(actor)
    if not actor.architecture.dropout:
        raise ContractError("the actor drops no units", "dropout above 0", "give learner.actor.dropout")
    return MonteCarloDropout(actor, gate.passes, draws)


def _estimate(actions: Tensor) -> Estimate:
    if actions.device.type != "cpu":
        low, high, mean = quartiles(actions)
        return Estimate(mean.float(), {name: measure(low, high) for name, measure in MEASURES.items()})
    low, high, mean = quartiles(actions.numpy())
    mean = torch.from_numpy(mean.astype(np.float32))
    return Estimate(mean, {name: torch.from_numpy(measure(low, high)) for name, measure in MEASURES.items()})
