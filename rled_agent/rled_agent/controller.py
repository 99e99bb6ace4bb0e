"""What the loaded networks would do in a state: the policy's proposal, and the expert's. No ROS in here."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import Actor
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick

from rled_agent.arbiter import Proposal, Source
from rled_agent.behaviour import Noise, actor_source
from rled_agent.policy import Policy, load_policy
from rled_agent.uncertainty import Measure, MonteCarlo

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class ActorSettings:
    """How a learned actor proposes.

    Attributes:
        measure: which u_t it is compared by.
        passes: N.
        noise: δ, exploration noise in halves of the action range.
        phi: Φ, the probability that the expert drives an episode.
        seed: of dropped units, noise and episodes.
    """

    measure: Measure
    passes: int
    noise: float
    phi: float
    seed: int


class Proposals(NamedTuple):
    """What could be done in a state.

    Attributes:
        policy: what the policy would do.
        expert: what the expert would do instead, None when the policy stands alone.
    """

    policy: Proposal
    expert: Source | None


class ExpertController:
    """The cloned expert alone."""

    def __init__(self, expert: Policy) -> None:
        self.policy = expert

    def begin(self) -> None:
        """Nothing lasts an episode here."""

    def adjust(self, settings: ActorSettings) -> None:
        """The expert has no settings."""

    def propose(self, observation: Vector) -> Proposals:
        """For an observation, shape (o,)."""
        return Proposals(Proposal(Actor.EXPERT, _lawful(self.policy, self.policy.act(observation))), None)


class ActorController:
    """A learned actor without dropout: nothing tells when it is unsure, so it always acts."""

    def __init__(self, agent: Policy, settings: ActorSettings) -> None:
        self.policy = agent
        self._act = actor_source(agent.network)
        self._noise = Noise(settings.noise, np.random.default_rng(settings.seed))

    def begin(self) -> None:
        """Nothing lasts an episode here."""

    def adjust(self, settings: ActorSettings) -> None:
        """Nothing of the actor changes while it runs."""

    def propose(self, observation: Vector) -> Proposals:
        """For an observation, shape (o,)."""
        scaling = self.policy.scaling
        action = self._noise.added_to(self._act(scaling.normalize_observation(observation)))
        return Proposals(Proposal(Actor.AGENT, _lawful(self.policy, scaling.denormalize_action(action))), None)


class GatedController:
    """The Monte-Carlo mean of the actor with its uncertainty (Eq. 4.38, 4.39), and the expert beside it."""

    def __init__(self, agent: Policy, expert: Policy, settings: ActorSettings) -> None:
        self.policy, self._expert = agent, expert
        self._generator = np.random.default_rng(settings.seed)
        self._noise = Noise(settings.noise, self._generator)
        self.adjust(settings)

    def adjust(self, settings: ActorSettings) -> None:
        """Compare by another measure and of another number of passes from now on."""
        self._measure = settings.measure
        self._monte_carlo = MonteCarlo(self.policy.network, settings.passes, self._generator)

    def propose(self, observation: Vector) -> Proposals:
        """For an observation, shape (o,)."""
        scaling = self.policy.scaling
        mean, uncertainty = self._monte_carlo(scaling.normalize_observation(observation))
        delta = _lawful(self.policy, scaling.denormalize_action(self._noise.added_to(mean)))
        proposal = Proposal(Actor.AGENT, delta, uncertainty[self._measure], self._measure)
        return Proposals(proposal, lambda: _lawful(self._expert, self._expert.act(observation)))


class BiasedController:
    """Biased exploration: one draw an episode says whether the expert drives all of it (Eq. 4.11, 4.12)."""

    def __init__(self, learned: ActorController | GatedController, expert: Policy, settings: ActorSettings) -> None:
        self.policy = learned.policy
        self._learned, self._expert, self._phi = learned, ExpertController(expert), settings.phi
        self._generator = np.random.default_rng([settings.seed, 1])
        self._expert_episode = False

    def begin(self) -> None:
        """Draw ξ for the episode that begins."""
        self._expert_episode = bool(self._generator.random() < self._phi)

    def adjust(self, settings: ActorSettings) -> None:
        """Draw with another Φ from the next episode on."""
        self._phi = settings.phi
        self._learned.adjust(settings)

    def propose(self, observation: Vector) -> Proposals:
        """For an observation, shape (o,)."""
        if not self._expert_episode:
            return self._learned.propose(observation)
        by_expert = self._expert.propose(observation)
        return by_expert._replace(policy=by_expert.policy._replace(drawn=True))


Controller = ExpertController | ActorController | BiasedController


class Policies(NamedTuple):
    """What the weights given hold.

    Attributes:
        expert: the cloned one, None without.
        agent: the learned one, None where the expert drives alone.
    """

    expert: Policy | None
    agent: Policy | None

    @property
    def gated(self) -> bool:
        """Whether the agent is asked for its uncertainty, and an expert stands by."""
        return self.expert is not None and self.agent is not None and bool(self.agent.network.architecture.dropout)


def load_policies(expert: str, agent: str) -> Policies:
    """The weights given.

    Raises:
        RledError: weights that can't be used, none at all, or not of one robot.
    """
    cloned = load_policy(Path(expert)) if expert else None
    if not agent and cloned is not None:
        return Policies(cloned, None)
    learned = load_policy(Path(agent))
    if cloned is not None:
        learned.task.require_same_robot(cloned.task, "the expert")
    return Policies(cloned, learned)


def make_controller(policies: Policies, settings: ActorSettings) -> Controller:
    """The controller of the weights given: the expert alone, or an agent, gated if its actor has dropout.

    Raises:
        RledError: Φ without an expert.
    """
    cloned, learned = policies
    if learned is None:
        assert cloned is not None
        return ExpertController(cloned)
    if cloned is None:
        if settings.phi:
            raise RledError(f"phi is {settings.phi:g} without an expert", "0", "name one: --expert WEIGHTS")
        return ActorController(learned, settings)
    if policies.gated:
        return BiasedController(GatedController(learned, cloned, settings), cloned, settings)
    return BiasedController(ActorController(learned, settings), cloned, settings)


def observe(task: TaskDescription, tick: Tick) -> Vector:
    """State vector of a tick, shape (o,)."""
    return task.observe(tick.joints.ordered(task.joint_names).position, tick.ee.position, tick.target.position)


def _lawful(policy: Policy, delta: NDArray[np.floating]) -> Vector:
    """A displacement (rad) within Δq_max."""
    limit = policy.task.max_delta
    lawful: Vector = np.minimum(np.maximum(delta, -limit), limit)  # a third of the time of np.clip
    return lawful
