"""The recorder's services, called without waiting for the answer."""

from typing import Any

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from rled_teleop.keys import Request

SERVICES = {
    Request.START: (SetBool, "record", SetBool.Request(data=True)),
    Request.STOP: (SetBool, "record", SetBool.Request(data=False)),
    Request.KEEP: (Trigger, "keep", Trigger.Request()),
    Request.DISCARD: (Trigger, "discard", Trigger.Request()),
    Request.MARK: (Trigger, "mark_pose", Trigger.Request()),
}


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
        self._clients = {name: node.create_client(kind, f"{recorder}/{name}") for name, kind in kinds.items()}
        self.answer = "nothing asked yet"

    @property
    def is_ready(self) -> bool:
        """Whether a recorder answers."""
        return bool(self._clients["record"].service_is_ready())

    def ask(self, request: Request) -> None:
        """Send a request; ``answer`` changes when the recorder has answered."""
        _, name, message = SERVICES[request]
        client = self._clients[name]
        if not client.service_is_ready():
            self.answer = f"{request.value}: no recorder is running (start record_demos)"
            return
        self.answer = f"{request.value} ..."
        client.call_async(message).add_done_callback(self._on_answer)

    def _on_answer(self, future: Any) -> None:
        response = future.result()
        self.answer = response.message if response.success else f"REFUSED: {response.message}"
