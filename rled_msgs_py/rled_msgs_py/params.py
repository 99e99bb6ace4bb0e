"""A node's parameters as one frozen dataclass: the same fields serve command line, YAML and ``ros2 param``."""

import argparse
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, NoReturn, TypeVar

from rled_msgs_py.errors import ContractError

P = TypeVar("P")


@dataclass(frozen=True)
class Spec:
    """What a parameter accepts: closed range for numbers, choices for text."""

    description: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = False

    def check(self, name: str, value: Any) -> None:
        """Refuse a value outside the range or the choices.

        Raises:
            ContractError: names the parameter, the value and what is accepted.
        """
        if self.choices and value not in self.choices:
            raise ContractError(f"{name} is '{value}'", ", ".join(self.choices))
        if self.low is not None and self.high is not None and not self.low <= value <= self.high:
            raise ContractError(f"{name} is {value}", f"{self.low} to {self.high}")


def param(
    default: Any,
    description: str,
    *,
    low: float | None = None,
    high: float | None = None,
    choices: Sequence[str] = (),
    read_only: bool = False,
) -> Any:
    """A field of a parameter dataclass; a range needs both ends. Types: bool, int, float, str."""
    return field(default=default, metadata={"spec": Spec(description, low, high, tuple(choices), read_only)})


class Parameter(NamedTuple):
    """One field of a parameter dataclass."""

    name: str
    default: Any
    spec: Spec


def parameters_of(params: type[Any]) -> list[Parameter]:
    """The fields of a parameter dataclass, in order."""
    return [Parameter(each.name, each.default, each.metadata["spec"]) for each in dataclasses.fields(params)]


def described(params: type[P]) -> type[P]:
    """Put the descriptions of a parameter dataclass into its docstring, where ``help`` and other command lines look."""
    lines = [f"    {each.name}: {each.spec.description}." for each in parameters_of(params)]
    params.__doc__ = "\n".join([params.__doc__ or "", "", "Attributes:", *lines])
    return params


def build(params: type[P], values: dict[str, Any]) -> P:
    """Make a parameter record of ``values``, each checked; what is left out keeps its default."""
    for each in parameters_of(params):
        if each.name in values:
            each.spec.check(each.name, values[each.name])
    return params(**values)


class _Parser(argparse.ArgumentParser):
    """A parser whose complaints are one line."""

    def error(self, message: str) -> NoReturn:
        raise ContractError(message, "", f"see {self.prog} --help")


def parse_command_line(
    params: type[Any], program: str, summary: str, argv: Sequence[str]
) -> tuple[dict[str, Any], list[str]]:
    """Split a node's command line into parameters given as ``--name value`` and the rest for ROS.

    Returns:
        The parameters given, by name, and ``--ros-args ...`` untouched.

    Raises:
        ContractError: an unknown option, or a value that is not accepted.
    """
    split = argv.index("--ros-args") if "--ros-args" in argv else len(argv)
    parser = _Parser(
        prog=program,
        description=summary,
        epilog="Each option is a ROS parameter too: --ros-args -p name:=value, or a YAML file with --params-file.",
        argument_default=argparse.SUPPRESS,
        allow_abbrev=False,
    )
    for each in parameters_of(params):
        text = each.spec.description.replace("%", "%%") + f" (default: {each.default})"
        flag = "--" + each.name.replace("_", "-")
        if isinstance(each.default, bool):
            parser.add_argument(flag, dest=each.name, action=argparse.BooleanOptionalAction, help=text)
        else:
            metavar = "{" + ",".join(each.spec.choices) + "}" if each.spec.choices else None
            parser.add_argument(flag, dest=each.name, type=type(each.default), metavar=metavar, help=text)
    given = vars(parser.parse_args(list(argv[:split])))
    for each in parameters_of(params):
        if each.name in given:
            each.spec.check(each.name, given[each.name])
    return given, list(argv[split:])
