"""Weights handed from a learning process to a control process through shared memory, without waiting on either side."""

from multiprocessing import resource_tracker
from multiprocessing.shared_memory import SharedMemory

import numpy as np
from rled_msgs_py.errors import RledError

HEADER = 16
"""Bytes before the weights: two int64, the version when a write began and the version when it ended."""


class SharedParameters:
    """One flat float32 vector with a version; a reader that meets a write in progress keeps what it has.

    Args:
        size: numbers in the vector.
        name: of an existing slot to join; None makes one, which ends with its maker.
    """

    def __init__(self, size: int, name: str | None = None) -> None:
        self._owner = name is None
        self._memory = SharedMemory(name, create=name is None, size=HEADER + 4 * size)
        if name is not None:
            resource_tracker.unregister(self._memory._name, "shared_memory")  # type: ignore[attr-defined]
        if self._memory.size < HEADER + 4 * size:
            raise RledError(f"the slot {name} is too small for {size} weights")
        self._versions = np.ndarray(2, dtype=np.int64, buffer=self._memory.buf)
        self._weights = np.ndarray(size, dtype=np.float32, buffer=self._memory.buf, offset=HEADER)
        self._seen = 0
        if self._owner:
            self._versions[:] = 0

    @property
    def name(self) -> str:
        """What the other process joins by."""
        return self._memory.name

    def put(self, weights: np.ndarray) -> None:
        """Write a new version."""
        self._versions[0] += 1
        self._weights[:] = weights
        self._versions[1] = self._versions[0]

    def take(self, weights: np.ndarray) -> bool:
        """Copy a version that was not taken yet; False leaves a copy that must not be used.

        Returns:
            Whether ``weights`` now holds a whole new version.
        """
        ended = int(self._versions[1])
        if ended == self._seen:
            return False
        weights[:] = self._weights
        if int(self._versions[0]) != ended:
            return False
        self._seen = ended
        return True

    def close(self) -> None:
        """Leave the slot; its maker removes it."""
        del self._versions, self._weights
        self._memory.close()
        if self._owner:
            self._memory.unlink()
