"""Nothing that a callback of a node does raises into its executor."""

import ast
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.ros.callbacks import Ending, ends_node, every, guarded, listen, publisher_events, raise_ending, serve
from rled_msgs_py.ros.client import MAX_WAITING, Client
from rled_msgs_py.ros.node import fresh_context, on_set, spin_until
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

ROOT = Path(__file__).parents[2]
PACKAGES = ("rled_agent", "rled_msgs_py", "rled_sim", "rled_teleop")
RAW = {
    "create_timer", "create_service", "create_client", "call_async", "add_done_callback", "create_subscription",
    "add_on_set_parameters_callback", "add_post_set_parameters_callback", "add_pre_set_parameters_callback",
    "PublisherEventCallbacks", "SubscriptionEventCallbacks", "create_guard_condition",
}  # fmt: skip
"""What has a node called, unguarded."""
GUARDED = {"callbacks.py", "client.py", "node.py"}
ERRORS = [RuntimeError("no"), IndexError(), ContractError("a message", "none"), ZeroDivisionError("x" * 10**6)]


def test_nodes_are_called_in_guarded_ways_only() -> None:
    found = []
    for path in (each for package in PACKAGES for each in (ROOT / package).rglob("*.py")):
        if path.name in GUARDED and path.parent.name == "ros":
            continue
        for call in (each for each in ast.walk(ast.parse(path.read_text())) if isinstance(each, ast.Call)):
            name = getattr(call.func, "attr", getattr(call.func, "id", ""))
            if name in RAW:
                found.append(f"{path.relative_to(ROOT)}:{call.lineno} {name}")
    assert found == []


class Pair:
    """Two nodes, the second one in an executor of a kind."""

    def __init__(self, kind: Callable[..., Any]) -> None:
        self.context = fresh_context()
        self.other, self.node = (Node(name, context=self.context) for name in ("other", "node"))
        self.executor, self.mine = kind(context=self.context), SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.mine.add_node(self.other)

    def until(self, done: Callable[[], object]) -> None:
        deadline = time.monotonic() + 20.0
        while not done():
            assert time.monotonic() < deadline
            self.executor.spin_once(timeout_sec=0.01)
            self.mine.spin_once(timeout_sec=0.01)

    def answer(self, kind: Any, name: str, **request: Any) -> Any:
        client = self.other.create_client(kind, name)
        self.until(client.service_is_ready)
        future = client.call_async(kind.Request(**request))
        self.until(future.done)
        return future.result()


@pytest.fixture(params=[EventsExecutor, SingleThreadedExecutor], ids=["events", "single"])
def pair(request: pytest.FixtureRequest) -> Iterator[Pair]:
    pair = Pair(request.param)
    yield pair
    pair.executor.remove_node(pair.node)
    pair.mine.shutdown()
    pair.context.try_shutdown()


def test_whatever_callbacks_raise_the_node_goes_on(pair: Pair) -> None:
    calls: dict[str, int] = dict.fromkeys(("timer", "topic", "service", "answer", "event", "set"), 0)

    def raising(what: str) -> Callable[..., Any]:
        def call(*_: Any) -> Any:
            calls[what] += 1
            raise ERRORS[calls[what] % len(ERRORS)]

        return call

    pair.node.declare_parameter("a", 1)
    on_set(pair.node, raising("set"))
    every(pair.node, 0.02, raising("timer"))
    listen(pair.node, String, "topic", QoSProfile(depth=10), raising("topic"))
    serve(pair.node, SetBool, "service", raising("service"))
    events = publisher_events(pair.node, matched=raising("event"))
    pair.node.create_publisher(String, "watched", 1, event_callbacks=events)
    pair.other.create_service(Trigger, "asked", lambda request, response: response)
    client, failures = Client(pair.node, Trigger, "asked"), list[RledError]()
    talker = pair.other.create_publisher(String, "topic", 1)
    readers = [pair.other.create_subscription(String, "watched", lambda message: None, 1) for _ in ERRORS]
    for _ in ERRORS:
        assert not pair.answer(SetBool, "service").success
        pair.until(lambda: client.is_ready)
        client.ask(Trigger.Request(), raising("answer"), failures.append)
        before = calls["topic"]
        pair.until(lambda: talker.get_subscription_count())
        talker.publish(String(data="x"))
        pair.until(lambda: calls["topic"] > before)  # noqa: B023
        assert pair.node.set_parameters([Parameter("a", value=2)])[0].successful
    pair.until(lambda: calls["event"] and calls["timer"] >= len(ERRORS) and len(failures) == len(ERRORS))
    assert calls["topic"] == calls["service"] == calls["answer"] == calls["set"] == len(ERRORS)
    assert readers


def test_a_service_that_does_not_answer_is_given_up(pair: Pair) -> None:
    """The server is served by nobody; what comes too late comes to nobody."""
    service = pair.other.create_service(Trigger, "asked", lambda request, response: response)
    pair.mine.remove_node(pair.other)
    client, answers, failures = Client(pair.node, Trigger, "asked", timeout=0.2), list[Any](), list[RledError]()
    pair.until(lambda: client.is_ready)
    for _ in range(MAX_WAITING + 3):
        client.ask(Trigger.Request(), answers.append, failures.append)
    assert len(failures) == 3
    pair.until(lambda: len(failures) == MAX_WAITING + 3)
    assert "has not answered for 0.2 s" in str(failures[-1])
    pair.mine.add_node(pair.other)
    answered = []
    client.ask(Trigger.Request(), answered.append, failures.append)
    pair.until(lambda: answered)
    assert (answers, bool(service)) == ([], True)


def test_what_ends_a_node_is_handed_on_by_who_spins_it(pair: Pair) -> None:
    def end() -> None:
        with ends_node():
            raise OSError(28, "No space left on device")

    every(pair.node, 0.01, end)
    ended = []

    def done() -> bool:
        try:
            raise_ending(pair.node)
        except OSError as error:
            ended.append(error)
        return bool(ended)

    pair.until(done)
    assert ended[0].errno == 28


def test_spinning_ends_with_what_a_callback_raised_as_the_end() -> None:
    pair = Pair(SingleThreadedExecutor)

    def end() -> None:
        raise Ending(RledError("the robot of another policy"))

    every(pair.node, 0.01, end)
    with pytest.raises(RledError, match="another policy"):
        spin_until(pair.executor, lambda: False, 20.0, "the end")
    pair.context.try_shutdown()


def test_an_error_is_logged_once_a_second_with_its_place() -> None:
    said: list[str] = []
    logger = SimpleNamespace(error=said.append, warning=said.append)
    node: Any = SimpleNamespace(get_logger=lambda: logger, context=SimpleNamespace(ok=lambda: True))

    def wrong() -> None:
        raise KeyError("x" * 10**6)

    call = guarded(node, "a timer", wrong, lambda error: "refused")
    assert [call() for _ in range(5)] == ["refused"] * 5
    assert len(said) == 1
    assert "a timer: KeyError at test_callbacks.py:" in said[0]
    assert len(said[0]) < 500
