"""The demonstrated action of section 4.1.3: the operator's motion between two points of ζᵃ."""

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


def demonstrated_action(q: Vector, goal: Vector, max_delta: float) -> Vector:
    """Joint displacement that goes straight towards ``goal`` in joint space.

    Δq_k = clip(e_qmax, 0, Δq_max) (q_T,k − q_k) / e_qmax with e_qmax = max_k |q_T,k − q_k|. At the goal it is zero.

    Args:
        q: joint angles (rad), shape (..., n).
        goal: joint angles q_T to reach (rad), shape (..., n).
        max_delta: Δq_max (rad).

    Returns:
        Δq (rad), shape (..., n); no component exceeds Δq_max, and the joint farthest away moves by exactly that.
    """
    error = goal - q
    farthest = np.abs(error).max(axis=-1, keepdims=True)
    direction = np.divide(error, farthest, out=np.zeros_like(error), where=farthest > 0)  # ±1 in the farthest joint
    action: Vector = np.minimum(farthest, max_delta) * direction
    return action
