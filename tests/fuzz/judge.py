"""One input, read: what it led to, if that is not a refusal in the reader's own words."""

import gc
import os
import resource
import shutil
import tempfile
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .bounds import ADDRESSES, FILES, MEMORY
from .findings import Finding
from .target import Target

PAGE = resource.getpagesize()


class Growth(Exception):
    """The memory of this process has grown and does not come back."""


class Judge:
    """Reads inputs of a target, one after the other, each with an empty folder.

    Args:
        target: the reader.
        scratch: folder for the files that it needs.

    Raises:
        Exception: a seed is refused, or worse.
    """

    def __init__(self, target: Target, scratch: Path) -> None:
        self._target, self._scratch = target, scratch
        for seed in target.seeds():  # what is kept for good is there after these
            with self._folder() as folder:
                target.read(seed, folder)
        gc.collect()
        self._base = _resident()
        _forget_peak()
        _bound_process()

    def look(self, data: bytes) -> Finding | None:
        """Read one input.

        Raises:
            Growth: inputs before it have left too much behind.
        """
        finding = self._read(data)
        if _peak() - self._base <= MEMORY:
            return finding
        gc.collect()
        grown, peak = _resident() - self._base, _peak() - self._base
        _forget_peak()
        if grown > MEMORY:
            raise Growth(f"{grown >> 20} MB more than after the first inputs")
        what = f"{peak >> 20} MB for an input of {len(data)} bytes"
        return finding or Finding("memory", what, "")

    def _read(self, data: bytes) -> Finding | None:
        try:
            with self._folder() as folder:
                self._target.read(data, folder)
        except self._target.refusals:
            return None
        except BaseException as error:
            return of_error(error)
        return None

    @contextmanager
    def _folder(self) -> Iterator[Path]:
        folder = Path(tempfile.mkdtemp(dir=self._scratch))
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def of_error(error: BaseException) -> Finding:
    said = " ".join(str(error).split())[:200]
    kind = type(error).__name__
    return Finding(kind, f"{kind}: {said}", "".join(traceback.format_exception(error)))


def _bound_process() -> None:
    size = int(Path("/proc/self/statm").read_text().split()[0]) * PAGE
    for what, most in (
        (resource.RLIMIT_AS, size + ADDRESSES),
        (resource.RLIMIT_FSIZE, FILES),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(what, (most, resource.getrlimit(what)[1]))


def _resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE


def _peak() -> int:
    # not getrusage's, which begins with what the parent had
    status = Path("/proc/self/status").read_text()
    return int(status[status.index("VmHWM:") :].split(maxsplit=2)[1]) << 10


def _forget_peak() -> None:
    with suppress(OSError):  # a container may not allow it: the first peak stays then
        Path("/proc/self/clear_refs").write_text("5")


def scratch_root() -> str | None:
    """Where files cost nothing."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
