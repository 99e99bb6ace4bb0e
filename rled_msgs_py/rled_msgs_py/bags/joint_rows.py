"""Joint messages as states of one robot: other joints are passed over, halves of two publishers put together."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rled_msgs_py.bags.columns import Floats, Stamps
from rled_msgs_py.bags.stamps import going_on
from rled_msgs_py.bags.tables import JointTable
from rled_msgs_py.joint_merger import MAX_AGE

Places = NDArray[np.intp]


class Odd(NamedTuple):
    """A message that is no state: its row, why, and whether it names other joints."""

    row: int
    what: str
    is_renamed: bool


class JointRows(NamedTuple):
    """States, k of them, in the order of their messages.

    Attributes:
        stamps: simulation time (ns), shape (k,).
        position: joint angles (rad) in the order asked for, shape (k, n).
        odd: messages that are no state and that nothing completes.
    """

    stamps: Stamps
    position: Floats
    odd: list[Odd]


def joint_rows(table: JointTable, wanted: tuple[str, ...], ticks: Callable[[], Stamps] | None) -> JointRows:
    """The states of the joints ``wanted``.

    A message that names none of them is passed over. Messages that name some of them are put together: those of one
    stamp; and where their publishers have stamps of their own, with the newest of the others, if it is not too old.

    Args:
        table: the messages; each wanted joint is named by one at least.
        wanted: joint names, n.
        ticks: the stamps of the robot's other topics (ns), at which a state is due; None where messages are never put
            together.
    """
    columns = [table.names.index(name) for name in wanted]
    position, named = table.position[:, columns], table.named[:, columns]
    known = np.isfinite(position)
    whole = known.all(axis=1)
    if whole.all():
        return JointRows(table.stamps, position, [])
    odd = [
        Odd(row, _unknown(wanted, named[row] & ~known[row], position[row]), False)
        for row in np.flatnonzero((named & ~known).any(axis=1)).tolist()
    ]
    partial = np.flatnonzero(named.any(axis=1) & ~named.all(axis=1))
    if not len(partial):
        return JointRows(table.stamps[whole], position[whole], odd)
    places, stamps, values = np.flatnonzero(whole), table.stamps[whole], position[whole]
    if ticks is not None:  # what a recorder heard before the first state is no fault
        due = ticks()
        halves = _put_together(table.stamps, position, named, partial, due)
        places = np.concatenate([places, halves.places])
        stamps, values = np.concatenate([stamps, halves.stamps]), np.concatenate([values, halves.position])
        told = np.concatenate([halves.stamps, table.stamps[[each.row for each in odd]]])
        partial = partial[~np.isin(table.stamps[partial], told) & (partial >= (places.min() if len(places) else 0))]
        partial = partial[np.isin(table.stamps[partial], due)] if len(due) else partial
    odd += [Odd(row, _missing(table, row, wanted, named[row]), True) for row in partial.tolist()]
    order = np.argsort(places, kind="stable")
    return JointRows(stamps[order], values[order], sorted(odd))


class _Halves(NamedTuple):
    """States put together: the place of the first message of each, its stamp (ns), its angles (rad)."""

    places: Places
    stamps: Stamps
    position: Floats


def _put_together(stamps: Stamps, position: Floats, named: NDArray[np.bool_], partial: Places, due: Stamps) -> _Halves:
    here = np.flatnonzero(named.any(axis=1))
    moments = np.zeros(len(stamps), np.int64)
    moments[here] = going_on(stamps[here])
    keeps_step = _keeps_step(moments, named, here)
    at, first = np.unique(moments[partial], return_index=True)
    newest, oldest = (np.full((len(at), named.shape[1]), np.nan) for _ in range(2))
    is_exact = np.ones(len(at), dtype=bool)
    for joint in range(named.shape[1]):
        rows = here[named[here, joint]]
        rows = rows[np.argsort(moments[rows], kind="stable")]
        last = np.searchsorted(moments[rows], at, side="right") - 1
        row = rows[np.maximum(last, 0)]
        exact = (last >= 0) & (moments[row] == at)
        recent = (last >= 0) & ~keeps_step[row] & (at - moments[row] <= MAX_AGE)
        newest[:, joint] = np.where(exact | recent, position[row, joint], np.nan)
        begun = rows[np.minimum(np.searchsorted(moments[rows], at), len(rows) - 1)]
        oldest[:, joint] = np.where(exact, position[begun, joint], newest[:, joint])
        is_exact &= exact
    places, at_stamps = partial[first], stamps[partial[first]]
    whole = np.isfinite(newest).all(axis=1)
    whole &= is_exact | (np.isin(at_stamps, due) if len(due) else True)
    contradicted = whole & (newest != oldest).any(axis=1)  # two publishers of one joint: both are told
    both = [np.concatenate([each[whole], each[contradicted]]) for each in (places, at_stamps)]
    return _Halves(both[0], both[1], np.concatenate([newest[whole], oldest[contradicted]]))


def _keeps_step(moments: Stamps, named: NDArray[np.bool_], here: Places) -> NDArray[np.bool_]:
    """Whether a message is of a publisher whose stamps are those of the others, which is then waited for."""
    keeps = np.ones(len(moments), dtype=bool)
    groups = np.unique(named[here], axis=0, return_inverse=True)[1].ravel()
    for group in range(groups.max() + 1):
        own = here[groups == group]
        others = here[groups != group]
        keeps[own] = named[own[0]].all() or np.isin(moments[own], moments[others]).mean() >= 0.5
    return keeps


def _unknown(wanted: tuple[str, ...], which: NDArray[np.bool_], position: Floats) -> str:
    told = ", ".join(f"{wanted[place]} is at {position[place]}" for place in np.flatnonzero(which).tolist())
    return f"is not valid: {told}"


def _missing(table: JointTable, row: int, wanted: tuple[str, ...], named: NDArray[np.bool_]) -> str:
    names = ", ".join(name for name, told in zip(table.names, table.named[row].tolist(), strict=True) if told)
    missing = ", ".join(name for name, told in zip(wanted, named.tolist(), strict=True) if not told)
    return f"is of {names}: it lacks {missing}"
