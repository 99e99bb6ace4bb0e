"""The newest of what the graph says, for the page to look at when it likes. All methods are thread-safe."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

from rled_msgs_py.errors import ContractError
from rled_msgs_py.records import Actor, DeltaCommand, GateDecision, Health
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick
from rled_msgs_py.topics import EPISODE_EVENTS
from rled_msgs_py.untrusted import read_json

from rled_teleop.web.curves import Curves
from rled_teleop.web.episode_log import EpisodeLog
from rled_teleop.web.trail import Pieces, Trail

Point = tuple[float, float, float]
MAX_REPORTS = 50
"""Nodes and parts whose newest report is kept."""


@dataclass(frozen=True)
class OtherNodes:
    """What the node knows of the nodes around it.

    Attributes:
        recorder: a recorder answers.
        agent: an agent's services answer.
        beside: somebody else answers the states; the page only takes over.
        others: who else publishes displacements.
        parameters: of the agent that can be set, by name.
        answer: what another node said last.
    """

    recorder: bool = False
    agent: bool = False
    beside: bool = True
    others: tuple[str, ...] = ()
    parameters: dict[str, Any] = field(default_factory=dict)
    answer: str = ""


class GraphState:
    """Newest-value slots and short histories.

    Attributes:
        tick: the newest, None before the first.
        task: of the simulation.
        description: URDF of its robot.
        curve: that targets are drawn from (m), closed; empty when nobody draws it.
        decision: the gate's newest.
        nodes: the nodes around.
        log: episodes of the recording.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self.tick: Tick | None = None
        self.task: TaskDescription | None = None
        self.description = ""
        self.curve: Sequence[Point] = ()
        self.decision: GateDecision | None = None
        self.nodes = OtherNodes()
        self.log = EpisodeLog()
        self._health: dict[str, Health] = {}
        self._trail, self._curves = Trail(), Curves()
        self._actor = Actor.HOLD

    def on_tick(self, tick: Tick, is_commanded: bool) -> None:
        """Take a tick, and whether a person's command is at work from here on."""
        with self._lock:
            before, decision = self.tick, self.decision
            actor = self._actor
            if before is not None and decision is not None and decision.stamp == before.stamp:
                actor = decision.actor
            self.tick = tick
            self._trail.add(tick, actor)
            self._curves.add_tick(tick)
            self._actor = Actor.HUMAN if is_commanded else Actor.EXPERT if self.nodes.beside else Actor.HOLD
        self.log.add_tick(tick)

    def on_decision(self, decision: GateDecision) -> None:
        """Take a decision of the gate."""
        with self._lock:
            self.decision = decision
            self._curves.add_decision(decision)

    def on_delta(self, command: DeltaCommand) -> None:
        """Take a displacement that answers a tick."""
        self.log.add_delta(command)

    def on_health(self, health: Health) -> None:
        """Take a node's report."""
        with self._lock:
            self._health.pop(health.name, None)
            self._health[health.name] = health
            if len(self._health) > MAX_REPORTS:
                del self._health[next(iter(self._health))]

    def on_event(self, text: str) -> None:
        """Take an event of the recorder."""
        try:
            event = read_json(text, EPISODE_EVENTS.name)
            self.log.add_event(str(event["event"]), int(event["episode"]), str(event.get("outcome", "")))
        except (ContractError, ValueError, KeyError, TypeError, AttributeError, OverflowError):
            return

    def health(self, name: str) -> Health | None:
        """The newest report of a node's part."""
        return self._health.get(name)

    def forget_health(self, name: str) -> None:
        """Forget a report: it is of a process that has ended."""
        with self._lock:
            self._health.pop(name, None)

    def pieces(self) -> Pieces:
        """The trail."""
        with self._lock:
            return self._trail.pieces()

    def episodes(self) -> tuple[Any, ...]:
        """Curves over episodes, see ``Curves.episodes``."""
        with self._lock:
            return self._curves.episodes()

    def decisions(self) -> tuple[Any, ...]:
        """Curves over the newest decisions, see ``Curves.decisions``."""
        with self._lock:
            return self._curves.decisions()
