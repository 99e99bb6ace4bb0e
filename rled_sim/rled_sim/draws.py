"""Random numbers of other kinds made of uniform ones in [0, 1).

Everything random of a simulation is made of a known count of uniforms, each one 64-bit word of its generator, so that
many environments may draw ahead and still have the numbers that one has by itself.
"""

import math
from typing import Any

import numpy as np
from rled_msgs_py.arrays import namespace


def index(rng: np.random.Generator, count: int) -> int:
    """One of 0 .. count - 1, each as likely as the other: ⌊uk⌋."""
    return int(rng.random() * count)


def offset(uniform: Any, spread: float) -> Any:
    """A number in [-spread, spread), or an array of them."""
    return spread * (2.0 * uniform - 1.0)


def normal_draws(count: int) -> int:
    """How many uniforms ``normals`` takes for so many numbers."""
    return count + count % 2


def normals(uniforms: Any, count: int) -> Any:
    """Standard normal numbers by the Box-Muller transform: (..., normal_draws(count)) -> (..., count)."""
    xp, half = namespace(uniforms), uniforms.shape[-1] // 2
    radius = xp.sqrt(-2.0 * xp.log1p(-uniforms[..., :half]))
    angle = 2.0 * math.pi * uniforms[..., half:]
    return xp.concatenate([radius * xp.cos(angle), radius * xp.sin(angle)], -1)[..., :count]
