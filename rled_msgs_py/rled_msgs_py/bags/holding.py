"""Who writes a bag, or takes it away, holds its files: by a lock that ends with its process, however that ends.

No process removes a file by its name alone: it may be another process's by now.
"""

import fcntl
import glob
import os
import shutil
import tempfile
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO

from rled_msgs_py.bags.error import BagError, BagInUse

ROOM = ".new-"
"""Part of the name of a folder in which a file or a bag is made before it takes its place."""

ORIGINAL = ".original"
"""Added to the name of a file that is kept beside what took its place."""


def lock(file: IO[bytes], path: Path) -> IO[bytes]:
    """Hold an open file until it is closed.

    Raises:
        BagInUse: another process holds it.
    """
    try:
        fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        is_held = True
    except OSError as error:
        is_held = not isinstance(error, BlockingIOError)  # or a file system without locks
    if is_held and _is_at(file, path):
        return file
    file.close()
    raise BagInUse(f"{path} is being recorded", "a bag that nobody writes", "end the recorder first")


def _is_at(file: IO[bytes], path: Path) -> bool:
    """Whether a path still leads to an open file; another process may have moved it before it was held."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False


def hold(path: Path) -> IO[bytes]:
    """Hold a file that is there, until what is returned is closed.

    Raises:
        BagError: another process holds it, or it cannot be opened.
    """
    try:
        if not path.is_file():  # a pipe would be waited for
            raise BagError(f"{path} is no regular file", "an .mcap file")
        mode = "rb+" if os.access(path, os.W_OK) else "rb"  # a network file system locks what is open for writing
        return lock(path.open(mode), path)
    except OSError as error:
        raise BagError(f"{path} cannot be read: {error.strerror}") from None


def require_idle(folder: Path) -> None:
    """See that nobody writes a bag.

    Raises:
        BagError: another process holds one of its files.
    """
    with ExitStack() as files:
        _hold_all(folder, files, ())


@contextmanager
def taking_turns(path: Path) -> Iterator[None]:
    """A block in which no other process that takes turns makes or replaces something beside a path.

    Who comes while another makes room and begins would else take an empty folder away, and both would record. A file
    system without locks has none of it.

    Raises:
        OSError: the folder that the path is in cannot be made or opened.
    """
    if not path.parent.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with suppress(OSError):
            fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)


@contextmanager
def replaced(folder: Path) -> Iterator[None]:
    """Take a bag's folder away for good when the block ends without an error, and put it back otherwise.

    Raises:
        BagError: another process holds one of its files.
        OSError: it cannot be moved.
    """
    with ExitStack() as files, temporary_folder(folder) as room:
        known = _hold_all(folder, files, ())
        aside = room / folder.name
        folder.rename(aside)
        try:
            _hold_all(aside, files, known)  # what came while it was moved
            yield
        except BaseException:
            aside.rename(room.with_name(room.name + ORIGINAL) if folder.exists() else folder)
            raise


def _hold_all(folder: Path, files: ExitStack, known: Collection[str]) -> list[str]:
    names = [path.name for path in folder.glob("*.mcap") if path.is_file() and path.name not in known]
    for name in names:
        files.enter_context(hold(folder / name))
    return names


@contextmanager
def temporary_folder(beside: Path) -> Iterator[Path]:
    """A folder with a name of its own beside a path; it is gone after the block.

    Raises:
        OSError: it cannot be made.
    """
    room = Path(tempfile.mkdtemp(prefix=f".{beside.name}{ROOM}", dir=beside.parent))
    try:
        yield room
    finally:
        shutil.rmtree(room, ignore_errors=True)


def remove_temporary_folders(beside: Path) -> None:
    """Remove what killed processes have left; only for who holds ``beside``, so that none of them is alive."""
    with suppress(OSError):
        for room in beside.parent.glob(f".{glob.escape(beside.name)}{ROOM}*"):
            shutil.rmtree(room, ignore_errors=True)
