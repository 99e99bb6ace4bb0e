"""What a method is: settings, and what they are composed into. Training knows no more of it than this."""

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

from rled_msgs_py.errors import RledError

from rled_agent.exploration.strategy import PolicyFunction, Strategy
from rled_agent.learners.learner import Learner, Update
from rled_agent.nn.draws import Draws
from rled_agent.nn.policy import GateSettings
from rled_agent.replay.replay import Replay, Sampler
from rled_agent.replay.uniform import UniformReplay


class Problem(NamedTuple):
    """What a method is built for.

    Attributes:
        observation_size: o.
        action_size: n.
        capacity: transitions that are kept for replay.
        draws: of everything that is drawn, for each seed its own; its device is that of all tensors.
        expert: π̂ᵈ of each seed for normalised observations; None without one.
        demonstrations: makes the demonstrated transitions for a discount γ; None without demonstrations.
    """

    observation_size: int
    action_size: int
    capacity: int
    draws: Draws
    expert: PolicyFunction | None = None
    demonstrations: Callable[[float], Sampler] | None = None

    def replay(self) -> UniformReplay:
        """An empty buffer of the problem's sizes."""
        return UniformReplay(self.observation_size, self.action_size, self.capacity, self.draws)

    def require_expert(self, who: str) -> PolicyFunction:
        """The expert.

        Raises:
            RledError: there is none.
        """
        if self.expert is None:
            raise RledError(f"{who} needs an expert", "--bag and --expert", "clone one with train_expert")
        return self.expert


class Learning(NamedTuple):
    """What learns.

    Attributes:
        learner: networks and their update.
        replay: what experience is put into.
        batches: what the learner's batches are drawn from.
        gamma: γ, of the transitions that are put in; one for each seed where they differ, shape (P,).
    """

    learner: Learner
    replay: Replay
    batches: Sampler
    gamma: float

    def update(self, batch_size: int) -> Update:
        """One gradient step on a batch, whose errors become its priorities."""
        transitions = self.batches.sample(batch_size)
        update = self.learner.update(transitions)
        self.batches.update_priorities(transitions.indices, update.td_error)
        return update


class Method:
    """Base of all methods: a frozen dataclass of settings, with bounds beside the fields.

    Attributes:
        title: what it is, in a line.
        paper: where it comes from.
        needs: what it cannot do without: ``expert``, ``demonstrations``.
    """

    title: ClassVar[str]
    paper: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = ()

    @property
    def name(self) -> str:
        """Name of its file, or of its class where that is no file of this folder."""
        folder, _, name = type(self).__module__.rpartition(".")
        return name if folder == "rled_agent.methods" else type(self).__name__

    @property
    def gate(self) -> GateSettings | None:
        """What a gate compares that the policy learns behind; it travels in the policy's file."""
        return None

    def learning(self, problem: Problem) -> Learning:
        """Make what learns; weights are drawn first.

        Raises:
            RledError: the method has none.
        """
        raise RledError(f"method {self.name} does not say what learns", "learning(self, problem) -> Learning")

    def strategy(self, problem: Problem, learner: Any) -> Strategy:
        """Make who acts while it learns.

        Raises:
            RledError: it needs an expert, and there is none; or the method has none.
        """
        remedy = "agent_strategy(problem, learner, noise) lets the learned policy act"
        raise RledError(f"method {self.name} does not say who acts", "strategy(self, problem, learner)", remedy)
