"""The only ways in which a node is called: timers, services, subscriptions, events. Nothing raises into an executor.

What an exception does there depends on the executor and the kind of callback; in the events executor it may be a
segmentation fault. So what a callback raises is logged with its place, and the node goes on: whatever other processes
send is a message, and no reason to end. What does end a node is raised as ``Ending``; ``spin`` hands it on.
"""

import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from rled_msgs_py.errors import RledError, Unreadable, one_line

LOG_PERIOD = 1.0
"""Seconds in which a callback's errors are logged once."""
_endings: WeakKeyDictionary[Node, Exception] = WeakKeyDictionary()


class Ending(Exception):
    """Raised in a callback: ends the node with the exception that it holds, a ``RledError`` or an ``OSError``."""


@contextmanager
def ends_node() -> Iterator[None]:
    """In a callback: a mistake of the user's, or a file that cannot be read or written, ends the node."""
    try:
        yield
    except (RledError, OSError) as error:
        raise Ending(error) from error


def raise_ending(node: Node) -> None:
    """Raise what has ended a node, if anything has; who spins it calls this between two callbacks."""
    if (error := _endings.pop(node, None)) is not None:
        raise error


def guarded(node: Node, name: str, callback: Callable[..., Any], failed: Callable[..., Any] | None = None) -> Any:
    """A callback that raises nothing.

    Args:
        node: logs what was raised.
        name: of what calls it, for the log.
        callback: the callback.
        failed: makes what is returned when the callback raised, None otherwise; takes the exception and what the
            callback took.
    """
    said = -LOG_PERIOD

    def call(*values: Any) -> Any:
        nonlocal said
        try:
            return callback(*values)
        except Exception as error:  # of whatever kind: see above
            if isinstance(error, Ending):
                _endings.setdefault(node, error.args[0])
            elif node.context.ok() and time.monotonic() - said >= LOG_PERIOD:
                said = time.monotonic()
                _log(node, name, error)
            return failed(error, *values) if failed is not None else None

    return call


def _log(node: Node, name: str, error: Exception) -> None:
    text = one_line(str(error))
    if isinstance(error, RledError):
        node.get_logger().warning(f"{name}: {text}")
        return
    last = traceback.extract_tb(error.__traceback__)[-1]
    node.get_logger().error(f"{name}: {type(error).__name__} at {Path(last.filename).name}:{last.lineno}: {text[:300]}")


def every(node: Node, period: float, callback: Callable[[], Any]) -> Timer:
    """Call ``callback`` every ``period`` seconds of the steady clock."""
    steady = Clock(clock_type=ClockType.STEADY_TIME)
    return node.create_timer(period, guarded(node, "a timer", callback), clock=steady)


def serve(node: Node, kind: Any, name: str, callback: Callable[[Any, Any], Any]) -> Service:
    """Offer a service that has a ``message``; a request on which ``callback`` fails is answered as refused."""

    def sayable(request: Any, response: Any) -> Any:
        answer = callback(request, response)
        answer.message = answer.message.encode(errors="replace").decode()  # a path may hold what is not
        return answer

    def refuse(error: Exception, request: Any, response: Any) -> Any:
        return kind.Response(success=False, message=str(error).encode(errors="replace").decode())

    return node.create_service(kind, name, guarded(node, name, sayable, refuse))


def shield_services(node: Node) -> None:
    """Keep requests that rclpy's own parameter services choke on (a parameter of type 255) from ending the node."""
    for each in node.services:
        each.callback = guarded(node, each.srv_name, each.callback, lambda error, request, response: response)


def listen(
    node: Node,
    kind: type,
    name: str,
    qos: QoSProfile,
    callback: Callable[[bytes], Any],
    limit: int | None = None,
    events: SubscriptionEventCallbacks | None = None,
) -> Subscription:
    """Call ``callback`` with the bytes of each message on a topic.

    Args:
        node: the node.
        kind: the topic's message class.
        name: the topic's name.
        qos: of the reader.
        callback: takes a serialized message.
        limit: maximum bytes of a message, where the callback does not look itself; a larger one is dropped, and logged.
        events: from ``subscription_events``.
    """

    def received(data: bytes) -> None:
        if limit is not None and len(data) > limit:
            raise Unreadable(f"a message of {len(data)} bytes", f"{limit} at most")
        callback(data)

    call = guarded(node, name, received)
    return node.create_subscription(kind, name, call, qos, raw=True, event_callbacks=events)


def subscription_events(node: Node, **callbacks: Callable[[Any], Any]) -> SubscriptionEventCallbacks:
    """Callbacks for events of a reader: ``liveliness`` and the like."""
    return SubscriptionEventCallbacks(**{name: guarded(node, name, each) for name, each in callbacks.items()})


def publisher_events(node: Node, **callbacks: Callable[[Any], Any]) -> PublisherEventCallbacks:
    """Callbacks for events of a writer: ``matched`` and the like."""
    return PublisherEventCallbacks(**{name: guarded(node, name, each) for name, each in callbacks.items()})
