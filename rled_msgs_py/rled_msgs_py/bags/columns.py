"""Many messages of one topic as columns of numbers.

The messages of one publisher have the same names, so the same length and the same places for their numbers. The layout
is worked out once, from the first message of a length, and all of that length are looked at through it in a few array
operations. Where one does not fit (other names, a NaN) they are read one by one, which accepts it or names it.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rled_msgs_py.bags.layout import Layout, stamps_of, view
from rled_msgs_py.bags.storage import Messages
from rled_msgs_py.errors import ContractError
from rled_msgs_py.messages import decode
from rled_msgs_py.records import Record
from rled_msgs_py.topics import Topic

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]

MAX_SIZES = 16
"""Sizes of messages in a run that are looked at each on their own."""


class Columns(NamedTuple):
    """What tables are made of: one row of a message, or the rows of many."""

    stamps: Any
    labels: tuple[str, ...]
    left: Floats
    right: Floats


class Part(NamedTuple):
    """Messages with the same labels: their places among all of the topic, their log times, their columns."""

    places: Stamps
    times: Stamps
    columns: Columns


class Kind(NamedTuple):
    """How one kind of message becomes columns.

    Attributes:
        labels: what the labels are, for an error; None where they may differ from message to message.
        of: the row of a record.
        place: adds the fields after the header to a layout, for n labels.
        view: both number columns of messages seen through that layout, or None where one is not valid.
    """

    labels: str | None
    of: Callable[[Any], Columns]
    place: Callable[[Layout, int], None]
    view: Callable[[NDArray[np.void], Record], tuple[Floats, Floats] | None]


def payloads(run: Messages) -> Iterator[bytes]:
    """The serialized messages of a run."""
    for start, size in zip(run.start.tolist(), run.size.tolist(), strict=True):
        yield run.data[start : start + size]


def read_record(topic: Topic, number: int, data: bytes) -> Record:
    """Decode a message.

    Raises:
        ContractError: names the message.
    """
    try:
        return decode(topic, data)
    except ContractError as error:
        raise ContractError(f"message {number} of {topic.name}: {error.what}", error.accepted, error.remedy) from None


def parts_of(kind: Kind, topic: Topic, runs: Iterable[Messages]) -> list[Part]:
    """The messages of a topic, in the order of their first places.

    Raises:
        ContractError: one is not valid, or has other labels where all have the same.
    """
    parts, number = list[Part](), 0
    for run in runs:
        for chosen in _of_one_size(run):
            some, places = run if chosen is None else run.chosen(chosen), _places(run, chosen) + number
            first = read_record(topic, int(places[0]), next(payloads(some)))
            columns = _looked_at(kind, some, first)
            if columns is None or (kind.labels and parts and columns.labels != parts[0].columns.labels):
                parts += _read(kind, topic, some, places, parts[0].columns.labels if parts else kind.of(first).labels)
            else:
                parts.append(Part(places, some.log_time, columns))
        number += len(run.size)
    return sorted(parts, key=lambda part: int(part.places[0]))


def _of_one_size(run: Messages) -> list[NDArray[np.intp] | None]:
    """The messages of each size, None for all; all together where the sizes are many."""
    sizes, of = (run.size[:1], None) if not np.diff(run.size).any() else np.unique(run.size, return_inverse=True)
    if not len(sizes):
        return []
    return [None] if of is None or len(sizes) > MAX_SIZES else [np.flatnonzero(of == k) for k in range(len(sizes))]


def _places(run: Messages, chosen: NDArray[np.intp] | None) -> Stamps:
    return np.arange(len(run.size)) if chosen is None else chosen.astype(np.int64)


def order_of(parts: list[Part]) -> NDArray[np.intp]:
    """What brings the rows of all parts into the order of their log times."""
    places, times = (np.concatenate(column) for column in list(zip(*parts, strict=True))[:2])
    by_place = np.argsort(places, kind="stable")
    return by_place[np.argsort(times[by_place], kind="stable")]


def _looked_at(kind: Kind, run: Messages, first: Record) -> Columns | None:
    """The columns of messages that all have the layout of the first, None where one has not or is not valid."""
    layout, labels = Layout(next(payloads(run))), kind.of(first).labels
    try:
        layout.header()
        kind.place(layout, len(labels))
    except ValueError:
        return None
    rows = view(run, layout.dtype())
    stamps = None if rows is None else stamps_of(rows)
    if rows is None or stamps is None:
        return None
    numbers = kind.view(rows, first)
    return Columns(stamps, labels, *numbers) if numbers else None


def _read(kind: Kind, topic: Topic, run: Messages, places: Stamps, labels: tuple[str, ...]) -> list[Part]:
    """Messages read one by one.

    Raises:
        ContractError: one is not valid, or has other labels where all have the same.
    """
    rows = list[Columns]()
    for place, data in zip(places.tolist(), payloads(run), strict=True):
        row = kind.of(read_record(topic, place, data))
        if kind.labels and row.labels != labels:
            what = f"message {place} of {topic.name} (stamp {row.stamps} ns) has the {kind.labels} "
            raise ContractError(what + ", ".join(row.labels), f"{', '.join(labels)} in every message")
        rows.append(row)
    return by_labels(places, run.log_time, rows)


def by_labels(places: Stamps, times: Stamps, rows: Iterable[Columns]) -> list[Part]:
    """Rows one by one as parts, those of the same labels together."""
    groups = dict[tuple[str, ...], list[tuple[int, Columns]]]()
    for number, row in enumerate(rows):
        groups.setdefault(row.labels, []).append((number, row))
    parts = []
    for labels, group in groups.items():
        numbers, found = zip(*group, strict=True)
        chosen = np.array(numbers)
        stamps, _, left, right = zip(*found, strict=True)
        columns = Columns(np.array(stamps, np.int64), labels, np.array(left), np.array(right))
        parts.append(Part(places[chosen], times[chosen], columns))
    return parts
