"""Measure: SIGKILL random nodes of a running graph in real time, and the learning process; start each again.

    python -m tests.graph.kills --kills 100

Who is killed next is drawn from those that are well: a simulation and a recorder that report, an agent that learns.
Learning must never fall behind what was saved, the robot never leave its limits or jump, and every bag be whole.
"""

import argparse
import json
import os
import signal
import sys
import tempfile
import time
from collections import Counter
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from rled_agent.training.checkpoint import read_checkpoint
from rled_msgs_py.bags import Bag, repair
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import Health, JointSample
from rled_msgs_py.topics import JOINT_DELTA, JOINT_STATES, RECORDED
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task
from std_srvs.srv import SetBool

from .soak import child_of
from .team import AGENT, DEMONSTRATION, Team, Watch, expert_of, private_graph, running

TASK = reach_task(ROBOTS["planar"]).description
REPORTS = {"sim": "sim: driver", "agent": AGENT, "recorder": "record_demos: bag"}
ENDLESS = ("--targets-per-episode", "0", "--max-steps", "0")
SLACK = 1e-9
YOUNG = 2_000_000_000
"""Simulation time (ns) before which a simulation is not killed, so that the stamps of the next one are smaller."""


def outside_limits(stamps: np.ndarray, positions: np.ndarray) -> int:
    """States outside the joints' range, and motions by more than Δq_max a period; a restart begins anew.

    Args:
        stamps: simulation time (ns), shape (k,).
        positions: joint angles (rad), shape (k, n).
    """
    robot = ROBOTS["planar"]
    if not len(stamps):
        return 0
    outside = (positions < np.array(robot.lower) - SLACK) | (positions > np.array(robot.upper) + SLACK)
    periods = np.diff(stamps) / TASK.period
    moved = np.abs(np.diff(positions, axis=0)).max(axis=1, initial=0.0)
    jumped = (periods > 0) & (moved > TASK.max_delta * periods * (1.0 + 1e-6))
    for k in np.flatnonzero(jumped):
        print(f"jump: {stamps[k]} ns {positions[k]} to {stamps[k + 1]} ns {positions[k + 1]}", flush=True)
    return int(outside.any(axis=1).sum() + jumped.sum())


def whole(path: Path) -> tuple[int, int]:
    """Repair a bag and read all of it: states and commands in it, and those of them that are outside the limits.

    Raises:
        RledError: it cannot be read.
    """
    lost = repair(path).lost
    assert len(lost) <= 1, f"{path}: {lost}"
    bag = Bag(path)
    for topic in RECORDED:
        assert sum(1 for _ in bag.records(topic)) == bag.counts.get(topic.name, 0), f"{path}: {topic.name}"
    states, deltas = bag.joints(JOINT_STATES), bag.joints(JOINT_DELTA)
    excess = int((np.abs(deltas.position) > TASK.max_delta * (1.0 + 1e-6)).any(axis=1).sum())
    return len(states.stamps) + len(deltas.stamps), outside_limits(states.stamps, states.position) + excess


def is_well(name: str, report: Health) -> bool:
    """A node does its work, as it says itself."""
    if name == "agent":
        return int(report.values.get("handovers", 0)) > 1
    if name == "sim":
        return int(report.values["stamp"]) > YOUNG
    return report.message.startswith("recording")


