"""Fields of a frozen dataclass that came from elsewhere: are they of the kinds, and in the ranges, that it declares?

A bound stands beside its field, ``gamma: Annotated[float, Range(0, 1)]``, and holds for a command line, a YAML file and
JSON alike.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from rled_msgs_py.errors import ContractError

R = TypeVar("R")
MAX_INT = 2**63
"""Whole numbers are smaller than that, so that they fit into arrays; JSON has them of any length."""
SHOWN = 80
"""Characters of a value that an error repeats."""


@dataclass(frozen=True)
class Range:
    """A closed range of a number, or of each number of a sequence."""

    low: float
    high: float

    def admits(self, value: Any) -> bool:
        """Whether a value lies in it; NaN lies nowhere."""
        return all(self.low <= each <= self.high for each in (value if isinstance(value, tuple) else (value,)))

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g}"


@dataclass(frozen=True)
class Length:
    """How many parts a sequence has at most."""

    max: int

    def admits(self, value: Any) -> bool:
        """Whether a sequence is no longer."""
        return len(value) <= self.max

    def __str__(self) -> str:
        return f"at most {self.max} values"


def check_fields(record: Any, prefix: str = "") -> None:
    """Refuse values of another kind than the fields of a dataclass say, or out of their bounds.

    Args:
        record: a dataclass; those among its fields are looked into.
        prefix: put before the names of its fields.

    Raises:
        ContractError: names the field, its value and what is accepted.
    """
    for name, kind in _kinds(type(record), include_extras=True).items():
        _check(getattr(record, name), kind, prefix + name)


def _kinds(kind: type[Any], include_extras: bool = False) -> dict[str, Any]:
    """Of the fields of a dataclass, class variables left out."""
    hints = get_type_hints(kind, include_extras=include_extras)
    return {each.name: hints[each.name] for each in fields(kind)}


def _check(value: Any, kind: Any, name: str) -> None:
    kind, *bounds = get_args(kind) if get_origin(kind) is Annotated else (kind,)
    if not _fits(value, kind):
        raise ContractError(f"{name} {_shown(value)}", _accepted(kind))
    for bound in bounds:
        if isinstance(bound, Range | Length) and not bound.admits(value):
            raise ContractError(f"{name} is {_shown(value)}", str(bound))
    if is_dataclass(kind):
        check_fields(value, f"{name}.")


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."


def from_object(kind: type[R], values: Any, what: str, optional: Mapping[str, Any] | None = None) -> R:
    """A dataclass of an object as JSON has it, where lists stand for tuples and objects for dataclasses.

    Args:
        kind: the dataclass.
        values: what was read.
        what: its name, for the error.
        optional: fields that may be missing, with what stands for them then.

    Raises:
        ContractError: no object, or fields missing or unknown; others come of the dataclass's own checks.
    """
    kinds, given = _kinds(kind), dict(optional or {})
    if not isinstance(values, dict) or set(values) | set(given) != set(kinds):
        raise ContractError(f"{what} has other fields", ", ".join(kinds))
    return kind(**given | {name: _read(kinds[name], value, name) for name, value in values.items()})


def _read(kind: Any, value: Any, what: str) -> Any:
    if isinstance(kind, UnionType) and isinstance(value, dict):
        kind = next(filter(is_dataclass, get_args(kind)), kind)
    if is_dataclass(kind) and isinstance(kind, type) and isinstance(value, dict):
        return from_object(kind, value, what)
    if isinstance(value, list) and get_origin(kind) is not list:
        return tuple(_read(next(iter(get_args(kind)), None), each, what) for each in value)
    return value


def _fits(value: Any, kind: Any) -> bool:
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (tuple, list):
        return isinstance(value, origin) and all(_fits(each, parts[0]) for each in value)
    if origin is dict:
        return isinstance(value, dict) and all(_fits(each, parts[1]) for each in value.values())
    if origin is Literal:
        return value in parts
    if origin is UnionType:
        return any(_fits(value, each) for each in parts)
    if isinstance(value, bool):
        return kind is bool
    if kind is float:
        return isinstance(value, int | float) and abs(value) <= sys.float_info.max
    if kind is int:
        return isinstance(value, int) and abs(value) < MAX_INT
    return isinstance(value, kind)


def _accepted(kind: Any) -> str:
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (tuple, list):
        return f"a list, each {_accepted(parts[0])}"
    if origin is dict:
        return f"a table, each {_accepted(parts[1])}"
    if origin is Literal:
        return ", ".join(parts)
    if origin is UnionType:
        return " or ".join(map(_accepted, parts))
    if is_dataclass(kind):
        return "an object with " + ", ".join(each.name for each in fields(kind))
    return NAMES.get(kind, str(kind))


NAMES = {NoneType: "nothing", float: "a finite number", int: "a whole number", str: "a text", bool: "true or false"}
