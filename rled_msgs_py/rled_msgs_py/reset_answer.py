"""What the simulation answers to ``~/reset``: fields for programs with a text for people beside them, as JSON."""

import json
from dataclasses import asdict, dataclass
from typing import Annotated

from rled_msgs_py.untrusted import read_json
from rled_msgs_py.validation import MAX_INT, Range, check_fields, from_object


@dataclass(frozen=True)
class ResetAnswer:
    """The episode that has begun.

    Attributes:
        text: the same for people.
        episode: its number.
        stamp: of its first tick (ns).

    Raises:
        ContractError: (when made) a negative number.
    """

    text: str
    episode: Annotated[int, Range(0, MAX_INT)]
    stamp: Annotated[int, Range(0, MAX_INT)]

    def __post_init__(self) -> None:
        check_fields(self)

    @staticmethod
    def of(episode: int, stamp: int) -> "ResetAnswer":
        """The answer that an episode begins at a stamp (ns)."""
        return ResetAnswer(f"episode {episode} begins at {stamp * 1e-9:.2f} s", episode, stamp)

    def to_json(self) -> str:
        """The message of the service's answer."""
        return json.dumps(asdict(self))

    @staticmethod
    def from_json(text: str) -> "ResetAnswer":
        """Read ``to_json``'s text.

        Raises:
            ContractError: it is no such text.
        """
        what = "the answer to a reset"
        return from_object(ResetAnswer, read_json(text, what), what)
