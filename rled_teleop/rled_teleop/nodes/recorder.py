"""Node: writes what travels on the topics, received over DDS and unchanged, into a bag."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rled_msgs_py.bags import BagError, BagWriter
from rled_msgs_py.bags.header import sim_stamp
from rled_msgs_py.joint_merger import MAX_AGE
from rled_msgs_py.messages import encode
from rled_msgs_py.records import Health, Level, Text
from rled_msgs_py.ros.callbacks import every, listen, serve
from rled_msgs_py.ros.convert import MESSAGE_CLASSES, qos_profile
from rled_msgs_py.ros.node import advertise, declare
from rled_msgs_py.ros.waiting import report_waiting, waiting_for
from rled_msgs_py.tick import STATE_TOPICS
from rled_msgs_py.topics import (
    DIAGNOSTICS,
    EPISODE_EVENTS,
    HUMAN_JOINT_DELTA,
    JOINT_DELTA,
    JOINT_STATES,
    MARKED_EE_POSE,
    MARKED_JOINT_STATES,
    RECORDED,
    ROBOT_DESCRIPTION,
    TASK_DESCRIPTION,
    TASK_STATUS,
    Topic,
)
from std_srvs.srv import SetBool, Trigger

from rled_teleop import __version__
from rled_teleop.recording.bag_sink import WRITE_PERIOD, BagSink
from rled_teleop.recording.descriptions import Descriptions
from rled_teleop.recording.episode_events import REACHED, EpisodeEvents, Provenance, Refusal, count_of
from rled_teleop.recording.message_filter import MessageFilter
from rled_teleop.recording.params import RecordParams, extra_topics
from rled_teleop.recording.recent import RecentMessages
from rled_teleop.recording.start_synchronisation import EarlyMessage, StartSynchronisation

REPORT_PERIOD = 1.0  # s, on /diagnostics
HISTORY = 10_000
"""Messages of a topic that wait for the recorder when it is held up."""
DESCRIPTIONS = (ROBOT_DESCRIPTION, TASK_DESCRIPTION)
TICKING = (*STATE_TOPICS, JOINT_DELTA, HUMAN_JOINT_DELTA)  # whose messages belong to a tick
LAST_REPORT_TIMEOUT = Duration(seconds=1)  # for the last report to reach its subscribers


class Recorder(Node):
    """Records topics into a bag, in episodes.

    Attributes:
        params: as given.
        descriptions: of robot and task, as they come.

    Services: ``~/record`` (begin an episode, end it), ``~/keep`` and ``~/discard`` (the newest one), ``~/mark_pose``.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("record_demos", **options)
        self.params = declare(self, RecordParams)
        self._topics = (*extra_topics(self.params.topics), *RECORDED)
        self._recent, self.descriptions = RecentMessages(), Descriptions()
        self._episodes = EpisodeEvents(Provenance(self.params.operator_name or self.params.operator, __version__))
        self._described, self._is_awaited, self._synchronisation = False, not self.params.paused, StartSynchronisation()
        self._after = self._until = -1  # stamps of the newest tick when the episode began and when the last one ended
        self._silent: list[Topic] = []  # not listened to before somebody publishes there
        self._failure: BagError | None = None
        self._filter = MessageFilter(self.get_logger().warning)
        self._marks = (advertise(self, MARKED_JOINT_STATES), advertise(self, MARKED_EE_POSE))
        self._events, self._reports = advertise(self, EPISODE_EVENTS), advertise(self, DIAGNOSTICS)
        serve(self, SetBool, "~/record", self._on_record)
        serve(self, Trigger, "~/keep", partial(self._on_verdict, "keep"))
        serve(self, Trigger, "~/discard", partial(self._on_verdict, "discard"))
        serve(self, Trigger, "~/mark_pose", self._on_mark_pose)

    def begin(self, bag: BagWriter) -> None:
        """Record into an open bag.

        It listens to the descriptions first, and to the rest once they are there, to ``joint_delta`` last: whoever sees
        that can begin.
        """
        self._sink = BagSink(bag, self._topics)
        every(self, WRITE_PERIOD, partial(self._safely, self._go_on))
        every(self, WRITE_PERIOD, self._listen_to_who_speaks)
        every(self, REPORT_PERIOD, self._report)
        report_waiting(self, self._awaited)
        for topic in DESCRIPTIONS:
            self._listen(topic)

    def _awaited(self) -> str:
        missing = [topic.name for topic in DESCRIPTIONS if self._recent.newest(topic) is None]
        if not missing and self._is_awaited:
            missing = [topic.name for topic in STATE_TOPICS if self._recent.newest(topic) is None]
        if missing:
            return waiting_for(self, "sim_node", ", ".join(missing))
        if self._is_awaited or self._episodes.running:
            return ""
        return f"{self.get_name()}/record: press b in teleop_keyboard, 'Begin episode' on the page, or call the service"

    def finish(self) -> None:
        """End the episode and write what is still held, but for the parts of a tick that is not complete."""
        newest = self._recent.stamps(STATE_TOPICS)
        complete = min(newest) if min(newest) >= 0 else max(newest)
        if self._episodes.running:
            self._tell(self._episodes.stop(max(complete, self._after)))
        self._sink.write_rest(lambda each: each.topic not in TICKING or each.stamp <= complete)

    def check(self) -> None:
        """Raise the BagError that has ended the recording, if one has."""
        if self._failure:
            raise self._failure

    def is_complete(self) -> bool:
        """Whether the state that the newest delta led to is there, on all its topics."""
        return min(self._recent.stamps(STATE_TOPICS)) > self._recent.stamp(JOINT_DELTA)

    def _listen(self, topic: Topic) -> None:
        received = partial(self._safely, self._received, topic)
        qos = qos_profile(replace(topic.qos, depth=HISTORY))
        listen(self, MESSAGE_CLASSES[topic.type], topic.name, qos, received)

    def _received(self, topic: Topic, data: bytes) -> None:
        if not self._filter.accepts(topic, data):
            return
        stamp = sim_stamp(topic.name, topic.type, data) or 0
        slack = MAX_AGE if topic == JOINT_STATES else 0  # which may have several publishers
        if topic in TICKING and stamp + slack < self._recent.stamp(topic):  # the simulation was restarted
            self._after = self._until = -1
        self._recent.add(topic, data)
        if topic == TASK_STATUS:
            self._episodes.observe(count_of(REACHED, data))
        if topic in DESCRIPTIONS and not self.descriptions.take(topic, data):
            self.get_logger().warning(self.descriptions.warning, throttle_duration_sec=1.0)
            self._report()
        if topic in DESCRIPTIONS or self._belongs(topic, stamp):
            self._sink.take(topic, data)
        elif self._is_awaited and topic in TICKING:
            self._synchronisation.add(EarlyMessage(topic, self._sink.keep(topic, data), stamp, data))
        if topic in DESCRIPTIONS:
            self._listen_to_the_rest()
        self._go_on()

    def _begin_when_ready(self) -> None:
        if not (self._is_awaited and self._synchronisation.is_ready()):
            return
        self._is_awaited = False
        chosen, others = self._synchronisation.messages()
        for each in others:
            self._sink.forget(each.number)
        for each in sorted(chosen, key=attrgetter("stamp")):
            self._sink.add(each.topic, each.data, each.number)
            if not self._episodes.running:
                self._after = each.stamp - 1
                self._tell(self._episodes.start(each.stamp))
        self.get_logger().info(f"recording into {self.params.output}; Ctrl-C completes the bag")

    def _belongs(self, topic: Topic, stamp: int) -> bool:
        """Whether a message is of an episode: episodes begin and end between two ticks."""
        if topic not in TICKING:
            return self._episodes.running
        return stamp <= self._until or (self._episodes.running and stamp > self._after)

    def _listen_to_the_rest(self) -> None:
        task = self.descriptions.task
        if self._described or task is None or not self.descriptions.robot:
            return
        self._described = True
        self._episodes.describe(task)
        self._silent = [topic for topic in self._topics if topic.qos.durability == "volatile"]
        for topic in self._topics:
            if topic not in (*self._silent, *DESCRIPTIONS, EPISODE_EVENTS):
                self._listen(topic)

    def _listen_to_who_speaks(self) -> None:
        """Listen to the topics without a history as soon as somebody publishes there.

        DDS matches each side in its own time. Whoever saw a reader that does not know its writer yet would begin, and
        the first messages would be lost; a reader made after its writer is known is ready before anybody sees it.
        """
        found = [topic for topic in self._silent if self.count_publishers(topic.name)]
        if len(found) > 1 and found[-1] == JOINT_DELTA:
            found.pop()  # the last of all: who sees it listened to may begin
        for topic in found:
            self._silent.remove(topic)
            self._listen(topic)

    def _go_on(self) -> None:
        """What is to be done again and again; called on messages too, because a burst of them keeps timers waiting."""
        self._begin_when_ready()
        self._sink.write_when_due()

    def _safely(self, callback: Callable[..., None], *values: Any) -> None:
        """Say loudly when the bag cannot be written any more; an executor would print a traceback."""
        if self._failure:
            return
        try:
            callback(*values)
        except BagError as error:
            self._failure = error
            self._health(Level.ERROR, f"RECORDING STOPPED: {error}")
            self.get_logger().fatal(f"RECORDING STOPPED: {error}")
            self._reports.wait_for_all_acked(LAST_REPORT_TIMEOUT)

    def _report(self) -> None:
        doing = f"recording episode {self._episodes.number}" if self._episodes.running else "paused"
        doing = doing if self._described else "waiting for a simulation"
        warning = self.descriptions.warning if self._described else ""
        self._health(Level.WARN if warning else Level.OK, f"{doing}; {warning}" if warning else doing)

    def _health(self, level: Level, message: str) -> None:
        state = "failed" if self._failure else "recording" if self._episodes.running else "paused"
        values = {"state": state if self._described else "waiting"}
        values |= {"episode": str(self._episodes.number), "messages": str(self._sink.kept)}
        values |= {f"unreadable {name}": str(count) for name, count in self._filter.refused.items()}
        now = self.get_clock().now().nanoseconds
        self._reports.publish(encode(DIAGNOSTICS, Health(now, level, "record_demos: bag", message, values)))

    def _now(self) -> int:
        return max(self._recent.stamps((*STATE_TOPICS, JOINT_DELTA)))

    def _tell(self, event: str) -> None:
        """Record an event beside the messages of its time, and tell everybody."""
        data = encode(EPISODE_EVENTS, Text(event))
        self._sink.take(EPISODE_EVENTS, data)
        self._events.publish(data)

    def _on_record(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        def begin_or_end() -> list[str]:
            self._is_awaited = False
            return [self._episodes.start(self._now()) if request.data else self._episodes.stop(self._now())]

        return self._answer(response, begin_or_end, "recording episode {}" if request.data else "episode {} ended")

    def _on_verdict(self, verdict: str, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        said = {"keep": "episode {} kept", "discard": "episode {} discarded"}[verdict]
        return self._answer(response, lambda: self._episodes.judge(verdict, self._now()), said)

    def _answer(self, response: Any, ask: Callable[[], list[str]], said: str) -> Any:
        try:
            if self._now() < 0:
                raise Refusal("no state received yet")
            was_running = self._episodes.running
            for event in ask():
                self._safely(self._tell, event)
            self.check()
            if self._episodes.running:
                self._after = self._now()
            elif was_running:
                self._until = self._now()
        except (Refusal, BagError) as error:
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = True, said.format(self._episodes.number)
        self.get_logger().info(response.message)
        return response

    def _on_mark_pose(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        task = self.descriptions.task
        pose = self._recent.pose(task.joint_names) if task else None
        response.success = pose is not None and self._episodes.running
        response.message = "marked" if response.success else "paused" if pose else "no state received yet"
        if pose is not None and response.success:
            for publisher, data in zip(self._marks, pose, strict=True):
                publisher.publish(data)
        return response