class Graph:
    """The team under fire, and what the watcher has seen."""

    def __init__(self, team: Team) -> None:
        self.team, self.joints, self.moved = team, list[tuple[int, tuple[float, ...]]](), 0.0
        self.took, self._down = list[float](), dict.fromkeys(REPORTS, time.monotonic())
        self.watch = Watch(self._on_joints)
        self._learn = self.watch.node.create_client(SetBool, "agent_node/learn")

    def _on_joints(self, joints: JointSample) -> None:
        position = tuple(joints.position)
        if self.joints and position != self.joints[-1][1]:
            self.moved = time.monotonic()
        self.joints.append((joints.stamp, position))

    def look(self) -> None:
        """See who is well again."""
        for name, since in tuple(self._down.items()):
            report = self.watch.report(REPORTS[name], since)
            if report is not None and is_well(name, report):
                self.took.append(time.monotonic() - self._down.pop(name))

    def all_well(self) -> bool:
        """Nobody is still on the way back."""
        self.look()
        return not self._down

    def recover(self) -> None:
        """Wait until all are well and the robot moves."""
        begun = time.monotonic()
        try:
            self.watch.wait(
                lambda: self.look() or (not self._down and self.moved > begun), "a graph that is well again"
            )
        except RledError:
            print(f"not well: {list(self._down)}; {self.watch.health}", flush=True)
            raise

    def victims(self) -> list[str]:
        """Who may be killed now."""
        self.look()
        well = [name for name in self.team.processes if name not in self._down]
        return [*well, "learning"] if "agent" in well else well

    def kill(self, victim: str) -> None:
        """SIGKILL one, and start it again."""
        if victim == "learning":
            os.kill(child_of(self.team.processes["agent"].pid), signal.SIGKILL)
            since = time.monotonic()
            self.watch.wait(lambda: self._lacks_learning(since), "the agent to miss it")
            answer = self._learn.call_async(SetBool.Request(data=True))
            self.watch.wait(answer.done, "~/learn")
            assert answer.result().success, answer.result().message
        else:
            self.team.kill(victim)
            self.watch.spin(0.2)  # what it said before is not taken for the next one's words
            self.team.start(victim)
        self._down["agent" if victim == "learning" else victim] = time.monotonic()

    def _lacks_learning(self, since: float) -> bool:
        report = self.watch.report(AGENT, since)
        return report is not None and "learning process has ended" in report.message


def measure(kills: int, seed: int, folder: Path) -> dict[str, Any]:
    """Kill and look."""
    generator, killed = np.random.default_rng(seed), Counter[str]()
    team = Team(folder, expert_of(DEMONSTRATION, folder), ENDLESS)
    saved = [(0, 0)]
    with running(team):
        graph = Graph(team)
        with closing(graph.watch):
            graph.recover()
            while killed.total() < kills:
                graph.watch.spin(generator.uniform(0.0, 1.0))
                if not (victims := graph.victims()):
                    continue
                victim = str(generator.choice(victims))
                graph.kill(victim)
                killed[victim] += 1
                saved.append(progress(team.learning_state))
                print(f"kill {killed.total()}: {victim}, learned {saved[-1]}", flush=True)
            graph.recover()
            team.stop()
            saved.append(progress(team.learning_state))
    bags, broken = list[tuple[int, int]](), list[str]()
    for path in team.bags:
        try:
            bags.append(whole(path))
        except (RledError, AssertionError) as error:
            broken.append(str(error))
    stamps, positions = zip(*graph.joints, strict=True)
    return {
        "kills": dict(killed),
        "well_again_s": {"median": round(float(np.median(graph.took)), 1), "longest": round(max(graph.took), 1)},
        "states_watched": len(stamps),
        "outside_limits": outside_limits(np.array(stamps), np.array(positions)) + sum(bad for _, bad in bags),
        "transitions_and_updates_saved": saved[-1],
        "learning_lost": sum(after < before for before, after in pairwise(saved)),
        "whole_bags": len(bags),
        "broken_bags": broken,
        "states_and_commands_in_bags": sum(count for count, _ in bags),
        "load_average": os.getloadavg()[0],
    }


def progress(state: Path) -> tuple[int, int]:
    """Transitions and gradient steps that a saved state has come to."""
    if not state.exists():
        return 0, 0
    found = read_checkpoint(state).state
    return found["added"], found["updates"]


def main() -> None:
    """Measure and print; exits with 1 when anything was not as it must be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, private_graph():
        figures = measure(options.kills, options.seed, Path(folder))
    print(json.dumps(figures, indent=2))
    sys.exit(1 if figures["outside_limits"] or figures["learning_lost"] or figures["broken_bags"] else 0)


if __name__ == "__main__":
    main()
