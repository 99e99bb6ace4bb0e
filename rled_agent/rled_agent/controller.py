"""What the agent node does with a state: choose who acts, and say why. No ROS in here."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.records import Actor, GateDecision, Level
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick

from rled_agent.behaviour import MonteCarloGate, Noise, actor_source, policy_source
from rled_agent.policy import Policy, load_policy
from rled_agent.uncertainty import Measure, MonteCarlo


@dataclass(frozen=True)
class GateSettings:
    """When the expert stands in.

    Attributes:
        threshold: ξ of Eq. 4.40.
        measure: which u_t is compared with it.
        passes: N.
        noise: δ, exploration noise in halves of the action range.
        seed: of dropped units and noise.
    """

    threshold: float
    measure: Measure
    passes: int
    noise: float
    seed: int


class Answer(NamedTuple):
    """What is published for one state.

    Attributes:
        delta: joint displacements (rad), shape (n,).
        action: the same, normalised, as in a replay buffer.
        decision: who acts and why.
    """

    delta: NDArray[np.float64]
    action: NDArray[np.float32]
    decision: GateDecision


class ExpertController:
    """The cloned expert alone."""

    def __init__(self, expert: Policy) -> None:
        self.policy = expert

    def answer(self, tick: Tick, observation: NDArray[np.float64]) -> Answer:
        """Act as the expert."""
        action = self.policy.scaling.normalize_action(self.policy.act(observation))
        return _answer(self.policy, tick, action, Actor.EXPERT, "the expert is the policy")


class ActorController:
    """A learned actor without dropout: nothing tells when it is unsure, so it always acts."""

    def __init__(self, agent: Policy) -> None:
        self.policy = agent
        self._act = actor_source(agent.network)

    def answer(self, tick: Tick, observation: NDArray[np.float64]) -> Answer:
        """Act as the actor."""
        action = self._act(self.policy.scaling.normalize_observation(observation))
        return _answer(self.policy, tick, action, Actor.AGENT, "the actor has no dropout, so no uncertainty")


class GatedController:
    """The Monte-Carlo mean of the actor, or the expert where the actor is unsure (Eq. 4.40)."""

    def __init__(self, agent: Policy, expert: Policy, settings: GateSettings) -> None:
        self.policy, self.settings = agent, settings
        generator = torch.Generator().manual_seed(settings.seed)
        self._gate = MonteCarloGate(
            MonteCarlo(agent.network, settings.passes, generator),
            policy_source(expert, agent.scaling),
            Noise(settings.noise, np.random.default_rng(settings.seed)),
            settings.threshold,
            settings.measure,
        )

    def configure(self, threshold: float, measure: Measure) -> None:
        """Compare another measure with another ξ from now on."""
        self._gate.threshold, self._gate.measure = threshold, measure

    def answer(self, tick: Tick, observation: NDArray[np.float64]) -> Answer:
        """Act by Eq. 4.40."""
        choice = self._gate.act(self.policy.scaling.normalize_observation(observation))
        measure, threshold = self._gate.measure, self._gate.threshold
        uncertainty = choice.uncertainty[measure]
        sign = "<" if choice.actor is Actor.AGENT else ">="
        reason = f"{measure} {uncertainty:.3g} {sign} threshold {threshold:.3g}"
        return _answer(self.policy, tick, choice.action, choice.actor, reason, (uncertainty, threshold, measure))


Controller = ExpertController | ActorController | GatedController


def load_controller(expert: str, agent: str, settings: GateSettings) -> Controller:
    """The controller of the weights given: the expert alone, or an agent, gated if its actor has dropout.

    Raises:
        RledError: weights that can't be used, or not of one robot.
    """
    cloned = load_policy(Path(expert)) if expert else None
    if not agent and cloned is not None:
        return ExpertController(cloned)
    learned = load_policy(Path(agent))
    if not learned.network.architecture.dropout or cloned is None:
        return ActorController(learned)
    learned.task.require_same_robot(cloned.task, "the expert")
    return GatedController(learned, cloned, settings)


def observe(task: TaskDescription, tick: Tick) -> NDArray[np.float64]:
    """State vector of a tick, shape (o,)."""
    return task.observe(tick.joints.ordered(task.joint_names).position, tick.ee.position, tick.target.position)


def _answer(
    policy: Policy,
    tick: Tick,
    action: NDArray[np.float32],
    actor: Actor,
    reason: str,
    gated: tuple[float, float, str] = (math.nan, math.nan, "none"),
) -> Answer:
    limit = policy.task.max_delta
    delta = np.clip(policy.scaling.denormalize_action(action), -limit, limit)
    stands_in = actor is Actor.EXPERT and gated[2] != "none"
    level = Level.WARN if stands_in else Level.OK
    status = tick.status
    decision = GateDecision(tick.stamp, level, actor, reason, *gated, episode=status.episode, step=status.step)
    return Answer(delta, action, decision)
