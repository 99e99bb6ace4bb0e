"""What the page asks of the nodes around it, called without waiting for the answers."""

from functools import partial
from typing import Any, NamedTuple

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

AGENT_PARAMETERS = ("threshold", "measure", "query_timeout", "phi")
"""Adjustable ones, of which an agent has some."""


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
        def client(service: Service) -> Any:
            kind = Trigger if service.switch is None else SetBool
            return node.create_client(kind, f"{names[service.node]}/{service.name}")

        by_path = {(each.node, each.name): client(each) for each in SERVICES.values()}
        self._clients = {what: by_path[(each.node, each.name)] for what, each in SERVICES.items()}
        agent = names["agent"]
        self._list = node.create_client(ListParameters, f"{agent}/list_parameters")
        self._get = node.create_client(GetParameters, f"{agent}/get_parameters")
        self._set = node.create_client(SetParameters, f"{agent}/set_parameters")
        self.answer = ""
        self.parameters: dict[str, Any] = {}

    @property
    def has_agent(self) -> bool:
        """Whether an agent answers."""
        return bool(self._clients["enable"].service_is_ready())

    def ask(self, what: str) -> None:
        """Call a service; ``answer`` changes when it has answered."""
        if (also := f"agent {what}") in SERVICES and self.has_agent:
            self.ask(also)
        client, service = self._clients[what], SERVICES[what]
        if not client.service_is_ready():
            self.answer = f"{what}: no node offers {client.srv_name}"
            return
        request = Trigger.Request() if service.switch is None else SetBool.Request(data=service.switch)
        client.call_async(request).add_done_callback(partial(self._on_answer, what))

    def set(self, name: str, value: float | str) -> None:
        """Set a parameter of the agent."""
        if not self._set.service_is_ready():
            self.answer = f"{name}: no agent is running"
            return
        parameter = Parameter(name=name, value=_value(value))
        future = self._set.call_async(SetParameters.Request(parameters=[parameter]))
        future.add_done_callback(partial(self._on_set, name, value))

    def look(self) -> None:
        """Ask for the agent's parameters; call it now and then."""
        if not self.has_agent:
            self.parameters = {}
        elif self._list.service_is_ready():
            self._list.call_async(ListParameters.Request()).add_done_callback(self._on_list)

    def _on_list(self, future: Any) -> None:
        names = [each for each in future.result().result.names if each in AGENT_PARAMETERS]
        request = GetParameters.Request(names=names)
        if names and self._get.service_is_ready():
            self._get.call_async(request).add_done_callback(partial(self._on_values, names))

    def _on_values(self, names: list[str], future: Any) -> None:
        values = future.result().values
        self.parameters = {name: _plain(each) for name, each in zip(names, values, strict=True)}

    def _on_answer(self, what: str, future: Any) -> None:
        response = future.result()
        self.answer = f"{what}: {response.message}" if response.success else f"{what} REFUSED: {response.message}"

    def _on_set(self, name: str, value: float | str, future: Any) -> None:
        result = future.result().results[0]
        self.answer = f"{name} is {value}" if result.successful else f"{name} REFUSED: {result.reason}"


def _value(value: float | str) -> ParameterValue:
    if isinstance(value, str):
        return ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
    return ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=float(value))


def _plain(value: ParameterValue) -> float | str:
    return str(value.string_value) if value.type == ParameterType.PARAMETER_STRING else float(value.double_value)
