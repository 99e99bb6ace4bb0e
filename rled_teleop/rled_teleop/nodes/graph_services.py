"""What the page asks of the nodes around it, called without waiting for the answers."""

import math
from functools import partial
from typing import Any, NamedTuple

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.node import Node
from rled_msgs_py.errors import ContractError, RledError, shortened
from rled_msgs_py.reset_answer import ResetAnswer
from rled_msgs_py.ros.client import Client
from std_srvs.srv import SetBool, Trigger

AGENT_PARAMETERS: dict[str, float | str] = {"threshold": 0.0, "measure": "", "query_timeout": 0.0, "phi": 0.0}
"""Adjustable ones, of which an agent has some, each with a value of its type."""
MAX_ANSWER = 300
"""Characters of an answer that are shown."""


class Service(NamedTuple):
    """A service without arguments, or with a switch.

    Attributes:
        node: whose it is: ``sim`` or ``agent``.
        name: of the service.
        switch: None for a Trigger.
    """

    node: str
    name: str
    switch: bool | None = None


SERVICES = {
    "estop": Service("sim", "estop", True),
    "release": Service("sim", "estop", False),
    "agent estop": Service("agent", "estop", True),
    "agent release": Service("agent", "estop", False),
    "pause": Service("sim", "pause", True),
    "run": Service("sim", "pause", False),
    "reset": Service("sim", "reset"),
    "enable": Service("agent", "enable", True),
    "disable": Service("agent", "enable", False),
    "learn": Service("agent", "learn", True),
    "rest": Service("agent", "learn", False),
    "save": Service("agent", "save"),
}


class GraphServices:
    """Clients of the simulation's and the agent's services and of the agent's parameters.

    Args:
        node: whose clients these are.
        names: of the nodes ``sim`` and ``agent``.

    Attributes:
        answer: what was said last, in words.
        parameters: of the agent, by name; empty while there is none.
    """

    def __init__(self, node: Node, names: dict[str, str]) -> None:
        def client(service: Service) -> Client:
            kind = Trigger if service.switch is None else SetBool
            return Client(node, kind, f"{names[service.node]}/{service.name}")

        by_path = {(each.node, each.name): client(each) for each in SERVICES.values()}
        self._clients = {what: by_path[(each.node, each.name)] for what, each in SERVICES.items()}
        agent = names["agent"]
        self._list = Client(node, ListParameters, f"{agent}/list_parameters")
        self._get = Client(node, GetParameters, f"{agent}/get_parameters")
        self._set = Client(node, SetParameters, f"{agent}/set_parameters")
        self.answer = ""
        self.parameters: dict[str, Any] = {}

    @property
    def has_agent(self) -> bool:
        """Whether an agent answers."""
        return self._clients["enable"].is_ready

    def ask(self, what: str) -> None:
        """Call a service; ``answer`` changes when it has answered."""
        if (also := f"agent {what}") in SERVICES and self.has_agent:
            self.ask(also)
        client, service = self._clients[what], SERVICES[what]
        if not client.is_ready:
            self.answer = f"{what}: no node offers {client.name}"
            return
        request = Trigger.Request() if service.switch is None else SetBool.Request(data=service.switch)
        client.ask(request, partial(self._on_answer, what), partial(self._on_failure, what))

    def set(self, name: str, value: float | str) -> None:
        """Set a parameter of the agent."""
        if not self._set.is_ready:
            self.answer = f"{name}: no agent is running"
            return
        request = SetParameters.Request(parameters=[Parameter(name=name, value=_value(value))])
        self._set.ask(request, partial(self._on_set, name, value), partial(self._on_failure, name))

    def poll(self) -> None:
        """Ask for the agent's parameters; call it now and then."""
        if not self.has_agent:
            self.parameters = {}
        elif self._list.is_ready:
            self._list.ask(ListParameters.Request(), self._on_list, self._on_silence)

    def _on_list(self, response: Any) -> None:
        names = [each for each in AGENT_PARAMETERS if each in response.result.names]
        if names and self._get.is_ready:
            self._get.ask(GetParameters.Request(names=names), partial(self._on_values, names), self._on_silence)

    def _on_values(self, names: list[str], response: Any) -> None:
        if len(response.values) != len(names):
            raise ContractError(f"{len(response.values)} values of the parameters {', '.join(names)}")
        self.parameters = {name: _plain(name, each) for name, each in zip(names, response.values, strict=True)}

    def _on_silence(self, _: RledError) -> None:
        """The parameters of an agent that does not say them as an agent would are not shown."""
        self.parameters = {}

    def _on_answer(self, what: str, response: Any) -> None:
        is_reset = what == "reset" and response.success
        text = ResetAnswer.from_json(response.message).text if is_reset else response.message
        message = shortened(text, MAX_ANSWER)
        self.answer = f"{what}: {message}" if response.success else f"{what} REFUSED: {message}"

    def _on_failure(self, what: str, error: RledError) -> None:
        self.answer = f"{what}: {shortened(str(error), MAX_ANSWER)}"

    def _on_set(self, name: str, value: float | str, response: Any) -> None:
        if len(response.results) != 1:
            raise ContractError(f"{len(response.results)} answers to one parameter", "one")
        result = response.results[0]
        self.answer = (
            f"{name} is {value}" if result.successful else f"{name} REFUSED: {shortened(result.reason, MAX_ANSWER)}"
        )


def _value(value: float | str) -> ParameterValue:
    if isinstance(value, str):
        return ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
    return ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=float(value))


def _plain(name: str, value: ParameterValue) -> float | str:
    """The value of a parameter.

    Raises:
        ContractError: it is of another type, or too long, or no finite number.
    """
    if value.type == ParameterType.PARAMETER_STRING and isinstance(AGENT_PARAMETERS[name], str):
        return shortened(value.string_value, MAX_ANSWER)
    if value.type != ParameterType.PARAMETER_DOUBLE or not math.isfinite(value.double_value):
        raise ContractError(f"parameter {name} of the agent of type {value.type}", "a finite number")
    return float(value.double_value)
