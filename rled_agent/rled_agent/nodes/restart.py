"""Begin an episode of a running simulation, from another node."""

from collections.abc import Callable

from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rled_msgs_py.errors import RledError
from rled_msgs_py.reset_answer import ResetAnswer
from rled_msgs_py.ros.client import Client
from std_srvs.srv import Trigger

ANSWER_TIMEOUT = 30.0
"""Seconds that an answer is waited for when ``wait`` does not give up before."""


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
        self._reset = Client(node, Trigger, f"{simulation}/reset", ANSWER_TIMEOUT)
        self._parameters = Client(node, SetParameters, f"{simulation}/set_parameters", ANSWER_TIMEOUT)
        self._asked = Client(node, GetParameters, f"{simulation}/get_parameters", ANSWER_TIMEOUT)

    def is_repeatable(self) -> bool:
        """Whether what is begun with a seed is the same again: of a simulation in lockstep, of nothing else.

        Raises:
            RledError: no answer.
        """
        values = self._asked.call(GetParameters.Request(names=["mode", "seed"]), self._wait).values
        return [value.string_value for value in values[:1]] == ["lockstep"]

    def begin(self, seed: int | None = None) -> int:
        """Begin the next episode now; with a seed, the simulation's random draws begin anew.

        Returns:
            Stamp of its first tick (ns).

        Raises:
            RledError: the simulation refuses, or does not answer.
        """
        if seed is not None:
            wanted = Parameter("seed", value=seed).to_parameter_msg()
            results = self._parameters.call(SetParameters.Request(parameters=[wanted]), self._wait).results
            if len(results) != 1:
                raise RledError(f"{len(results)} answers of {self._parameters.name} to one parameter", "one")
            if not results[0].successful:
                raise RledError(f"the simulation refused seed {seed}: {results[0].reason}")
        answer = self._reset.call(Trigger.Request(), self._wait)
        if not answer.success:
            raise RledError(f"the simulation refused a reset: {answer.message}")
        return ResetAnswer.from_json(answer.message).stamp
