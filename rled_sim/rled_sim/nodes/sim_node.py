"""Node: the simulated robot and its task, in lockstep or in real time."""

import time
from collections.abc import Callable
from functools import partial
from threading import Event
from typing import Any

from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time import Time
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.messages import encode
from rled_msgs_py.records import DeltaCommand, PoseSample, Record, Text
from rled_msgs_py.reset_answer import ResetAnswer
from rled_msgs_py.ros.callbacks import every, serve
from rled_msgs_py.ros.liveliness import advertise_with_deadline, offer_liveliness
from rled_msgs_py.ros.node import advertise, declare, on_set, run_node, spin, subscribe
from rled_msgs_py.tick import STATE_TOPICS, Tick
from rled_msgs_py.topics import (
    CLOCK_TOPIC,
    DIAGNOSTICS,
    JOINT_DELTA,
    JOINT_STATES,
    MARKERS,
    ROBOT_DESCRIPTION,
    TARGET_REQUEST,
    TASK_DESCRIPTION,
    Topic,
)
from rosgraph_msgs.msg import Clock as ClockMessage
from std_srvs.srv import SetBool, Trigger

from rled_sim.commands import Code, Refused
from rled_sim.driver import Driver
from rled_sim.nodes.markers import MarkerView
from rled_sim.report import Report
from rled_sim.robots import robot_named
from rled_sim.sim_params import SimParams, simulation_of

REPORT_PERIOD = 100_000_000
"""A refusal is reported at once, unless a report went out this short a while ago (ns)."""
MODE_TEXTS = {
    "lockstep": "in lockstep: each tick waits for its answer on joint_delta",
    "real_time": "in real time: a tick every {:g} ms",
}


