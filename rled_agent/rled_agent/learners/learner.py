"""What changes networks by batches of transitions."""

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

from torch import Tensor

from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.replay.transitions import Transitions


class Update(NamedTuple):
    """What a gradient step reports; nothing of it is read back from the device before somebody asks.

    Attributes:
        td_error: of each transition, shape (P, b).
        metrics: tensors of any shape (P, ...), whose mean over all but the seeds is the metric.
    """

    td_error: Tensor
    metrics: Mapping[str, Tensor]


class Learner(Protocol):
    """Networks and their update."""

    updates: int
    """Gradient steps taken."""
    draws: Draws
    """Draws all that the update draws."""

    @property
    def actor(self) -> Perceptron:
        """The policy that is learned, normalised observation to normalised action."""
        ...

    @property
    def critic(self) -> Perceptron:
        """Q of normalised observation and action, an ensemble for each seed."""
        ...

    def start_from(self, actor: Perceptron) -> None:
        """Begin with the weights of a policy that is there already."""
        ...

    def update(self, transitions: Transitions) -> Update:
        """One gradient step."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """All state: tensors by dotted name, which share memory and begin with the seeds; plain values are of all."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``.

        Raises:
            RledError: it is of other networks.
        """
        ...
