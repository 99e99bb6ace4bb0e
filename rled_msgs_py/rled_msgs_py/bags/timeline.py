"""A recording as rows, one for each tick whose state is whole."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rled_msgs_py.bags.bag import Bag
from rled_msgs_py.bags.series import Floats, Series, series
from rled_msgs_py.bags.stamps import Times
from rled_msgs_py.joint_names import find_by_name
from rled_msgs_py.tick import STATE_TOPICS
from rled_msgs_py.topics import JOINT_DELTA, JOINT_STATES

READ = (*STATE_TOPICS, JOINT_DELTA)


class Timeline(NamedTuple):
    """k ticks in order.

    Attributes:
        moments: time (ns), that goes on where stamps begin anew, shape (k,).
        q: joint angles (rad) in the order of the task, shape (k, n).
        position: end effector (m), shape (k, 3).
        target: target (m), shape (k, 3).
        episode: episode counter of the simulation, shape (k,).
        step: step within it, shape (k,).
        reached: targets reached within it, shape (k,).
        action: Δq (rad) that answers the tick, NaN where none does, shape (k, n).
        is_anew: whether the stamps begin anew with the tick, shape (k,).
    """

    moments: Times
    q: Floats
    position: Floats
    target: Floats
    episode: NDArray[np.int64]
    step: NDArray[np.int64]
    reached: NDArray[np.int64]
    action: Floats
    is_anew: NDArray[np.bool_]

    @property
    def answered(self) -> NDArray[np.bool_]:
        """Whether a displacement answers the tick, shape (k,)."""
        answered: NDArray[np.bool_] = np.all(np.isfinite(self.action), axis=1)
        return answered


def read_series(bag: Bag) -> dict[str, Series]:
    """The state topics and the displacements, by name.

    Raises:
        BagError: the file is damaged.
    """
    return {topic.name: series(bag, topic) for topic in READ}


def read_timeline(bag: Bag, found: dict[str, Series] | None = None) -> Timeline:
    """Put the topics together; what is recorded twice counts once.

    A bag without ``task_status`` has one episode, in which each change of the target is a target reached.

    Raises:
        BagError: the file is damaged.
        ContractError: a joint of the task is in no message.
    """
    found = found or read_series(bag)
    names, n = bag.task.joint_names, bag.task.action_size
    states, ee, target, status, delta = (found[topic.name] for topic in READ)
    parts = [states, ee, target, *([status] if len(status.moments) else [])]
    moments = parts[0].moments
    for part in parts:
        moments = np.intersect1d(moments, part.moments)
    goal = _rows(target, moments)[:, :3]
    action = np.full((len(moments), n), np.nan)
    _, here, there = np.intersect1d(moments, delta.moments, return_indices=True)
    if len(here):
        action[here] = delta.values[there][:, find_by_name(delta.names, names, JOINT_DELTA.name)]
    if len(status.moments):
        episode, step, reached = _rows(status, moments)[:, :3].astype(np.int64).T
    else:
        episode, step, reached = _counted(goal)
    q = _rows(states, moments)
    q = q[:, find_by_name(states.names, names, JOINT_STATES.name)] if len(q) else q.reshape(0, n)
    shift = (states.moments - states.stamps)[_places(states, moments)]
    is_anew = np.diff(shift, prepend=shift[:1]) != 0
    return Timeline(moments, q, _rows(ee, moments)[:, :3], goal, episode, step, reached, action, is_anew)


def _counted(goal: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    step = np.arange(len(goal))
    return np.zeros_like(step), step, np.cumsum(np.any(np.diff(goal, axis=0, prepend=goal[:1]) != 0, axis=1))


def _rows(part: Series, moments: Times) -> Floats:
    rows: Floats = part.values[_places(part, moments)]
    return rows.reshape(len(moments), -1) if len(moments) else np.empty((0, 7))


def _places(part: Series, moments: Times) -> NDArray[np.intp]:
    """Of the first row at each of some moments, shape (k,)."""
    _, places = np.unique(part.moments, return_index=True)
    return places[np.isin(part.moments[places], moments)]