class SimNode(Node):
    """A robot to be driven over ``joint_delta``; in real time its target may be moved by ``target_request``.

    Publishes: joint_states, ee_pose, target_pose, task_status and /clock at each tick; robot_description and
    task_description once; markers and /diagnostics by the wall clock. Services: ~/reset (Trigger), ~/pause and ~/estop
    (SetBool).
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("sim", **options)
        params = declare(self, SimParams, self._on_change)
        _require_alone(self, params.discovery_wait)
        self._simulation = simulation_of(params)
        self._report, self._view = Report(), MarkerView(self._simulation.task.targets.tolist())
        self._driver = Driver(
            self._simulation, params.rules(), params.seed, self._publish, self._report.accepted, params
        )
        self._seed: int | None = None  # set since the last reset, be it to the same value
        on_set(self, self._on_set)
        self._outputs = [self._advertise_state(topic, params) for topic in STATE_TOPICS]
        self._clock_output, self._marker_output = advertise(self, CLOCK_TOPIC), advertise(self, MARKERS)
        self._health_output = advertise(self, DIAGNOSTICS)
        self._descriptions = self._describe(params)
        self._serve()
        self._start_timers(params)
        self._driver.begin()
        takers: tuple[tuple[Topic, Callable[[Any], None]], ...] = (
            (JOINT_DELTA, self._on_delta),
            (TARGET_REQUEST, self._on_target),
        )
        for topic, take in takers:
            subscribe(self, topic, take, partial(self._on_unreadable, topic))
        self.get_logger().info(f"{params.robot} is there, {MODE_TEXTS[params.mode].format(1e3 * params.period)}")

    def _advertise_state(self, topic: Topic, params: SimParams) -> Any:
        if topic is JOINT_STATES and params.mode == "real_time":
            return advertise_with_deadline(self, topic, 2.0 * params.period, self._on_late)
        return advertise(self, topic)

    def _on_late(self, count: int) -> None:
        if not self._driver.paused:
            self._report.late(count)

    def _describe(self, params: SimParams) -> list[Any]:
        texts = {
            ROBOT_DESCRIPTION: robot_named(params.robot).description,
            TASK_DESCRIPTION: self._simulation.task.description.to_json(),
        }
        outputs = {topic: offer_liveliness(self, topic) for topic in texts}
        for topic, text in texts.items():
            outputs[topic].publish(encode(topic, Text(text)))
        return list(outputs.values())

    def _serve(self) -> None:
        serve(self, Trigger, "~/reset", self._on_reset)
        serve(self, SetBool, "~/pause", self._on_pause)
        serve(self, SetBool, "~/estop", self._on_estop)

    def _start_timers(self, params: SimParams) -> None:
        self._health_timer = every(self, 1.0, self._report_health)
        if params.marker_rate > 0.0:
            every(self, 1.0 / params.marker_rate, self._draw)
        if params.mode == "real_time":
            every(self, params.period, self._driver.timer)

    def _publish(self, tick: Tick) -> None:
        self._clock_output.publish(ClockMessage(clock=Time(nanoseconds=tick.stamp).to_msg()))
        records: tuple[Record, ...] = tick
        for topic, output, record in zip(STATE_TOPICS, self._outputs, records, strict=True):
            output.publish(encode(topic, record))
        self._view.add(tick)
        self._report.tick(self._simulation.plant.contacts() if self._simulation.plant.physical else ())
        if self._simulation.refused is not None:
            self._refuse(self._simulation.refused)

    def _on_delta(self, command: DeltaCommand) -> None:
        try:
            self._driver.command(command)
        except Refused as error:
            self._refuse(error)

    def _on_target(self, request: PoseSample) -> None:
        try:
            self._driver.retarget(request)
        except Refused as error:
            self._refuse(error, TARGET_REQUEST)

    def _on_unreadable(self, topic: Topic, error: ContractError) -> None:
        self._refuse(Refused(Code.UNREADABLE, str(error)), topic)

    def _refuse(self, error: Refused, topic: Topic = JOINT_DELTA) -> None:
        self._report.refused(error)
        self.get_logger().warning(f"{topic.name} refused: {error}", throttle_duration_sec=1.0)
        if self._health_timer.time_since_last_call() > REPORT_PERIOD:
            self._health_timer.reset()
            self._report_health()

    def _on_change(self, params: SimParams) -> None:
        self._driver.rules = params.rules()
        self._driver.channel.configure(params)

    def _on_set(self, parameters: list[Parameter]) -> None:
        for each in parameters:
            if each.name == "seed":
                self._seed = each.value

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            self._driver.reset(self._seed)
        except RledError as error:
            response.message = str(error)
            return response
        self._seed = None
        response.success = True
        response.message = ResetAnswer.of(self._driver.number, self._driver.stamp).to_json()
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._driver.pause(request.data)
        response.success, response.message = True, "paused" if request.data else "running"
        return response

    def _on_estop(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._driver.stop(request.data)
        response.success, response.message = True, "stopped until released" if request.data else "released"
        return response

    def _report_health(self) -> None:
        now = self.get_clock().now().nanoseconds
        health = self._report.health(now, self._driver, _simulations(self))
        self._health_output.publish(encode(DIAGNOSTICS, health))

    def _draw(self) -> None:
        if self._marker_output.get_subscription_count():
            self._marker_output.publish(self._view.message())

    def destroy_node(self) -> None:
        """Close the world with the node."""
        super().destroy_node()
        if hasattr(self, "_simulation"):
            self._simulation.plant.close()


def _simulations(node: Node) -> int:
    return int(node.count_publishers(JOINT_STATES.name))


def _require_alone(node: Node, timeout: float) -> None:
    """Look for another simulation for ``timeout`` seconds.

    Raises:
        RledError: there is one.
    """
    deadline = time.monotonic() + timeout
    while node.context.ok():
        if _simulations(node):
            what = f"{node.resolve_topic_name(JOINT_STATES.name)} has a publisher already"
            raise RledError(what, "one simulation in a graph", "end it, or choose another ROS_DOMAIN_ID or namespace")
        if time.monotonic() > deadline:
            return
        time.sleep(0.02)


def _spin(node: SimNode, stop: Event) -> None:
    spin(node, stop, EventsExecutor(context=node.context))  # measured: half the processor time of the default


def main() -> None:
    """Run the node."""
    run_node(SimNode, SimParams, "sim_node", "Simulate a robot and its task.", _spin)


if __name__ == "__main__":
    main()
