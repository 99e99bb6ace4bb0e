"""The closed curve that the targets lie on: Bernoulli's lemniscate, by its parametric functions (section 4.1.3)."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def lemniscate(count: int, centre: ArrayLike, along: ArrayLike, across: ArrayLike) -> NDArray[np.float64]:
    """Points of Bernoulli's lemniscate at t = 2 pi k / count, k = 0 .. count - 1.

    Args:
        count: points.
        centre: the curve's double point (m), shape (3,).
        along: from the centre to the end of one lobe, so its length is the half-width a (m), shape (3,).
        across: perpendicular to ``along`` and as long (m), shape (3,).

    Returns:
        centre + (cos t along + sin t cos t across) / (1 + sin² t), shape (count, 3).
    """
    t = 2.0 * np.pi * np.arange(count)[:, None] / count  # (count, 1)
    x = np.cos(t) / (1.0 + np.sin(t) ** 2)
    points: NDArray[np.float64] = np.asarray(centre) + x * np.asarray(along) + np.sin(t) * x * np.asarray(across)
    return points
