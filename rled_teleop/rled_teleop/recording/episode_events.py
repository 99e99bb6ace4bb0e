"""Episodes of a recording: begun, ended, kept or discarded, each said in an event that the bag holds."""

import json
from collections.abc import Mapping
from struct import error, unpack_from
from typing import Any, NamedTuple

from rled_msgs_py.cdr import ENCAPSULATION
from rled_msgs_py.errors import RledError
from rled_msgs_py.task import TaskDescription

REACHED, EPISODE = b"targets_reached\0", b"episode\0"
"""Keys of a serialized ``task_status``."""


class Refusal(RledError):
    """A request that does not fit to the state of the recording."""


class Provenance(NamedTuple):
    """What every event of a recording says.

    Attributes:
        operator: who demonstrates.
        version: of the recorder.
    """

    operator: str
    version: str


def count_of(key: bytes, status: bytes) -> int | None:
    """One of the counts in a serialized ``task_status``; None when it isn't in there.

    Reading the one value is 30 times as fast as reading the record, and the recorder receives every one.
    """
    place = status.find(key)
    if place < 0:
        return None
    start = place + len(key)
    start += (ENCAPSULATION - start) % 4
    try:
        (length,) = unpack_from("<I" if status[1] & 1 else ">I", status, start)
        return int(status[start + 4 : start + 3 + length])
    except (error, ValueError):
        return None


class EpisodeEvents:
    """Counts the episodes of a recording, one at a time.

    Args:
        about: who records with what.

    Attributes:
        number: of the newest episode, -1 before the first.
        running: an episode is being recorded.
    """

    def __init__(self, about: Provenance) -> None:
        self._about = about
        self._task: TaskDescription | None = None
        self.number, self.running = -1, False
        self._reached, self._before = False, 0

    def describe(self, task: TaskDescription) -> None:
        """Learn robot and task."""
        self._task = task

    def observe(self, reached: int | None) -> None:
        """Take the task's count of targets reached, as it arrives."""
        if reached is None:
            return
        self._reached |= reached > self._before
        self._before = reached

    def start(self, stamp: int) -> str:
        """Begin the next episode at a stamp (ns of simulation time); return the event as JSON.

        Raises:
            Refusal: one is running.
        """
        if self.running:
            raise Refusal(f"episode {self.number} is being recorded")
        self.number, self.running, self._reached = self.number + 1, True, False
        return self._event("start", stamp)

    def stop(self, stamp: int) -> str:
        """End the episode that is running; return the event.

        Raises:
            Refusal: none is running.
        """
        if not self.running:
            raise Refusal("no episode is being recorded")
        self.running = False
        return self._event("stop", stamp)

    def judge(self, verdict: str, stamp: int) -> list[str]:
        """``keep`` or ``discard`` the newest episode, ended first if it is running; return the events.

        The last verdict on an episode counts.

        Raises:
            Refusal: there is no episode yet.
        """
        if self.number < 0:
            raise Refusal("no episode was recorded yet")
        ended = [self.stop(stamp)] if self.running else []
        return [*ended, self._event(verdict, stamp)]

    def _event(self, event: str, stamp: int) -> str:
        outcome = "reached" if self._reached else "not reached"
        values: Mapping[str, Any] = {
            "event": event,
            "episode": self.number,
            "stamp": stamp,
            "operator": self._about.operator,
            "robot": self._task.robot if self._task else "",
            "task": self._task.task if self._task else "",
            "max_delta": self._task.max_delta if self._task else 0.0,
            "outcome": "" if event == "start" else outcome,
            "version": self._about.version,
        }
        return json.dumps(values)
