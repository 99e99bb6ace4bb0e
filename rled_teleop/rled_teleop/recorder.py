"""Node: writes what travels on the topics, received over DDS and unchanged, into a bag."""

from collections import defaultdict, deque
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rled_msgs_py.bags import FLUSH_PERIOD, BagWriter
from rled_msgs_py.convert import MESSAGE_CLASSES, qos_profile
from rled_msgs_py.errors import RledError
from rled_msgs_py.node import advertise, declare
from rled_msgs_py.params import param
from rled_msgs_py.tick import STATE_TOPICS
from rled_msgs_py.topics import (
    CLOCK_TOPIC,
    DIAGNOSTICS,
    EE_POSE,
    JOINT_DELTA,
    JOINT_STATES,
    MARKED_EE_POSE,
    MARKED_JOINT_STATES,
    MARKERS,
    RECORDED,
    ROBOT_DESCRIPTION,
    TASK_DESCRIPTION,
    Topic,
)
from std_srvs.srv import SetBool, Trigger

from rled_teleop.ordering import Ordering, Received, stamp_of

WRITE_PERIOD = FLUSH_PERIOD / 2.0
"""Seconds between writes; for the sake of their order, messages are held for two of them."""
HISTORY = 1000
"""Messages of a topic that wait for the recorder when it is held up."""
RECENT = 8
"""Messages of a topic kept for marking a pose: state topics may be some ticks apart."""
DESCRIPTIONS = (ROBOT_DESCRIPTION, TASK_DESCRIPTION)
EXTRA = {topic.name: topic for topic in (MARKERS, DIAGNOSTICS, CLOCK_TOPIC)}


@dataclass(frozen=True)
class RecordParams:
    """Parameters of the recorder and of what it starts."""

    output: str = param("", "folder of the bag", read_only=True)
    overwrite: bool = param(False, "replace the bag if there is one", read_only=True)
    topics: str = param("", f"more topics, separated by commas: {', '.join(EXTRA)}", read_only=True)
    operator: str = param(
        "none",
        "start a simulation and this operator, record till it ends",
        choices=("none", "scripted"),
        read_only=True,
    )
    robot: str = param("panda", "robot to simulate", read_only=True)
    points: int = param(0, "points of the target curve to mark (ζᵃ); 0: all", low=0, high=100_000, read_only=True)
    trajectories: int = param(50, "targets to reach after that (ζᵇ)", low=0, high=1_000_000, read_only=True)
    seed: int = param(0, "seed of simulation and operator", low=0, high=2**31 - 1, read_only=True)
    operator_options: str = param("", 'more options of the operator, as typed: "--tremor 0.1"', read_only=True)
    sim_options: str = param("", 'more options of the simulation, as typed: "--gui"', read_only=True)


class Recorder(Node):
    """Records topics into a bag; services ``~/record`` (pause, resume) and ``~/mark_pose``."""

    def __init__(self, **options: Any) -> None:
        super().__init__("record_demos", **options)
        self.params = declare(self, RecordParams)
        self._topics = (*extra_topics(self.params.topics), *RECORDED)
        self._ordering = Ordering()
        self._recent: defaultdict[Topic, deque[bytes]] = defaultdict(lambda: deque(maxlen=RECENT))
        self._recording, self._described = True, False
        self._marks = (advertise(self, MARKED_JOINT_STATES), advertise(self, MARKED_EE_POSE))
        self.create_service(SetBool, "~/record", self._on_record)
        self.create_service(Trigger, "~/mark_pose", self._on_mark_pose)

    def begin(self, bag: BagWriter) -> None:
        """Record into an open bag.

        It listens to the descriptions first, and to the rest in the order of ``RECORDED`` once they are there: whoever
        sees it listen to ``joint_delta`` can begin.
        """
        self._bag = bag
        self.create_timer(WRITE_PERIOD, self._flush, clock=Clock(clock_type=ClockType.STEADY_TIME))
        for topic in DESCRIPTIONS:
            self._listen(topic)

    def finish(self) -> None:
        """Write what is still held."""
        self._write(self._ordering.rest())

    def is_complete(self) -> bool:
        """Whether the state that the newest delta led to is there, on all its topics."""
        delta = self._newest_stamp(JOINT_DELTA)
        return all(self._newest_stamp(topic) > delta for topic in STATE_TOPICS)

    def _newest_stamp(self, topic: Topic) -> int:
        recent = self._recent[topic]
        return (stamp_of(topic, recent[-1]) or 0) if recent else -1

    def _listen(self, topic: Topic) -> None:
        received = partial(self._received, topic, self._topics.index(topic))
        qos = qos_profile(replace(topic.qos, depth=HISTORY))
        self.create_subscription(MESSAGE_CLASSES[topic.type], topic.name, received, qos, raw=True)

    def _received(self, topic: Topic, rank: int, data: bytes) -> None:
        self._recent[topic].append(data)
        if self._recording or topic in DESCRIPTIONS:
            self._ordering.add(topic, rank, data)
        if topic in DESCRIPTIONS:
            self._listen_to_the_rest()

    def _listen_to_the_rest(self) -> None:
        if self._described or not all(self._recent[topic] for topic in DESCRIPTIONS):
            return
        self._described = True
        for topic in self._topics:
            if topic not in DESCRIPTIONS:
                self._listen(topic)

    def _flush(self) -> None:
        self._write(self._ordering.due())
        if not self._described:
            self.get_logger().info("waiting for a simulation", throttle_duration_sec=5.0, skip_first=True)

    def _write(self, messages: list[Received]) -> None:
        for message in messages:
            self._bag.write_cdr(message.topic, message.data, message.stamp)
        if messages:
            self._bag.flush()

    def _on_record(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._recording = request.data
        response.success, response.message = True, "recording" if request.data else "paused"
        self.get_logger().info(response.message)
        return response

    def _on_mark_pose(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        pose = self._newest_pose()
        response.success = pose is not None and self._recording
        response.message = "marked" if response.success else "paused" if pose else "no state received yet"
        if pose is not None and response.success:
            for publisher, data in zip(self._marks, pose, strict=True):
                publisher.publish(data)
        return response

    def _newest_pose(self) -> tuple[bytes, bytes] | None:
        """Joint state and pose of the newest stamp that both have."""
        joints, poses = (
            {stamp_of(topic, each): each for each in self._recent[topic]} for topic in (JOINT_STATES, EE_POSE)
        )
        common = [stamp for stamp in joints.keys() & poses.keys() if stamp is not None]
        return (joints[max(common)], poses[max(common)]) if common else None


def extra_topics(names: str) -> tuple[Topic, ...]:
    """The topics of a list of names separated by commas.

    Raises:
        RledError: one is unknown.
    """
    given = [name.strip() for name in names.split(",") if name.strip()]
    for name in given:
        if name not in EXTRA:
            raise RledError(f"unknown topic '{name}'", ", ".join(EXTRA))
    return tuple(EXTRA[name] for name in given)
