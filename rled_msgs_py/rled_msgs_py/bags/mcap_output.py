"""A file that is written piece by piece."""

import os
from pathlib import Path
from zlib import crc32


class Output:
    """A new file, written without a buffer, so that nothing is left in the process after a failure.

    Attributes:
        size: bytes written.
        crc: their checksum.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)
        self.size = self.crc = 0

    def fileno(self) -> int:
        """The file's descriptor."""
        return self._file.fileno()

    def write(self, data: bytes) -> None:
        """Hand bytes to the operating system, which keeps them when this process is killed.

        Raises:
            OSError: it did not take all of them.
        """
        view = memoryview(data)
        while view:
            view = view[self._file.write(view) :]
        self.size, self.crc = self.size + len(data), crc32(data, self.crc)

    def close(self) -> None:
        """Close the file with what was written whole."""
        self._file.truncate(self.size)
        self._file.close()

    def sync(self) -> None:
        """Wait until what was written survives a loss of power."""
        os.fsync(self._file.fileno())
