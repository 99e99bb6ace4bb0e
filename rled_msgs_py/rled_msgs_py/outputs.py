"""Where results go is looked at before the work that they come of."""

import tempfile
from pathlib import Path

from rled_msgs_py.errors import RledError

ANOTHER = "name another folder with --output"


def require_output(folder: Path, *names: str, remedy: str = ANOTHER) -> None:
    """Refuse a folder that files can't be written into; it need not exist, and is not made.

    Args:
        folder: where the files will lie.
        names: of the files; one that exists is replaced, a folder in its place can't be.
        remedy: what the user can do.

    Raises:
        RledError: the folder or one above it is a file, or can't be written into, or a folder has a file's name.
    """
    try:
        place = folder
        while not place.is_dir():
            if place.exists() or place.is_symlink():
                raise RledError(f"{place} is no folder", "a folder for the results", remedy)
            place = place.parent
        for name in names:
            if (folder / name).is_dir():
                raise RledError(f"{folder / name} is a folder", "a file, or nothing", remedy)
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        accepted = "a folder that can be written into"
        raise RledError(f"can't write into {folder} ({error.strerror or error})", accepted, remedy) from None
