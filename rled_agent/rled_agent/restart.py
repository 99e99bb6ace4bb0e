"""Begin an episode of a running simulation, from another node."""

from collections.abc import Callable
from typing import Any

from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rled_msgs_py.errors import RledError
from std_srvs.srv import Trigger


class Restart:
    """The ``~/reset`` of a simulation node, and its seed.

    Args:
        node: asks.
        wait: spins that node until a predicate holds, and raises when that takes too long; gets the predicate and the
            name of what is waited for.
        simulation: name of the simulation node.
    """

    def __init__(self, node: Node, wait: Callable[[Callable[[], bool], str], None], simulation: str = "sim") -> None:
        self._wait = wait
        self._reset = node.create_client(Trigger, f"{simulation}/reset")
        self._parameters = node.create_client(SetParameters, f"{simulation}/set_parameters")

    def begin(self, seed: int | None = None) -> int:
        """Begin the next episode now; with a seed, the simulation's random draws begin anew.

        Returns:
            Stamp of its first tick (ns).

        Raises:
            RledError: the simulation refuses, or does not answer.
        """
        if seed is not None:
            wanted = Parameter("seed", value=seed).to_parameter_msg()
            for result in self._call(self._parameters, SetParameters.Request(parameters=[wanted])).results:
                if not result.successful:
                    raise RledError(f"the simulation refused seed {seed}: {result.reason}")
        answer = self._call(self._reset, Trigger.Request())
        if not answer.success:
            raise RledError(f"the simulation refused a reset: {answer.message}")
        return int(answer.message.split()[-2])

    def _call(self, client: Any, request: Any) -> Any:
        self._wait(client.service_is_ready, f"service {client.srv_name}")
        future = client.call_async(request)
        self._wait(future.done, f"an answer of {client.srv_name}")
        return future.result()
