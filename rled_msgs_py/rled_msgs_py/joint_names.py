"""Joints are told apart by their names, whatever their order."""

from functools import lru_cache

import numpy as np

from rled_msgs_py.errors import ContractError
from rled_msgs_py.vectors import Vector

MAX_JOINTS = 256
MAX_NAME_LENGTH = 256
"""Characters of a joint's name."""


@lru_cache(maxsize=16)  # what it keeps is bounded by the two above: what they refuse is not kept
def check_names(names: tuple[str, ...], what: str) -> None:
    """Refuse joint names that do not tell joints apart.

    Raises:
        ContractError: none, too many, an empty one, one twice, or one that is too long.
    """
    if len(names) > MAX_JOINTS:
        raise ContractError(f"{what} has {len(names)} names", f"{MAX_JOINTS} at most")
    if any(len(name) > MAX_NAME_LENGTH for name in names):
        raise ContractError(f"{what} has a name of {max(map(len, names))} characters", f"{MAX_NAME_LENGTH} at most")
    if not names or len(set(names)) != len(names) or not all(names):
        raise ContractError(f"{what} has names {list(names)}", "distinct, non-empty joint names")


def order_by_name(names: tuple[str, ...], wanted: tuple[str, ...], what: str) -> list[int]:
    """Indices that bring values named ``names`` into the order of ``wanted``.

    Raises:
        ContractError: a wanted name is missing or an unknown one is there.
    """
    if set(names) != set(wanted):
        offenders = sorted(set(wanted) ^ set(names))
        raise ContractError(f"{what} names {', '.join(names)}", ", ".join(wanted), f"differs in {', '.join(offenders)}")
    return [names.index(name) for name in wanted]


def find_by_name(names: tuple[str, ...], wanted: tuple[str, ...], what: str) -> list[int]:
    """Indices of the wanted ones among values named ``names``; the others are passed over.

    Raises:
        ContractError: a wanted name is missing.
    """
    missing = [name for name in wanted if name not in names]
    if missing:
        raise ContractError(f"{what} names {', '.join(names)}", ", ".join(wanted), f"lacks {', '.join(missing)}")
    return [names.index(name) for name in wanted]


def unknown_joint(what: str, names: tuple[str, ...], position: Vector) -> ContractError:
    """The error of a state in which a joint's position is not finite; angles (rad), shape (n,)."""
    place = int(np.flatnonzero(~np.isfinite(position))[0])
    return ContractError(f"{what}: {names[place]} is at {position[place]}", "a finite position of every joint in use")
