"""Command: watch a running graph for a number of episodes, then report what was reached and draw the paths."""

import json
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rled_msgs_py.errors import RledError
from rled_msgs_py.files import write_whole
from rled_msgs_py.outputs import require_output
from rled_msgs_py.params import param
from rled_msgs_py.records import Text
from rled_msgs_py.ros.callbacks import Ending, ends_node, every
from rled_msgs_py.ros.node import declare, run_node, spin, spin_until, subscribe, subscribe_ticks
from rled_msgs_py.ros.waiting import report_waiting, waiting_for
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick
from rled_msgs_py.topics import JOINT_STATES, TASK_DESCRIPTION

from rled_agent.nodes.episode_log import Episode, EpisodeLog
from rled_agent.nodes.restart import Restart
from rled_agent.training.plots import draw_tool_paths, drawn_plane
from rled_agent.training.progress import Progress

WAIT = 30.0
"""Seconds without a tick after which watching gives up."""
STALLED = 1.0
"""Seconds without a tick after which one is waited for."""


@dataclass(frozen=True)
class WatchParams:
    """Parameters of the command."""

    episodes: int = param(20, "whole episodes to watch", low=1, high=1_000_000, read_only=True)
    seed: int = param(
        -1,
        "episodes of this seed, from their begin: the simulation is seeded and reset; -1: those that come",
        low=-1,
        high=2**63 - 1,
        read_only=True,
    )
    output: str = param("out/drive", "folder for episodes.json and paths.png", read_only=True)


class WatchEpisodes(Node):
    """Counts episodes from the state topics alone, as any other node on the graph could."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("watch_episodes", **arguments)
        params = declare(self, WatchParams)
        self._output = Path(params.output)
        require_output(self._output, "episodes.json", "paths.png")
        self._log = EpisodeLog(params.episodes)
        self._task: TaskDescription | None = None
        self._ticks: deque[Tick] = deque()
        self._seed = params.seed
        self._begins = 0 if params.seed < 0 else None
        self._heard, self._ticked = time.monotonic(), False
        self._progress = Progress("episode", params.episodes)
        subscribe(self, TASK_DESCRIPTION, self._on_task)
        subscribe_ticks(self, self._on_tick, depth=10_000)  # outlasts a busy moment of this process
        self.waits = ""
        every(self, 1.0, self._check)
        report_waiting(self, self._awaited)

    def _on_task(self, text: Text) -> None:
        self._task = TaskDescription.from_json(text.data)
        self._finish_when_complete()

    def begin(self, restart: Restart) -> None:
        """Begin with the episodes of the seed, if one is wanted."""
        if self._seed >= 0:
            self._begins = restart.begin(self._seed)
            self._count()

    def _awaited(self) -> str:
        if self.waits:
            return waiting_for(self, "sim_node", self.waits)
        if not self._ticked:
            return waiting_for(self, "sim_node", JOINT_STATES.name)
        if time.monotonic() - self._heard > STALLED:
            return waiting_for(self, "agent_node or an operator", "the next tick")
        return waiting_for(self, "sim_node", TASK_DESCRIPTION.name) if self._log.full and self._task is None else ""

    def _on_tick(self, tick: Tick) -> None:
        if self._log.full:
            return
        self._heard, self._ticked = time.monotonic(), True
        self._ticks.append(tick)
        self._count()

    def _count(self) -> None:
        while self._begins is not None and self._ticks and not self._log.full:
            tick = self._ticks.popleft()
            if tick.stamp >= self._begins:
                self._begins = 0  # a simulation that is started again begins there
                self._take(tick)

    def _take(self, tick: Tick) -> None:
        if self._log.add(tick):
            reached = np.mean([each.targets_reached for each in self._log.finished])
            self._progress.say(len(self._log.finished), {"targets": float(reached)})
        self._finish_when_complete()

    def _check(self) -> None:
        if time.monotonic() - self._heard > WAIT:
            raise Ending(RledError(f"no tick for {WAIT:.0f} s", "", "are sim_node and an agent or operator running?"))

    def _finish_when_complete(self) -> None:
        """The description of the task may come after the last tick."""
        if not self._log.full or self._task is None:
            return
        self._progress.close()
        summary = summarize(self._log.finished)
        with ends_node():
            write_whole(self._output / "episodes.json", json.dumps(summary, indent=2) + "\n")
            _draw(self._output / "paths.png", self._log.finished, self._task)
        print(
            f"{summary['episodes']} episodes: {summary['targets_reached']:.2f} targets reached, "
            f"{summary['steps']:.1f} steps, {summary['violations']:.2f} violations each; wrote {self._output}"
        )
        rclpy.try_shutdown(context=self.context)


def summarize(episodes: list[Episode]) -> dict[str, Any]:
    """Means over episodes, and each episode's metrics."""
    each = [
        {"targets_reached": e.targets_reached, "steps": e.steps, "reward": e.reward, "violations": e.violations}
        for e in episodes
    ]
    means = {key: float(np.mean([row[key] for row in each])) for key in each[0]}
    return {"episodes": len(each), **means, "each": each}


def _draw(path: Path, episodes: list[Episode], task: TaskDescription) -> None:
    targets = np.unique(np.concatenate([np.array(e.targets) for e in episodes]), axis=0)
    first, others = [np.array(episodes[0].path)], [np.array(e.path) for e in episodes[1:]]
    paths = ({"the other episodes": others} if others else {}) | {"first episode": first}
    plane = drawn_plane(task)
    title = f"{task.robot}: end effector in {len(episodes)} episodes over topics"
    goals = np.array(episodes[0].targets)
    draw_tool_paths(path, ("targets of all episodes", targets), goals, paths, plane, task.tolerance**0.5, title)


def _watch(node: WatchEpisodes, stop: Event) -> None:
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)

    def wait(done: Callable[[], bool], what: str) -> None:
        node.waits = what
        spin_until(executor, lambda: stop.is_set() or done(), WAIT, what)
        if stop.is_set():
            raise KeyboardInterrupt
        node.waits = ""

    node.begin(Restart(node, wait))
    spin(node, stop, executor)


def main() -> None:
    """Run the command."""
    run_node(WatchEpisodes, WatchParams, "watch_episodes", "Watch a running graph and report its episodes.", _watch)


if __name__ == "__main__":
    main()
