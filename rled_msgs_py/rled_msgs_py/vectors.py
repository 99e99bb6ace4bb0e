"""Vectors of the records: read-only float64, of the expected size."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rled_msgs_py.errors import ContractError

Vector = NDArray[np.float64]


def is_finite(vector: Vector) -> bool:
    """Whether all components are; for the few of a joint vector this takes a third of numpy's time."""
    return all(map(math.isfinite, vector.tolist()))


def finite_vector(values: ArrayLike, size: int, what: str) -> Vector:
    """Return ``values`` as a read-only float64 vector, shape (size,).

    Raises:
        ContractError: another size, or a NaN or infinity in it.
    """
    vector = sized_vector(values, size, what)
    if not is_finite(vector):
        raise ContractError(f"{what} holds {vector[~np.isfinite(vector)][0]}", "finite numbers")
    return vector


def sized_vector(values: ArrayLike, size: int, what: str) -> Vector:
    """The same, whatever the numbers are.

    Raises:
        ContractError: another size.
    """
    vector = np.array(values, dtype=np.float64)
    if vector.shape != (size,):
        raise ContractError(f"{what} has shape {vector.shape}", f"({size},)")
    vector.flags.writeable = False
    return vector


def rates_of(velocity: Vector, size: int) -> Vector:
    """Joint rates for so many joints, from as many as a driver tells, shape (..., size).

    A driver that tells none means zero; where it tells fewer than there are joints the others are not known, NaN.
    """
    told = velocity.shape[-1]
    if told == size:
        return velocity
    rates = np.full((*velocity.shape[:-1], size), np.nan if told else 0.0)
    rates[..., :told] = velocity[..., :size]
    return rates
