"""The episodes of the running recording, with their quality as soon as they have ended."""

from dataclasses import dataclass, replace
from threading import Lock

from rled_msgs_py.bags.episodes import Episode, find_segments
from rled_msgs_py.bags.quality import Quality, qualities
from rled_msgs_py.bags.timeline import Timeline
from rled_msgs_py.records import DeltaCommand
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick

from rled_teleop.web.episode_buffer import EpisodeBuffer

MAX_EPISODES = 500


@dataclass(frozen=True)
class EpisodeEntry:
    """One episode.

    Attributes:
        number: as the recorder counts.
        state: ``recording``, ``ended``, ``keep`` or ``discard``.
        outcome: in the recorder's words.
        seconds: how long (s of simulation time).
        quality: None until it has been measured.
    """

    number: int
    state: str = "recording"
    outcome: str = ""
    seconds: float = 0.0
    quality: Quality | None = None


class EpisodeLog:
    """Follows the recorder's events, and the ticks and displacements between them. All methods are thread-safe."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._entries: dict[int, EpisodeEntry] = {}
        self._rows = EpisodeBuffer()
        self._running = False
        self._to_measure: tuple[int, EpisodeBuffer] | None = None

    def add_event(self, event: str, number: int, outcome: str) -> None:
        """An episode begins (``start``), ends (``stop``), is worth something or not (``keep``, ``discard``)."""
        with self._lock:
            if event == "start":
                if number in self._entries:  # another recorder counts from 0
                    self._entries.clear()
                self._entries[number] = EpisodeEntry(number)
                self._rows, self._running = EpisodeBuffer(), True
                while len(self._entries) > MAX_EPISODES:
                    del self._entries[next(iter(self._entries))]
            elif (entry := self._entries.get(number)) is not None:
                if event == "stop":
                    self._end(entry, outcome)
                else:
                    self._entries[number] = replace(entry, state=event, outcome=outcome or entry.outcome)

    def _end(self, entry: EpisodeEntry, outcome: str) -> None:
        rows, self._rows, self._running = self._rows, EpisodeBuffer(), False
        self._entries[entry.number] = replace(entry, state="ended", outcome=outcome, seconds=rows.seconds)
        self._to_measure = (entry.number, rows)

    def add_tick(self, tick: Tick) -> None:
        """Take a tick."""
        with self._lock:
            if self._running:
                self._rows.add_tick(tick)

    def add_delta(self, command: DeltaCommand) -> None:
        """Take the displacement that answers a tick."""
        with self._lock:
            if self._running:
                self._rows.add_delta(command)

    def entries(self) -> list[EpisodeEntry]:
        """All episodes, in order."""
        with self._lock:
            return list(self._entries.values())

    @property
    def running(self) -> bool:
        """An episode is being recorded."""
        return self._running

    @property
    def has_unmeasured(self) -> bool:
        """An episode has ended whose quality is not known."""
        return self._to_measure is not None

    def measure(self, task: TaskDescription) -> None:
        """Measure the episode that ended last, if that has not been done; takes a moment."""
        with self._lock:
            waiting, self._to_measure = self._to_measure, None
        if waiting is None or not len(waiting[1]):
            return
        number, rows = waiting
        quality = quality_of(task, rows.timeline(task.joint_names))
        with self._lock:
            if number in self._entries:
                self._entries[number] = replace(self._entries[number], quality=quality)


def quality_of(task: TaskDescription, timeline: Timeline) -> Quality:
    """The measures of one episode by itself; what contradicts others shows in the whole bag only."""
    segments = tuple(segment for segment in find_segments(timeline, []) if segment.first < segment.last)
    whole = Episode(0, int(timeline.moments[0]), int(timeline.moments[-1]), segments)
    return qualities(task, timeline, [whole])[0]
