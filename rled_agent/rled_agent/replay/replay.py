"""What a learner draws its batches from."""

from typing import Any

from torch import Tensor

from rled_agent.replay.transitions import Step, Transitions


class Sampler:
    """Gives batches of transitions, for each seed its own."""

    def __len__(self) -> int:
        """Transitions held of each seed."""
        raise NotImplementedError

    def sample(self, size: int) -> Transitions:
        """Draw transitions, with replacement; what is drawn is valid until the next call."""
        raise NotImplementedError

    def update_priorities(self, indices: Tensor, td_error: Tensor) -> None:
        """Take the errors, shape (P, b), that a learner found for the transitions of the last batch."""

    def state_dict(self) -> dict[str, Any]:
        """All state but the draws: tensors, which share memory and begin with the seeds, and values of all seeds."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``.

        Raises:
            RledError: it is of another buffer.
        """


class Replay(Sampler):
    """A sampler that experience is put into."""

    def add(self, step: Step) -> None:
        """Store one step of an episode of each seed."""
        raise NotImplementedError

    def extend(self, transitions: Transitions) -> None:
        """Store transitions, in order."""
        raise NotImplementedError

    def cut(self) -> None:
        """The episodes that were under way go on no further."""
