"""A stranger that has the names of our nodes, offers their services and answers nonsense: ``impostor.py NAME ...``.

Each service gives its answers in turn, among them none at all, late ones, and two to one request.
"""

import sys
import time
from collections.abc import Iterator
from typing import Any

import rclpy
from rcl_interfaces.msg import ListParametersResult, ParameterValue, SetParametersResult
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

SERVICES: dict[str, dict[str, type]] = {
    "sim": {"reset": Trigger, "pause": SetBool, "estop": SetBool},
    "agent_node": {"enable": SetBool, "estop": SetBool, "learn": SetBool, "save": Trigger},
    "record_demos": {"record": SetBool, "keep": Trigger, "discard": Trigger, "mark_pose": Trigger},
}
PARAMETERS = {"list_parameters": ListParameters, "get_parameters": GetParameters, "set_parameters": SetParameters}
NAMES = ["threshold", "measure", "query_timeout", "phi"]
LONG = "x" * 3_000_000
BEGINS = [f'{{"text": "", "episode": 1, "stamp": {stamp}}}' for stamp in ("-", "-5", '"½"', "1e9", str(9**400))]
TEXTS = ["", "1 2", "episode 1", *BEGINS, "a\0b", "\n" * 99, LONG]
LISTS = [NAMES, [], NAMES * 2000, NAMES, ["threshold"] * 9, [""], [LONG], NAMES, [LONG, *NAMES]]
VALUES = [
    [],
    [ParameterValue()] * 3,
    [ParameterValue(type=kind) for kind in (0, 1, 255, 9)],
    [ParameterValue(type=4, string_value=LONG)] * 4,
    [ParameterValue(type=3, double_value=value) for value in (float("nan"), float("inf"), 1e308, -1.0)],
    [ParameterValue()] * 2000,
]
RESULTS = [[], [SetParametersResult(successful=True)] * 9, [SetParametersResult(reason=LONG)]]
SILENT, LATE, TWICE = "no answer", "a late answer", "two answers"
DELAY = 7.0
"""How late an answer is (s): later than it is waited for."""


def answers_of(kind: Any) -> list[Any]:
    """What a service of a kind answers, one after the other."""
    if kind is ListParameters:
        said = [kind.Response(result=ListParametersResult(names=names)) for names in LISTS]
    elif kind is GetParameters:
        said = [kind.Response(values=values) for values in VALUES]
    elif kind is SetParameters:
        said = [kind.Response(results=results) for results in RESULTS]
    else:
        said = [kind.Response(success=good, message=text) for good in (True, False) for text in TEXTS]
    return [*said, SILENT, TWICE, LATE]


class Liar:
    """One service of the stranger's, served by hand, so that it may answer as no executor would."""

    def __init__(self, node: Node, name: str, kind: Any) -> None:
        self._service, self._kind = node.create_service(kind, f"~/{name}", lambda request, response: response), kind
        self._turns, self._late = self._cycle(name), list[tuple[float, Any]]()

    def _cycle(self, name: str) -> Iterator[Any]:
        while True:
            yield from answers_of(self._kind)
            print(f"all of {name}", flush=True)

    def look(self) -> None:
        """Answer the request that waits, if one does, and those that are due."""
        with self._service.handle:
            handle = self._service.handle
            _, header = handle.service_take_request(self._kind.Request)
            if header is not None:
                self._answer(handle, header.request_id, next(self._turns))
            while self._late and self._late[0][0] < time.monotonic():
                handle.service_send_response(self._kind.Response(), self._late.pop(0)[1])

    def _answer(self, handle: Any, request: Any, said: Any) -> None:
        if said is LATE:
            self._late.append((time.monotonic() + DELAY, request))
        elif said is not SILENT:
            for response in [self._kind.Response()] * 2 if said is TWICE else [said]:
                handle.service_send_response(response, request)


def main() -> None:
    """Answer until it is ended."""
    rclpy.init()
    liars = []
    for name in sys.argv[1:]:
        node = Node(name, start_parameter_services=False)
        liars += [Liar(node, each, kind) for each, kind in (SERVICES[name] | PARAMETERS).items()]
    print("there", flush=True)
    while rclpy.ok():
        for each in liars:
            each.look()
        time.sleep(0.002)


if __name__ == "__main__":
    main()
