"""Starting a node, its parameters and its end, the same way for every node of the graph."""

import gc
import re
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from threading import Event
from typing import Any, TypeVar

import rclpy
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription

from rled_msgs_py.environment import held_stderr, settle
from rled_msgs_py.errors import ContractError, RledError, command_line
from rled_msgs_py.messages import decode
from rled_msgs_py.middleware import return_blocks, return_messages
from rled_msgs_py.params import Spec, build, parameters_of, parse_command_line
from rled_msgs_py.records import Text
from rled_msgs_py.ros.callbacks import guarded, listen, raise_ending, shield_services
from rled_msgs_py.ros.convert import MESSAGE_CLASSES, qos_profile
from rled_msgs_py.stopping import stop_requested
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import STATE_TOPICS, StateRecord, Tick, TickAssembler
from rled_msgs_py.topics import TASK_DESCRIPTION, Topic

P = TypeVar("P")
RCLError: type[Exception] = rclpy_implementation.RCLError
STOP_WAIT = 0.1
"""Longest wait for work before a request to stop is looked at (s)."""


def advertise(node: Node, topic: Topic) -> Publisher:
    """A publisher on a topic of the contract."""
    return node.create_publisher(MESSAGE_CLASSES[topic.type], topic.name, qos_profile(topic.qos))


def subscribe(
    node: Node,
    topic: Topic,
    callback: Callable[[Any], None],
    refused: Callable[[ContractError], None] | None = None,
) -> Subscription:
    """Call ``callback`` with each record on a topic.

    A message that breaks the contract, as it is read or as the callback finds, is dropped, and logged or given to
    ``refused``.
    """

    def received(data: bytes) -> None:
        try:
            callback(decode(topic, data))
        except ContractError as error:
            if refused is None:
                raise
            refused(error)

    kind, qos = MESSAGE_CLASSES[topic.type], qos_profile(topic.qos)
    return listen(node, kind, topic.name, qos, received)


def on_set(node: Node, changed: Callable[[list[Parameter]], None]) -> None:
    """Call ``changed`` with the parameters of each accepted change."""
    node.add_post_set_parameters_callback(guarded(node, "a parameter", changed))


def subscribe_ticks(node: Node, callback: Callable[[Tick], None], depth: int | None = None) -> None:
    """Call ``callback`` with each complete tick.

    Joints that ``task_description`` does not name are passed over, and samples that name some of its joints only are
    put together.

    Args:
        node: the node.
        callback: takes the tick.
        depth: of the readers' queues, when another than the contract's is needed.
    """
    assembler = TickAssembler()

    def received(name: str, record: StateRecord) -> None:
        tick = assembler.add(name, record)
        if tick is not None:
            callback(tick)

    def meet(text: Text) -> None:
        assembler.meet(TaskDescription.from_json(text.data).joint_names)

    subscribe(node, TASK_DESCRIPTION, meet, lambda error: None)  # whoever needs the description says what is wrong
    for topic in STATE_TOPICS:
        deep = replace(topic, qos=replace(topic.qos, depth=depth or topic.qos.depth))
        subscribe(node, deep, partial(received, topic.name))


def _descriptor(spec: Spec, default: Any) -> ParameterDescriptor:
    constraints = "one of: " + ", ".join(spec.choices) if spec.choices else ""
    descriptor = ParameterDescriptor(
        description=spec.description, read_only=spec.read_only, additional_constraints=constraints
    )
    if spec.low is not None and spec.high is not None:
        if isinstance(default, int):
            descriptor.integer_range = [IntegerRange(from_value=int(spec.low), to_value=int(spec.high), step=0)]
        else:
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(spec.low), to_value=float(spec.high), step=0.0)
            ]
    return descriptor


