"""What the simulation answers to ``~/reset``: a sentence for people, and for programs a form that does not change."""

import re

from rled_msgs_py.errors import ContractError

FORM = re.compile(r"episode (\d{1,18}) begins at (\d{1,19}) ns", re.ASCII)


def say_begin(number: int, stamp: int) -> str:
    """The answer that episode ``number`` begins at a stamp (ns)."""
    return f"episode {number} begins at {stamp} ns"


def read_begin(answer: str) -> int:
    """Stamp (ns) of the first tick of the episode that an answer tells of.

    Raises:
        ContractError: it tells of none.
    """
    if (found := FORM.fullmatch(answer)) is None:
        raise ContractError(f"the answer '{answer}' to a reset", "episode NUMBER begins at STAMP ns")
    return int(found[2])
