"""What a bag's reader asks of a file format."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray


class BagTopic(NamedTuple):
    """A topic as a bag describes it.

    Attributes:
        name: absolute name.
        type: message type, ``package/msg/Type``; whatever a foreign recorder writes, or empty.
        encoding: of the messages, ``cdr``.
        definition: text of the message definition; bytes that are no UTF-8 are kept as surrogates.
        definition_encoding: of that text, ``ros2msg``.
        hash: REP 2016 hash of the type, or empty.
        qos: offered quality of service, YAML as rosbag2 writes it, or empty.
        details: whatever else a foreign recorder says of it, by name.
    """

    name: str
    type: str
    encoding: str
    definition: str
    definition_encoding: str
    hash: str
    qos: str
    details: tuple[tuple[str, str], ...] = ()


class Messages(NamedTuple):
    """A run of k serialized messages inside one buffer, in the order of the file.

    Attributes:
        data: the buffer.
        channel: whose message it is, shape (k,).
        log_time: time of its arrival (ns), shape (k,).
        publish_time: time of its sending (ns), shape (k,).
        start: where its payload begins in ``data``, shape (k,).
        size: bytes of its payload, shape (k,).
    """

    data: bytes
    channel: NDArray[np.int64]
    log_time: NDArray[np.int64]
    publish_time: NDArray[np.int64]
    start: NDArray[np.int64]
    size: NDArray[np.int64]

    def chosen(self, which: NDArray[Any]) -> "Messages":
        """Some of them: a mask of shape (k,), or places."""
        return Messages(self.data, *(column[which] for column in self[1:]))


class Storage(Protocol):
    """One file of a bag, open for reading."""

    @property
    def topics(self) -> Mapping[int, BagTopic]:
        """Topics by channel; one topic may have several channels."""
        ...

    @property
    def counts(self) -> Mapping[int, int]:
        """Messages of each channel."""
        ...

    @property
    def custom(self) -> Mapping[str, str]:
        """Metadata that the recorder's user gave."""
        ...

    def messages(self, channels: Collection[int]) -> Iterator[Messages]:
        """Messages of some channels, in runs.

        Raises:
            BagError: the file is damaged there.
        """
        ...
