"""Fields of a frozen dataclass that came as JSON: are they of the kinds that it declares?"""

import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from rled_msgs_py.errors import ContractError

R = TypeVar("R")
LARGEST = 2**63
"""Whole numbers are smaller than that, so that they fit into arrays; JSON has them of any length."""


def check_kinds(record: Any) -> None:
    """Refuse values of another kind than the fields of a dataclass say.

    Raises:
        ContractError: names the field, its value and what is accepted.
    """
    for name, kind in get_type_hints(type(record)).items():
        value = getattr(record, name)
        if not _fits(value, kind):
            raise ContractError(f"{name} {value!r}", _accepted(kind))


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
    kinds, given = get_type_hints(kind), dict(optional or {})
    if not isinstance(values, dict) or set(values) | set(given) != set(kinds):
        raise ContractError(f"{what} has other fields", ", ".join(kinds))
    return kind(**given | {name: _read(kinds[name], value, name) for name, value in values.items()})


def _read(kind: Any, value: Any, what: str) -> Any:
    if is_dataclass(kind) and isinstance(kind, type) and isinstance(value, dict):
        return from_object(kind, value, what)
    if isinstance(value, list):
        return tuple(_read(next(iter(get_args(kind)), None), each, what) for each in value)
    return value


def _fits(value: Any, kind: Any) -> bool:
    if get_origin(kind) is tuple:
        return isinstance(value, tuple) and all(_fits(each, get_args(kind)[0]) for each in value)
    if get_origin(kind) is Literal:
        return value in get_args(kind)
    if isinstance(value, bool):
        return kind is bool
    if kind is float:
        return isinstance(value, int | float) and abs(value) <= sys.float_info.max
    if kind is int:
        return isinstance(value, int) and abs(value) < LARGEST
    return isinstance(value, kind)


def _accepted(kind: Any) -> str:
    if get_origin(kind) is tuple:
        return f"a list, each {_accepted(get_args(kind)[0])}"
    if get_origin(kind) is Literal:
        return ", ".join(get_args(kind))
    if is_dataclass(kind):
        return "an object with " + ", ".join(each.name for each in fields(kind))
    return {float: "a finite number", int: "a whole number", str: "a text", bool: "true or false"}[kind]