def declare(
    node: Node,
    params: type[P],
    changed: Callable[[P], None] | None = None,
    accept: Callable[[P], None] = lambda _: None,
) -> P:
    """Declare a dataclass's fields as ROS parameters and return their values.

    Args:
        node: the node.
        params: a frozen dataclass whose fields were made by ``param``.
        changed: called with the new record after an accepted change.
        accept: called with the new record before a change; what it raises refuses the change.

    Raises:
        ContractError: a value given at the start is out of its range or of another type.
    """
    known = parameters_of(params)
    shield_services(node)
    for each in known:
        try:
            node.declare_parameter(each.name, each.default, _descriptor(each.spec, each.default))
        except Exception as error:  # rclpy raises several unrelated types here
            accepted = ", ".join(each.spec.choices) or (
                f"{each.spec.low} to {each.spec.high}" if each.spec.low is not None else type(each.default).__name__
            )
            raise ContractError(f"parameter {each.name}: {error}", accepted) from None

    def current() -> dict[str, Any]:
        return {each.name: node.get_parameter(each.name).value for each in known}

    def validate(proposed: list[Parameter]) -> SetParametersResult:
        mine = {each.name for each in known}
        try:
            accept(build(params, current() | {each.name: each.value for each in proposed if each.name in mine}))
        except (RledError, TypeError) as error:
            return refuse(error)
        return SetParametersResult(successful=True)

    def refuse(error: Exception, *_: object) -> SetParametersResult:
        return SetParametersResult(successful=False, reason=str(error))

    def apply(_: list[Parameter]) -> None:
        if changed is not None:
            changed(build(params, current()))

    record = build(params, current())
    node.add_on_set_parameters_callback(guarded(node, "a parameter", validate, refuse))
    on_set(node, apply)
    return record


def start_ros(arguments: Sequence[str] = (), context: Context | None = None, domain: int | None = None) -> None:
    """``rclpy.init`` without its signal handlers, after a look at what it will read.

    Args:
        arguments: program and ``--ros-args ...``.
        context: which one; the default one by default.
        domain: in place of ``ROS_DOMAIN_ID``.

    Raises:
        RledError: a variable, an argument or a parameter file that ROS does not take.
    """
    settle(arguments, with_domain=domain is None)
    options = SignalHandlerOptions.NO
    try:
        with held_stderr():
            rclpy.init(args=list(arguments), context=context, domain_id=domain, signal_handler_options=options)
    except Exception as error:  # rclpy raises several unrelated types here
        raise _not_started(error) from None


def _not_started(error: Exception) -> RledError:
    reason = re.sub(r", at /\S+:\d+", "", str(error)) or type(error).__name__
    return RledError(f"ROS does not start: {reason}", "", "see what follows --ros-args, and the variables ROS_...")


def run_node(
    make: Callable[..., Node],
    params: type[Any],
    program: str,
    summary: str,
    work: Callable[[Any, Event], None] | None = None,
) -> None:
    """``main`` of a node: parse the command line, spin until SIGINT or SIGTERM, destroy, shut down.

    Args:
        make: called as ``make(parameter_overrides=[...])`` after ``rclpy.init``.
        params: parameter dataclass, for ``--name value`` and ``--help``.
        program: name of the executable.
        summary: what it does, for ``--help``.
        work: what is done with the node until the event is set; to spin it by default.
    """

    def main() -> None:
        given, ros_arguments = parse_command_line(params, program, summary, sys.argv[1:])
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        return_messages()
        return_blocks()
        node: Node | None = None
        with stop_requested() as stop:  # to the end: who asks twice does not cut short what is being saved
            try:
                start_ros([program, *ros_arguments])
                node = _made(make, overrides)
                gc.freeze()  # what the imports brought is never looked at again: shorter pauses, a quicker end
                (work or spin)(node, stop)
            finally:
                if node is not None:
                    node.destroy_node()
                rclpy.try_shutdown()

    command_line(main)()


def _made(make: Callable[..., Node], overrides: list[Parameter]) -> Node:
    try:
        return make(parameter_overrides=overrides)
    except RCLError as error:
        raise _not_started(error) from None


def spin(node: Node, stop: Event, executor: Executor | None = None) -> None:
    """Spin one node until it is asked to stop, or shuts its context down itself.

    Raises:
        RledError: a callback ended the node.
        OSError: the same, for a file.
    """
    executor = executor or SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    try:
        while not stop.is_set() and node.context.ok():
            executor.spin_once(timeout_sec=STOP_WAIT)
            raise_ending(node)
    finally:
        executor.remove_node(node)


def spin_until(executor: Executor, done: Callable[[], bool], timeout: float, what: str) -> None:
    """Spin until a predicate holds.

    Raises:
        RledError: it did not hold within ``timeout`` seconds, or a node ends.
    """
    deadline = time.monotonic() + timeout
    while not done():
        if time.monotonic() > deadline:
            raise RledError(f"waited {timeout:g} s for {what}", "", "is the other node running in this ROS_DOMAIN_ID?")
        executor.spin_once(timeout_sec=0.05)
        for node in executor.get_nodes():
            raise_ending(node)


def fresh_context(domain: int | None = None, arguments: Sequence[str] = ()) -> Context:
    """A context of its own, for composing nodes in one process or for a test."""
    return_messages()
    context = Context()
    start_ros(arguments, context, domain)
    return context
