"""Jogging: from what a person asks for at one tick to a displacement that the robot can make."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.task import TaskDescription
from rled_sim.kinematics import Chain

Vector = NDArray[np.float64]

LIMIT_MARGIN = 0.01
"""How far from its limits a joint is stopped (rad)."""
NEAR_SINGULAR = 0.05
"""Smallest singular value of the Jacobian (m/rad) below which the damping begins."""
MAX_DAMPING = 0.1
"""Damping λ (m/rad) where the Jacobian loses rank."""


@dataclass(frozen=True)
class Jog:
    """A robot that is jogged.

    Attributes:
        task: robot with Δq_max, joint limits, and the position components that it moves in.
        chain: its kinematics.
    """

    task: TaskDescription
    chain: Chain

    def joint(self, q: Vector, joint: int, share: float) -> Vector:
        """Turn one joint.

        Args:
            q: joint angles (rad), shape (n,).
            joint: which.
            share: of Δq_max, -1 to 1.

        Returns:
            Δq (rad), shape (n,).
        """
        delta = np.zeros(len(q))
        delta[joint] = share * self.task.max_delta
        return self.within_limits(q, delta)

    def cartesian(self, q: Vector, step: Vector, share: float = 1.0) -> Vector:
        """Move the end effector by damped least squares; joints at their limits stay, the others make up for them.

        Args:
            q: joint angles (rad), shape (n,).
            step: displacement of the end effector asked for (m), shape (3,); components that the task does not use
                are left out.
            share: of Δq_max that no joint exceeds; the whole motion is slowed down for it, its direction stays.

        Returns:
            Δq (rad), shape (n,).
        """
        axes = list(self.task.axes)
        jacobian, wanted = self.chain.jacobian(q)[axes], step[axes]  # (m, n), (m,)
        free = np.ones(len(q), dtype=bool)
        delta = np.zeros(len(q))
        for _ in range(len(q)):
            delta = np.zeros(len(q))
            delta[free] = scaled_to(damped_inverse(jacobian[:, free], wanted), share * self.task.max_delta)
            blocked = free & (self.within_limits(q, delta) != delta)
            if not blocked.any() or (blocked == free).all():
                break
            free &= ~blocked
        return self.within_limits(q, delta)

    def within_limits(self, q: Vector, delta: Vector) -> Vector:
        """Cut a displacement at the joint limits, shape (n,); a joint beyond its margin may only come back."""
        low = np.minimum(np.array(self.task.joint_lower) + LIMIT_MARGIN - q, 0.0)
        high = np.maximum(np.array(self.task.joint_upper) - LIMIT_MARGIN - q, 0.0)
        return np.clip(delta, low, high)


def scaled_to(delta: Vector, limit: float) -> Vector:
    """A displacement (rad) made so much shorter that no component exceeds ``limit``, shape (n,)."""
    largest = float(np.abs(delta).max(initial=0.0))
    return delta * (limit / largest) if largest > limit else delta


def damped_inverse(jacobian: Vector, step: Vector) -> Vector:
    """Joint displacement of a task-space step: Jᵀ (J Jᵀ + λ² I)⁻¹ step.

    λ² = λ_max² (1 - (σ / σ_near)²) below the smallest singular value σ_near and 0 above it (Nakamura and Hanafusa 1986,
    in the form of Chiaverini 1997), so that away from singularities the step is made exactly.

    Args:
        jacobian: J (m/rad), shape (m, n).
        step: (m), shape (m,).

    Returns:
        Δq (rad), shape (n,).
    """
    if not jacobian.size:
        return np.zeros(jacobian.shape[1])
    left, sigma, right = np.linalg.svd(jacobian, full_matrices=False)
    near = max(0.0, 1.0 - (float(sigma.min()) / NEAR_SINGULAR) ** 2) if len(sigma) == len(step) else 1.0
    damped = sigma / (sigma**2 + near * MAX_DAMPING**2)
    delta: Vector = right.T @ (damped * (left.T @ step))
    return delta
