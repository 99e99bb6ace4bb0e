"""Who acts while learning: Gaussian noise, biased exploration (Algorithm 2), the Monte-Carlo gate (Eq. 4.40)."""

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.records import Actor

from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.scaling import Scaling
from rled_agent.policy import Policy
from rled_agent.uncertainty import Measure, MonteCarlo

Action = NDArray[np.float32]


class Choice(NamedTuple):
    """One action and where it comes from.

    Attributes:
        action: normalised, shape (n,).
        actor: AGENT or EXPERT.
        uncertainty: u_t by measure, empty where it is not estimated.
    """

    action: Action
    actor: Actor
    uncertainty: dict[Measure, float]


class Source(Protocol):
    """A deterministic map of normalised observation to normalised action."""

    def __call__(self, observation: NDArray[np.float32]) -> Action:
        """Action, shape (n,)."""
        ...


def actor_source(network: Perceptron) -> Source:
    """A network's action without dropout."""

    @torch.inference_mode()
    def act(observation: NDArray[np.float32]) -> Action:
        action: Action = network(torch.from_numpy(observation)[None])[0, 0].numpy()
        return action

    return act


def policy_source(policy: Policy, scaling: Scaling) -> Source:
    """A policy's action, for observations and actions normalised by another scaling than its own."""

    def act(observation: NDArray[np.float32]) -> Action:
        return scaling.normalize_action(policy.act(scaling.denormalize_observation(observation)))

    return act


class Behaviour(Protocol):
    """What drives an episode while learning."""

    def begin(self) -> None:
        """An episode begins."""
        ...

    def end(self, total: float) -> None:
        """An episode has ended, with that sum of rewards."""
        ...

    def act(self, observation: NDArray[np.float32]) -> Choice:
        """Choose an action for a normalised observation, shape (o,)."""
        ...

    def state(self) -> dict[str, Any]:
        """What a checkpoint keeps of it, plain JSON values."""
        ...

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from ``state``."""
        ...


@dataclass(frozen=True)
class Noise:
    """ε ~ N(0, δ), added to a normalised action that is then clipped to [−1, 1].

    Attributes:
        deviation: δ, in halves of the action range.
        generator: draws it.
    """

    deviation: float
    generator: np.random.Generator

    def added_to(self, action: Action) -> Action:
        """The action with noise."""
        if not self.deviation:
            return action
        noise = self.generator.normal(0.0, self.deviation, action.shape)
        return np.clip(action + noise, -1.0, 1.0).astype(np.float32)


@dataclass
class BiasedExploration:
    """With probability Φ a whole episode is driven by the expert (Eq. 4.11, 4.12); Φ = 0 is pure TD3.

    Attributes:
        policy: π_θ.
        expert: π̂ᵈ, None when there is none.
        noise: ε.
        phi: Φ, the probability of policy reuse.
        generator: draws ξ once an episode.
        uncertainty: estimates u_t for the record, None to leave it out.
    """

    policy: Source
    expert: Source | None
    noise: Noise
    phi: float
    generator: np.random.Generator
    uncertainty: MonteCarlo | None = None
    expert_episode: bool = False

    def begin(self) -> None:
        """Draw ξ (Eq. 4.11)."""
        self.expert_episode = self.expert is not None and bool(self.generator.random() < self.phi)

    def end(self, total: float) -> None:
        """Nothing is learned from it here."""

    def act(self, observation: NDArray[np.float32]) -> Choice:
        """Act by Eq. 4.12."""
        estimated = self.uncertainty(observation).uncertainty if self.uncertainty else {}
        if self.expert_episode and self.expert is not None:
            return Choice(self.expert(observation), Actor.EXPERT, estimated)
        return Choice(self.noise.added_to(self.policy(observation)), Actor.AGENT, estimated)

    def state(self) -> dict[str, Any]:
        """Who drives this episode."""
        return {"expert_episode": self.expert_episode}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on with the episode."""
        self.expert_episode = state["expert_episode"]


@dataclass
class MonteCarloGate:
    """Where the actor is unsure, the expert acts (Eq. 4.40).

    Attributes:
        monte_carlo: a_MC and u_t.
        expert: π̂ᵈ.
        noise: ε.
        threshold: ξ.
        measure: which u_t is compared with it.
    """

    monte_carlo: MonteCarlo
    expert: Source
    noise: Noise
    threshold: float
    measure: Measure

    def begin(self) -> None:
        """Nothing lasts an episode here."""

    def end(self, total: float) -> None:
        """Nothing is learned from it here."""

    def act(self, observation: NDArray[np.float32]) -> Choice:
        """Act by Eq. 4.40."""
        mean, uncertainty = self.monte_carlo(observation)
        if uncertainty[self.measure] < self.threshold:  # false for NaN too: what is not known to be sure is unsure
            return Choice(self.noise.added_to(mean), Actor.AGENT, uncertainty)
        return Choice(self.expert(observation), Actor.EXPERT, uncertainty)

    def state(self) -> dict[str, Any]:
        """Nothing to keep."""
        return {}

    def restore(self, state: dict[str, Any]) -> None:
        """Nothing to go on from."""
