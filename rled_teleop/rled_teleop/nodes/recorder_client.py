"""The recorder's services, asked without waiting for the answer."""

from typing import Any

from rclpy.node import Node
from rled_msgs_py.errors import RledError, shortened
from rled_msgs_py.ros.client import Client
from std_srvs.srv import SetBool, Trigger

from rled_teleop.operators.keys import Request

SERVICES = {
    Request.START: (SetBool, "record", SetBool.Request(data=True)),
    Request.STOP: (SetBool, "record", SetBool.Request(data=False)),
    Request.KEEP: (Trigger, "keep", Trigger.Request()),
    Request.DISCARD: (Trigger, "discard", Trigger.Request()),
    Request.MARK: (Trigger, "mark_pose", Trigger.Request()),
}

MAX_ANSWER = 300
"""Characters of an answer that are shown."""


class RecorderClient:
    """Asks the recorder for what a person wants.

    Args:
        node: whose clients these are.
        recorder: name of the recorder's node.

    Attributes:
        answer: what it said last, in words.
    """

    def __init__(self, node: Node, recorder: str) -> None:
        kinds = {name: kind for kind, name, _ in SERVICES.values()}
        self._clients = {name: Client(node, kind, f"{recorder}/{name}") for name, kind in kinds.items()}
        self.answer = "nothing asked yet"

    @property
    def is_ready(self) -> bool:
        """Whether a recorder answers."""
        return self._clients["record"].is_ready

    def ask(self, request: Request) -> None:
        """Send a request; ``answer`` changes when the recorder has answered."""
        _, name, message = SERVICES[request]
        client = self._clients[name]
        if not client.is_ready:
            self.answer = f"{request.value}: no recorder is running (start record_demos)"
            return
        self.answer = f"{request.value} ..."
        client.ask(message, self._on_answer, self._on_failure)

    def _on_answer(self, response: Any) -> None:
        message = shortened(response.message, MAX_ANSWER)
        self.answer = message if response.success else f"REFUSED: {message}"

    def _on_failure(self, error: RledError) -> None:
        self.answer = shortened(str(error), MAX_ANSWER)
