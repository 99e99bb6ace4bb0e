"""Command: play a bag back onto the topics that it was recorded from."""

import importlib
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rled_msgs_py.bags.storage import BagTopic
from rled_msgs_py.errors import RledError
from rled_msgs_py.params import param
from rled_msgs_py.ros.callbacks import every, serve
from rled_msgs_py.ros.convert import qos_profile
from rled_msgs_py.ros.node import declare, run_node, spin
from rled_msgs_py.ros.waiting import report_waiting, waiting_for
from rled_msgs_py.topics import JOINT_DELTA, Qos
from std_srvs.srv import SetBool

from rled_teleop.operators.terminal import Screen, TerminalGone, keyboard_screen
from rled_teleop.recording.bag_messages import Recording, is_latched, quality, read_recording
from rled_teleop.recording.player import Player

POLL_PERIOD = 0.002
"""Seconds between two polls of what is due."""
HISTORY = 1000
"""Messages of a topic kept for readers that are slower; the latched descriptions keep their one."""
SETTLING_TIME = 0.5
"""Seconds in which no subscriber was matched after which all that are there count as matched."""
DELIVERY_TIMEOUT = Duration(seconds=30)
"""How long the last messages are given to reach their subscribers."""
_fixed = partial(param, read_only=True)


@dataclass(frozen=True)
class ReplayParams:
    """Parameters of the player."""

    bag: str = _fixed("", "folder of the bag, or an .mcap file; may be given without --bag")
    rate: float = _fixed(1.0, "recorded seconds a second", low=0.001, high=10_000.0)
    loop: bool = _fixed(False, "begin again after the end")
    start: float = _fixed(0.0, "begin so many seconds after the first message", low=0.0, high=1e9)
    stop: float = _fixed(0.0, "end so many seconds after the first message; 0: at the last", low=0.0, high=1e9)
    paused: bool = _fixed(False, "begin paused")
    wait_for_subscribers: int = _fixed(0, "subscribers of joint_delta to wait for before the start", low=0, high=100)


class ReplayDemos(Node):
    """Publishes a bag's messages as they were received; ``~/pause`` (SetBool) and the space key hold it up."""

    def __init__(self, **options: Any) -> None:
        super().__init__("replay_demos", **options)
        self.params = declare(self, ReplayParams)
        if not self.params.bag:
            raise RledError("no bag to play", "replay_demos BAG")
        recording = read_recording(Path(self.params.bag))
        self._recording = recording.between(self.params.start, self.params.stop)
        if not self._recording.data:
            raise RledError(f"no messages between {self.params.start:g} and {self.params.stop:g} s")
        self._outputs = [publisher(self, each) for each in recording.topics]
        self._player: Player | None = None
        self._matched, self._since = [-1], time.monotonic()
        self._screen: Screen | None = None
        self._publish(recording.latched_before(self.params.start), range(sys.maxsize))
        serve(self, SetBool, "~/pause", self._on_pause)
        every(self, POLL_PERIOD, self._poll)
        report_waiting(self, self._awaited)

    def listen(self, screen: Screen) -> None:
        """Take keys from a terminal."""
        self._screen = screen

    def _poll(self) -> None:
        now = time.monotonic()
        if self._player is None:
            if not self._is_listened_to(now):
                return
            self._player = Player(self._recording.times, self.params.rate, self.params.loop, now)
            self._player.paused = self.params.paused
        self._take_keys(self._player)
        self._publish(self._recording, self._player.due(now))
        if self._player.finished:
            self._end()

    def _is_listened_to(self, now: float) -> bool:
        """Whether as many listen as were asked for, and DDS has matched them on all their topics."""
        matched = [each.get_subscription_count() for each in self._outputs]
        if matched != self._matched:
            self._matched, self._since = matched, now
        return self._listeners() >= self.params.wait_for_subscribers and now - self._since >= SETTLING_TIME

    def _listeners(self) -> int:
        name = self.resolve_topic_name(JOINT_DELTA.name)
        counts = [each.get_subscription_count() for each in self._outputs if each.topic_name == name]
        return max(counts, default=sys.maxsize)

    def _awaited(self) -> str:
        wanted = self.params.wait_for_subscribers
        if self._player is not None or (there := self._listeners()) >= wanted:
            return ""
        what = f"{wanted} subscribers of {JOINT_DELTA.name} ({there} there)"
        return waiting_for(self, "record_demos or train_expert --live", what)

    def _publish(self, recording: Recording, places: range) -> None:
        for place in places[: len(recording.data)]:
            self._outputs[recording.topic[place]].publish(recording.data[place])

    def _take_keys(self, player: Player) -> None:
        try:
            keys = self._screen.read() if self._screen else []
        except TerminalGone:
            self._screen, keys = None, []
        if " " in keys:
            self._pause(player, not player.paused)

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if self._player is None:
            response.message = "it has not begun"
            return response
        self._pause(self._player, request.data)
        response.success, response.message = True, "paused" if request.data else "playing"
        return response

    def _pause(self, player: Player, on: bool) -> None:
        self._publish(self._recording, player.pause(on, time.monotonic()))
        self.get_logger().info("paused" if on else "playing")

    def _end(self) -> None:
        for output in self._outputs:
            output.wait_for_all_acked(DELIVERY_TIMEOUT)
        print(f"{self.params.bag}: {len(self._recording.data)} messages played", flush=True)
        self.context.try_shutdown()


def publisher(node: Node, topic: BagTopic) -> Publisher:
    """A publisher of what a bag holds on a topic: recorded name, type, reliability and durability.

    Raises:
        RledError: the message type is not installed.
    """
    package, _, name = topic.type.split("/")
    try:
        message = getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        raise RledError(f"{topic.name} is of type {topic.type}, which is not installed") from None
    return node.create_publisher(message, topic.name, qos_profile(replayed(quality(topic))))


def replayed(qos: Qos) -> Qos:
    """A recorded quality with a longer history: it decides nothing about who matches, and a burst loses nothing."""
    return qos if is_latched(qos) else replace(qos, depth=max(qos.depth, HISTORY))


def _play(node: ReplayDemos, stop: Event) -> None:
    with ExitStack() as stack:
        if sys.stdin.isatty() and sys.stdout.isatty():
            print("space pauses and goes on")
            node.listen(stack.enter_context(keyboard_screen()))
        spin(node, stop)


def main() -> None:
    """Run the command."""
    if len(sys.argv) > 1 and not sys.argv[1].startswith("-"):
        sys.argv.insert(1, "--bag")
    run_node(ReplayDemos, ReplayParams, "replay_demos", "Play a bag back onto its topics.", _play)


if __name__ == "__main__":
    main()
