"""What the loaded policies would do in a state: the strategy's choice in physical units, and the expert's action."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import Actor, GateCode
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick

from rled_agent.exploration.agent import Agent, Expert, Noise
from rled_agent.exploration.policy_reuse import PolicyReuse
from rled_agent.exploration.strategy import Choice, Strategy, network_function, policy_function
from rled_agent.exploration.uncertainty_gate import UncertaintyGate
from rled_agent.nn.draws import Draws
from rled_agent.nn.policy import GateSettings, Policy, load_policy
from rled_agent.uncertainty.uncertainty import make_uncertainty

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class StrategySettings:
    """Who acts while driving.

    Attributes:
        gate: what an actor is gated by, where its uncertainty is known.
        hysteresis: the agent acts again where u_t < ξ (1 − hysteresis).
        dwell: steps that the expert acts for at least.
        noise: δ, exploration noise in halves of the action range.
        phi: Φ, the probability that the expert drives an episode.
    """

    gate: GateSettings
    hysteresis: float = 0.0
    dwell: int = 0
    noise: float = 0.0
    phi: float = 0.0


class Proposal(NamedTuple):
    """What the strategy would do.

    Attributes:
        actor: AGENT or EXPERT.
        delta: Δq (rad), shape (n,).
        code: why that one acts.
        uncertainty: u_t by the measure that was compared, NaN where none was.
        measure: name of u_t, ``none`` where nothing was compared with ξ.
        threshold: ξ that it was compared with, NaN where none was.
        note: what the code does not say, for people.
        expert: Δq (rad) of the expert, who stands in where this may not be carried out; None where nobody does.
    """

    actor: Actor
    delta: Vector
    code: GateCode = GateCode.UNGATED
    uncertainty: float = math.nan
    measure: str = "none"
    threshold: float = math.nan
    note: str = ""
    expert: Callable[[], Vector] | None = None


class Policies(NamedTuple):
    """What the weights given hold.

    Attributes:
        expert: the cloned one, None without.
        agent: the learned one, None where the expert drives alone.
    """

    expert: Policy | None
    agent: Policy | None

    @property
    def driving(self) -> Policy:
        """The one that acts when nobody stands in."""
        policy = self.agent or self.expert
        assert policy is not None
        return policy

    @property
    def is_gated(self) -> bool:
        """Whether the agent is asked for its uncertainty, and an expert stands by."""
        agent = self.agent
        if self.expert is None or agent is None:
            return False
        return bool(agent.network.architecture.dropout or agent.network.ensemble > 1 or agent.critic is not None)


def load_policies(expert: str, agent: str) -> Policies:
    """The weights given.

    Raises:
        RledError: weights that can't be used, none at all, or not of one robot.
    """
    if expert and not Path(expert).exists():
        remedy = "name them with --expert, or drive without: --expert ''"
        raise RledError(f"there is no expert in {expert}", "weights that train_expert wrote, or their folder", remedy)
    cloned = load_policy(Path(expert)) if expert else None
    if not agent and cloned is not None:
        return Policies(cloned, None)
    learned = load_policy(Path(agent))
    if cloned is not None:
        learned.task.require_same_robot(cloned.task, "the expert")
    return Policies(cloned, learned)


class Pilot:
    """A strategy over the policies given, in physical units.

    Args:
        policies: who may act.
        settings: when who does.
        seed: of dropped units, noise and episodes.

    Raises:
        RledError: Φ without an expert, or a measure that the policy does not give.
    """

    def __init__(self, policies: Policies, settings: StrategySettings, seed: int) -> None:
        self.policies, self.policy = policies, policies.driving
        self._expert = policies.expert if policies.agent is not None else None
        self._draws, self._episodes = Draws([seed]), Draws([seed], stream=1)
        self._strategy = self._make(settings)

    def require(self, settings: StrategySettings) -> None:
        """Refuse settings that no strategy can be made of.

        Raises:
            RledError: as when made.
        """
        self._make(settings)

    def adjust(self, settings: StrategySettings) -> None:
        """Choose by other settings from now on; an episode that was drawn for the expert stays his.

        Raises:
            RledError: as when made.
        """
        before, self._strategy = self._strategy.state_dict(), self._make(settings)
        self._strategy.load_state_dict(before)

    def begin(self) -> None:
        """An episode begins."""
        self._strategy.begin(torch.ones(1, dtype=torch.bool))

    def propose(self, observation: Vector) -> Proposal:
        """For an observation, shape (o,)."""
        normalised = torch.from_numpy(self.policy.scaling.normalize_observation(observation))
        choice = self._strategy.act(normalised[None])
        action = choice.action[0].numpy()
        delta = within(self.policy.scaling.denormalize_action(action), self.policy.task)
        expert, stands_in = self._expert, None
        if expert is not None:

            def stands_in() -> Vector:
                return within(expert.act(observation), self.policy.task)

        actor = Actor.EXPERT if choice.by_expert else Actor.AGENT
        return Proposal(actor, delta, GateCode(int(choice.code)), *self._compared(choice), stands_in)

    def _compared(self, choice: Choice) -> tuple[float, str, float, str]:
        """Uncertainty, measure, threshold and note; an episode that was drawn for the expert compares nothing."""
        if choice.measure == "none" or int(choice.code) == GateCode.DRAWN:
            return math.nan, "none", math.nan, ""
        held = int(choice.held)
        note = f"for {held} of {self._dwell} steps" if held else ""
        return float(choice.uncertainty[choice.measure]), choice.measure, float(choice.threshold), note

    def _make(self, settings: StrategySettings) -> Strategy:
        network, noise = self.policy.network, Noise(settings.noise, self._draws)
        self._dwell = settings.dwell
        if self.policies.agent is None:
            return Expert(network_function(network))
        if self._expert is None:
            if settings.phi:
                raise RledError(f"phi is {settings.phi:g} without an expert", "0", "name one: --expert WEIGHTS")
            return Agent(network_function(network), noise)
        expert, gate = policy_function([self._expert], self.policy.scaling), settings.gate
        strategy: Strategy = Agent(network_function(network), noise)
        if self.policies.is_gated:
            uncertainty = make_uncertainty(gate, network, self.policy.critic, self._draws)
            compared = gate.measure, gate.threshold, settings.hysteresis, settings.dwell
            strategy = UncertaintyGate(uncertainty, expert, noise, *compared)
        return PolicyReuse(strategy, expert, settings.phi, self._episodes)


def observe(task: TaskDescription, tick: Tick) -> Vector:
    """State vector of a tick, shape (o,)."""
    return task.observe(tick.joints.ordered(task.joint_names).position, tick.ee.position, tick.target.position)


def within(delta: NDArray[np.floating], task: TaskDescription) -> Vector:
    """A displacement (rad) within Δq_max."""
    most = task.max_delta
    valid: Vector = np.minimum(np.maximum(delta, -most), most)  # a third of the time of np.clip
    return valid
