"""What callers give an environment: actions, as plain numbers, and options."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError

KINDS = "fiu"
"""Kinds of NumPy numbers that are displacements: floating and whole ones."""


def action_array(action: Any, size: int) -> NDArray[np.float64]:
    """Joint displacements (rad), shape (size,), of an array or whatever NumPy makes one of.

    Raises:
        RledError: no numbers, another shape, a NaN or an infinity.
    """
    try:
        given = np.asarray(action)
    except (TypeError, ValueError, RuntimeError):  # ragged lists; tensors that are still part of a graph
        raise _refused(action, size) from None
    if given.dtype.kind not in KINDS or given.shape != (size,) or not np.isfinite(given).all():
        raise _refused(action, size)
    return given.astype(np.float64)


def _refused(action: Any, size: int) -> RledError:
    shape = f", of shape {action.shape}" if isinstance(action, np.ndarray) else ""
    return RledError(f"action {' '.join(repr(action).split())[:80]}{shape}", f"{size} finite numbers (rad)")


def refuse_options(options: dict[str, Any] | None) -> None:
    """Refuse options of a reset: these environments have none.

    Raises:
        RledError: names them.
    """
    if options:
        raise RledError(
            f"reset options {', '.join(map(str, options))}", "none", "give them when the environment is made"
        )
