"""Numbers that may differ between the seeds of a population: a sweep beside the seeds."""

import dataclasses
from collections.abc import Sequence
from typing import Any, TypeVar, get_type_hints

import torch
from rled_msgs_py.errors import ContractError
from torch import Tensor

T = TypeVar("T")


class PerSeed:
    """Marks a field of settings, ``Annotated[float, PER_SEED]``, whose number the code takes for each seed."""


PER_SEED = PerSeed()


def column(value: float, like: Tensor) -> Any:
    """A number as it is, or one for each seed, shape (P,), with the dimensions and the kind of what it goes with."""
    return value.to(like.dtype).view(-1, *[1] * (like.ndim - 1)) if isinstance(value, Tensor) else value


def of_seed(value: float, seed: int) -> float:
    """The number of one seed, 0 to P - 1."""
    return float(value[seed]) if isinstance(value, Tensor) else value


def numbers(settings: Any, prefix: str = "") -> list[str]:
    """Names of all fields that may differ between seeds, with dots before those of settings within settings."""
    hints, found = get_type_hints(type(settings), include_extras=True), []
    for each in dataclasses.fields(settings):
        value = getattr(settings, each.name)
        if dataclasses.is_dataclass(value):
            found += numbers(value, f"{prefix}{each.name}.")
        elif any(isinstance(mark, PerSeed) for mark in getattr(hints[each.name], "__metadata__", ())):
            found.append(prefix + each.name)
    return found


def changed(settings: T, name: str, value: float) -> T:
    """The same settings with another number.

    Args:
        settings: a dataclass.
        name: of a field, with dots as ``numbers`` gives it.
        value: for it.

    Raises:
        ContractError: no such field, or out of its range.
    """
    known = numbers(settings)
    if name not in known:
        raise ContractError(f"no number '{name[:80]}' to sweep", ", ".join(known))
    first, _, rest = name.partition(".")
    inner = getattr(settings, first)
    return dataclasses.replace(settings, **{first: changed(inner, rest, value) if rest else value})  # type: ignore[type-var]


def merged(settings: Sequence[T], device: torch.device | str = "cpu") -> T:
    """Settings of several seeds as one, in which a number that differs is a tensor of float64, shape (P,).

    Raises:
        ContractError: something else differs.
    """
    first = settings[0]
    if all(each == first for each in settings):
        return first
    whole = object.__new__(type(first))  # the bounds of each were checked when it was made
    may_differ = numbers(first)
    for each in dataclasses.fields(first):  # type: ignore[arg-type]
        values = [getattr(one, each.name) for one in settings]
        object.__setattr__(whole, each.name, _one(each.name, values, each.name in may_differ, device))
    return whole


def _one(name: str, values: list[Any], may_differ: bool, device: torch.device | str) -> Any:
    if all(value == values[0] for value in values):
        return values[0]
    if dataclasses.is_dataclass(values[0]):
        return merged(values, device)
    if not may_differ:
        raise ContractError(f"{name} differs between seeds", "one value for all of them")
    return torch.tensor(values, dtype=torch.float64, device=device)
