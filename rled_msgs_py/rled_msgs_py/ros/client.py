"""Services of other nodes, whose answers are data to be checked like any other."""

import time
from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from rled_msgs_py.errors import RledError
from rled_msgs_py.ros.callbacks import every, guarded

MAX_WAITING = 8
"""Requests to one service that may wait for their answers."""
POLL_PERIOD = 0.5
"""Seconds between two polls of answers that are overdue."""


class Client:
    """Asks one service; whatever it answers, or does not, raises nothing.

    Args:
        node: asks.
        kind: of the service.
        name: of the service.
        timeout: how long an answer is waited for (s).
    """

    def __init__(self, node: Node, kind: Any, name: str, timeout: float = 5.0) -> None:
        self._node, self._timeout = node, timeout
        self._client = node.create_client(kind, name)
        self._waiting: dict[Any, tuple[float, Callable[[RledError], Any]]] = {}
        every(node, POLL_PERIOD, self._give_up)

    @property
    def name(self) -> str:
        """Of the service."""
        return str(self._client.srv_name)

    @property
    def is_ready(self) -> bool:
        """Whether a node offers the service."""
        return bool(self._client.service_is_ready())

    def ask(self, request: Any, answered: Callable[[Any], Any], failed: Callable[[RledError], Any]) -> None:
        """Send a request; returns at once.

        Args:
            request: the request.
            answered: takes the answer; raises a ``RledError`` when it makes no sense.
            failed: told when there is no answer in time, or none that makes sense.
        """
        if len(self._waiting) >= MAX_WAITING:
            failed(RledError(f"{self.name} does not answer"))
            return
        future = self._client.call_async(request)
        self._waiting[future] = time.monotonic() + self._timeout, failed

        def settle(future: Any) -> None:
            if self._waiting.pop(future, None) is None:  # too late
                return
            try:
                answered(future.result())
            except RledError as error:
                failed(error)
            except Exception as error:
                failed(RledError(f"{self.name} answers what makes no sense"))
                raise error from None  # logged, with its place

        future.add_done_callback(guarded(self._node, self.name, settle))

    def call(self, request: Any, wait: Callable[[Callable[[], bool], str], None]) -> Any:
        """The answer to a request.

        Args:
            request: the request.
            wait: spins the node until a predicate holds; gets the predicate and the name of what is waited for.

        Raises:
            RledError: there was none in time.
        """
        answers: list[Any] = []
        errors: list[RledError] = []
        wait(lambda: self.is_ready, f"service {self.name}")
        self.ask(request, answers.append, errors.append)
        wait(lambda: bool(answers or errors), f"an answer of {self.name}")
        if errors:
            raise errors[0]
        return answers[0]

    def _give_up(self) -> None:
        overdue = [future for future, (until, _) in self._waiting.items() if until < time.monotonic()]
        for future in overdue:
            _, failed = self._waiting.pop(future)
            self._client.remove_pending_request(future)
            failed(RledError(f"{self.name} has not answered for {self._timeout:g} s"))
