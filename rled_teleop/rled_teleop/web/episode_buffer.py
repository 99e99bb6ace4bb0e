"""The ticks and displacements of one episode as numbers in a row: an episode of an hour is no burden."""

from array import array

import numpy as np
from rled_msgs_py.bags.timeline import Timeline
from rled_msgs_py.joint_names import order_by_name
from rled_msgs_py.records import DeltaCommand
from rled_msgs_py.tick import Tick

MAX_TICKS = 60_000
"""Ticks of one episode that are kept (20 minutes at 50 Hz, 8 MB); later ones are left out."""


class EpisodeBuffer:
    """What the measures of an episode need of its ticks; ticks of other joints than the first has are left out."""

    def __init__(self) -> None:
        self._names: tuple[str, ...] = ()
        self._stamps, self._states, self._counters = array("q"), array("d"), array("q")
        self._answered, self._actions = array("q"), array("d")

    def __len__(self) -> int:
        return len(self._stamps)

    @property
    def seconds(self) -> float:
        """From the first to the last tick (s)."""
        return (self._stamps[-1] - self._stamps[0]) * 1e-9 if self._stamps else 0.0

    def add_tick(self, tick: Tick) -> None:
        """Take a tick."""
        self._names = self._names or tick.joints.names
        if len(self._stamps) < MAX_TICKS and set(tick.joints.names) == set(self._names):
            status = tick.status
            self._stamps.append(tick.stamp)
            self._states.extend(tick.joints.ordered(self._names).position.tolist())
            self._states.extend((*tick.ee.position.tolist(), *tick.target.position.tolist()))
            self._counters.extend((status.episode, status.step, status.targets_reached))

    def add_delta(self, command: DeltaCommand) -> None:
        """Take the displacement that answers a tick, which has come before it."""
        if self._names and len(self._answered) < MAX_TICKS and set(command.names) == set(self._names):
            self._answered.append(command.stamp)
            self._actions.extend(command.ordered(self._names).delta.tolist())

    def timeline(self, names: tuple[str, ...]) -> Timeline:
        """All of it, one row a tick, with the joints in an order.

        Raises:
            ContractError: these are not the joints.
        """
        order, n = order_by_name(self._names, names, "an episode"), len(self._names)
        moments, states = np.array(self._stamps), np.array(self._states).reshape(-1, n + 6)
        episode, step, reached = np.array(self._counters).reshape(-1, 3).T
        action = np.full((len(moments), n), np.nan)
        newest = dict(zip(self._answered, range(len(self._answered)), strict=True))
        there = np.array([newest.get(stamp, -1) for stamp in self._stamps])
        action[there >= 0] = np.array(self._actions).reshape(-1, n)[there[there >= 0]]
        return Timeline(
            moments=moments,
            q=states[:, :n][:, order],
            position=states[:, n : n + 3],
            target=states[:, n + 3 :],
            episode=episode,
            step=step,
            reached=reached,
            action=action[:, order],
            is_anew=np.diff(moments, prepend=moments[:1]) < 0,
        )
