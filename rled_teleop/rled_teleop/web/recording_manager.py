"""Recordings made from the page: the recorder as a child process, the finished bags, and replays of their episodes."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.bags import Bag
from rled_msgs_py.bags.review import Review, review
from rled_msgs_py.errors import RledError, command
from rled_msgs_py.processes import Child, Children, program

from rled_teleop.web.control import Requests
from rled_teleop.web.graph_state import GraphState

REPORT = "record_demos: bag"
RECORDER_TIMEOUT = 15.0
"""So long the recorder is given to be ready (s)."""
POLL_PERIOD = 0.02


class Playback(NamedTuple):
    """An episode to be played.

    Attributes:
        names: of the joints.
        seconds: since its beginning, shape (k,).
        q: joint angles (rad), shape (k, n).
    """

    names: tuple[str, ...]
    seconds: NDArray[np.float64]
    q: NDArray[np.float64]


class RecordingManager:
    """Slow work is done one thing after the other in a thread of its own; nobody waits for it.

    Args:
        folder: for bags.
        graph: what the graph says.
        requests: requests to the recorder.

    Attributes:
        said: what went on last, in words.
        bags: names of the finished ones.
        table: the open bag's episodes, as Markdown.
        opened: its name; empty for none.
        replayable: numbers of its episodes.
    """

    def __init__(self, folder: Path, graph: GraphState, requests: Requests) -> None:
        self._folder, self._graph, self._requests = folder, graph, requests
        self._children = Children()
        self._recorder: Child | None = None
        self._bag: Path | None = None
        self._worker = ThreadPoolExecutor(1, "recordings")
        self._open: tuple[Bag, Review] | None = None
        self._playback: Playback | None = None
        self._began = 0.0
        self.said, self.table, self.opened = "", "", ""
        self.bags: tuple[str, ...] = ()
        self.replayable: tuple[int, ...] = ()
        self._do(self._list)

    @property
    def records(self) -> bool:
        """Whether a recorder of its own runs."""
        return self._recorder is not None and self._recorder.exit_code is None

    @property
    def plays(self) -> bool:
        """Whether a replay runs."""
        return self._playback is not None

    def begin_episode(self) -> None:
        """Begin an episode; without a recorder in the graph one is started first."""
        self._do(self._begin)

    def finish(self) -> None:
        """Complete the bag."""
        self._do(self._finish)

    def measure(self) -> None:
        """Measure what has ended."""
        task = self._graph.task
        if task is not None and self._graph.log.has_unmeasured:
            self._do(partial(self._graph.log.measure, task))

    def open(self, name: str | None) -> None:
        """Look a bag through; None closes it."""
        self._do(lambda: self._look_through(name))

    def play(self, number: int) -> None:
        """Play an episode of the open bag; stop the replay if one runs."""
        if self.plays:
            self._playback = None
        else:
            self._do(lambda: self._load(number))

    def frame(self, now: float) -> dict[str, float] | None:
        """Joint angles (rad) by name of the replay at a time (s); None when none runs."""
        playback = self._playback
        if playback is None:
            return None
        at = now - self._began
        if at > playback.seconds[-1]:
            self._playback = None
            return None
        row = int(np.searchsorted(playback.seconds, at, side="right")) - 1
        return dict(zip(playback.names, playback.q[max(row, 0)].tolist(), strict=True))

    def close(self) -> None:
        """Complete the bag and end."""
        self._worker.shutdown(wait=True, cancel_futures=True)
        self._finish()

    def _do(self, work: Callable[[], Any]) -> None:
        def run() -> None:
            try:
                work()
            except (RledError, OSError) as error:
                self.said = str(error)

        self._worker.submit(run)

    def _begin(self) -> None:
        if not self._graph.nodes.recorder and not self.records:
            self._start_recorder()
        self._await(lambda: self._graph.nodes.recorder and self._is_ready(), "the recorder")
        self._requests.put("start")
        if self._bag is not None:
            self.said = f"recording into {self._bag}"

    def _is_ready(self) -> bool:
        health = self._graph.health(REPORT)
        return not self.records or (health is not None and health.values.get("state") != "waiting")

    def _start_recorder(self) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        self._bag = self._folder / time.strftime("%Y-%m-%d_%H-%M-%S")
        options = ["--output", str(self._bag), "--paused", "--operator-name", "web"]
        self.said = "starting the recorder ..."
        self._graph.forget_health(REPORT)
        self._recorder = self._children.start([*program("rled_teleop", "record_demos"), *options])

    def _await(self, done: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + RECORDER_TIMEOUT
        while not done():
            if time.monotonic() > deadline or (self._recorder is not None and self._recorder.exit_code):
                lines = self._recorder.last_lines if self._recorder else ()
                raise RledError(f"no answer from {what}", "", " ".join(lines))
            time.sleep(POLL_PERIOD)

    def _finish(self) -> None:
        if self._recorder is None or self._bag is None:
            return
        self.said = "completing the bag ..."
        self._children.end(self._recorder)
        self._recorder, bag, self._bag = None, self._bag, None
        if not bag.is_dir():
            self.said = "nothing was recorded"
            return
        self.said = f"{bag} is complete; `{command('demos', 'check', bag)}` looks it over"
        self._list()
        self._look_through(bag.name)

    def _list(self) -> None:
        found = self._folder.glob("*/metadata.yaml") if self._folder.is_dir() else []
        self.bags = tuple(sorted((each.parent.name for each in found), reverse=True))

    def _look_through(self, name: str | None) -> None:
        self._playback = None
        if name is None:
            self._open, self.table, self.opened, self.replayable = None, "", "", ()
            return
        bag = Bag(self._folder / name)
        found = review(bag)
        self._open, self.said = (bag, found), bag.note or self.said
        rows = [
            f"| {each.number} | {'✔' if each.kept else '✘'} | {quality.score:.2f} | {quality.reached:.0%} "
            f"| {quality.detour:.2f} | {quality.jerk:.3g} |"
            for each, quality in zip(found.episodes, found.qualities, strict=True)
        ]
        head = ["| # | | score | reached | detour | jerk |", "|---|---|---|---|---|---|"]
        self.table = "\n".join([f"**{name}**, {len(found.faults)} faults", "", *head, *rows])
        self.opened, self.replayable = name, tuple(each.number for each in found.episodes)

    def _load(self, number: int) -> None:
        if self._open is None:
            return
        bag, found = self._open
        episode = next((each for each in found.episodes if each.number == number), None)
        if episode is None:  # it was of the bag that was open before
            return
        moments = found.timeline.moments
        rows = (moments >= episode.first) & (moments <= episode.last)
        if rows.any():
            seconds = (moments[rows] - moments[rows][0]) * 1e-9
            self._began = time.monotonic()
            self._playback = Playback(bag.task.joint_names, seconds, found.timeline.q[rows])
