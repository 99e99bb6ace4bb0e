"""Command: watch a running graph for a number of episodes, then report what was reached and draw the paths."""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.node import Node
from rled_msgs_py.errors import RledError
from rled_msgs_py.files import write_whole
from rled_msgs_py.node import declare, run_node, subscribe, subscribe_ticks
from rled_msgs_py.params import param
from rled_msgs_py.records import Text
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick
from rled_msgs_py.topics import TASK_DESCRIPTION

from rled_agent.episodes import Episode, EpisodeLog
from rled_agent.plots import draw_tool_paths
from rled_agent.progress import Progress

WAIT = 30.0
"""Seconds without a tick after which watching gives up."""


@dataclass(frozen=True)
class WatchParams:
    """Parameters of the command."""

    episodes: int = param(20, "whole episodes to watch", low=1, high=1_000_000, read_only=True)
    output: str = param("out/drive", "folder for episodes.json and paths.png", read_only=True)


class WatchEpisodes(Node):
    """Counts episodes from the state topics alone, as any other node on the graph could."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("watch_episodes", **arguments)
        params = declare(self, WatchParams)
        self._output = Path(params.output)
        self._log = EpisodeLog(params.episodes)
        self._task: TaskDescription | None = None
        self._heard = time.monotonic()
        self._progress = Progress("episode", params.episodes)
        subscribe(self, TASK_DESCRIPTION, self._on_task)
        subscribe_ticks(self, self._on_tick, depth=10_000)  # outlasts a busy moment of this process
        self.create_timer(1.0, self._check)

    def _on_task(self, text: Text) -> None:
        self._task = TaskDescription.from_json(text.data)

    def _on_tick(self, tick: Tick) -> None:
        if self._log.full:
            return
        self._heard = time.monotonic()
        if self._log.add(tick):
            reached = np.mean([each.targets_reached for each in self._log.finished])
            self._progress.say(len(self._log.finished), {"targets": float(reached)})
        if self._log.full and self._task is not None:
            self._finish(self._task)

    def _check(self) -> None:
        if time.monotonic() - self._heard > WAIT:
            raise RledError(f"no tick for {WAIT:.0f} s", "", "are sim_node and an agent or operator running?")

    def _finish(self, task: TaskDescription) -> None:
        self._progress.close()
        summary = summarize(self._log.finished)
        write_whole(self._output / "episodes.json", json.dumps(summary, indent=2) + "\n")
        _draw(self._output / "paths.png", self._log.finished, task)
        print(
            f"{summary['episodes']} episodes: {summary['targets_reached']:.2f} targets reached, "
            f"{summary['steps']:.1f} steps, {summary['violations']:.2f} violations each; wrote {self._output}"
        )
        rclpy.try_shutdown(context=self.context)


def summarize(episodes: list[Episode]) -> dict[str, Any]:
    """Means over episodes, and each episode's figures."""
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
    plane = (0, 1) if len(task.axes) == 2 else (1, 2)
    title = f"{task.robot}: end effector in {len(episodes)} episodes over topics"
    goals = np.array(episodes[0].targets)
    draw_tool_paths(path, ("targets of all episodes", targets), goals, paths, plane, task.tolerance**0.5, title)


def main() -> None:
    """Run the command."""
    run_node(WatchEpisodes, WatchParams, "watch_episodes", "Watch a running graph and report its episodes.")


if __name__ == "__main__":
    main()
