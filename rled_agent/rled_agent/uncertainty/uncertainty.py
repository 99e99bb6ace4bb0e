"""What estimates how sure a policy is."""

from typing import NamedTuple, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.errors import ContractError

from rled_agent.nn.dropout import Generator
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.policy import GateSettings
from rled_agent.uncertainty.measures import MEASURES, quartiles

STD = "std"


class Estimate(NamedTuple):
    """What is known of one state.

    Attributes:
        mean: action, normalised, shape (n,).
        uncertainty: u_t by measure (1).
    """

    mean: NDArray[np.float32]
    uncertainty: dict[str, float]


class Uncertainty(Protocol):
    """An action and how sure it is."""

    def __call__(self, observation: NDArray[np.float32]) -> Estimate:
        """For one normalised observation, shape (o,)."""
        ...


class MonteCarloDropout(Uncertainty):
    """N stochastic passes of an actor, in one batch (Eq. 4.38, 4.39).

    Args:
        actor: its dropped units make the passes differ.
        passes: N.
        generator: draws the dropped units.
    """

    def __init__(self, actor: Perceptron, passes: int, generator: Generator) -> None:
        self._actor, self._passes, self._generator = actor, passes, generator

    def __call__(self, observation: NDArray[np.float32]) -> Estimate:
        """Mean of the passes, a_MC, and how far they lie apart."""
        with torch.inference_mode():
            actions = self._actor.forward_once(torch.from_numpy(observation), self._passes, self._generator)
        return _estimate(actions.cpu().numpy()[0])  # (N, n)


class ActorEnsemble(Uncertainty):
    """The members of a population of actors.

    Args:
        actor: with members that differ.
    """

    def __init__(self, actor: Perceptron) -> None:
        self._actor = actor

    def __call__(self, observation: NDArray[np.float32]) -> Estimate:
        """Mean of the members, and how far they lie apart."""
        with torch.inference_mode():
            actions = self._actor(torch.from_numpy(observation)[None])
        return _estimate(actions.cpu().numpy()[:, 0])  # (e, n)


class CriticEnsemble(Uncertainty):
    """An actor, and how far the critics disagree about its action: the standard deviation of their values.

    Args:
        actor: one member.
        critic: several members.
    """

    def __init__(self, actor: Perceptron, critic: Perceptron) -> None:
        self._actor, self._critic = actor, critic

    def __call__(self, observation: NDArray[np.float32]) -> Estimate:
        """The actor's action, and ``std`` of the critics."""
        with torch.inference_mode():
            state = torch.from_numpy(observation)[None]
            action = self._actor(state)[0]
            values = self._critic(torch.cat((state, action), dim=1))  # (e, 1, 1)
        return Estimate(action.cpu().numpy()[0], {STD: float(values.std(correction=0))})


def make_uncertainty(
    gate: GateSettings, actor: Perceptron, critic: Perceptron | None, generator: Generator
) -> Uncertainty:
    """What a gate compares.

    Args:
        gate: names estimator and measure.
        actor: a = π(s).
        critic: Q(s, a), for an estimator that asks it.
        generator: draws dropped units.

    Raises:
        ContractError: networks that such an estimate cannot come from, or a measure that it does not give.
    """
    accepted = (STD,) if gate.estimator == "critics" else tuple(MEASURES)
    if gate.measure not in accepted:
        raise ContractError(f"measure is '{gate.measure[:80]}' of {gate.estimator}", ", ".join(accepted))
    if gate.estimator == "critics":
        if critic is None or critic.members < 2:
            raise ContractError("critics that could disagree are missing", "2 or more")
        return CriticEnsemble(actor, critic)
    if gate.estimator == "actors":
        if actor.members < 2:
            raise ContractError("actors that could disagree are missing", "2 or more")
        return ActorEnsemble(actor)
    if not actor.architecture.dropout:
        raise ContractError("the actor drops no units", "dropout above 0", "give learner.actor.dropout")
    return MonteCarloDropout(actor, gate.passes, generator)


def _estimate(actions: NDArray[np.float32]) -> Estimate:
    low, high, mean = quartiles(actions)
    return Estimate(mean.astype(np.float32), {name: measure(low, high) for name, measure in MEASURES.items()})
