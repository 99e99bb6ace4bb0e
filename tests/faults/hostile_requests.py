"""Requests that nobody should make, for the services of any node of ours."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from hypothesis import strategies as st
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rled_msgs_py.params import parameters_of
from type_description_interfaces.srv import GetTypeDescription

from .hostile import TEXTS, hostile

VALUES = st.one_of(
    hostile(ParameterValue),
    st.builds(lambda kind, value: setattr(value, "type", kind) or value, st.integers(0, 9), hostile(ParameterValue)),
)


class Requests(NamedTuple):
    """What is asked of one service: its type, and requests."""

    kind: type
    requests: st.SearchStrategy[Any]


def requests_of(params: type, services: Mapping[str, type]) -> dict[str, Requests]:
    """Requests for a node's own services, and for those that every node has."""
    own = [each.name for each in parameters_of(params)]
    name = st.one_of(st.sampled_from([*own, "use_sim_time"]), TEXTS)
    names = st.lists(name, max_size=5)
    given = st.lists(st.builds(lambda name, value: Parameter(name=name, value=value), name, VALUES), max_size=4)
    asked = {service: Requests(kind, hostile(kind.Request)) for service, kind in services.items()}  # type: ignore[attr-defined]
    return asked | {
        "set_parameters": _of(SetParameters, given, "parameters"),
        "set_parameters_atomically": _of(SetParametersAtomically, given, "parameters"),
        "get_parameters": _of(GetParameters, names, "names"),
        "get_parameter_types": _of(GetParameterTypes, names, "names"),
        "describe_parameters": _of(DescribeParameters, names, "names"),
        "list_parameters": Requests(ListParameters, hostile(ListParameters.Request)),
        "get_type_description": Requests(GetTypeDescription, hostile(GetTypeDescription.Request)),
    }


def adjustable(params: type) -> dict[str, Any]:
    """The parameters that a running node takes, at their defaults."""
    return {each.name: each.default for each in parameters_of(params) if not each.spec.read_only}


def _of(kind: Any, values: st.SearchStrategy[Any], field: str) -> Requests:
    return Requests(kind, values.map(lambda each: kind.Request(**{field: each})))
