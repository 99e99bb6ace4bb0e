"""Tables of numbers as CSV, which other programs and people may have written in too."""

import csv
import io
from pathlib import Path

from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.untrusted import read_text

MAX_BYTES = 64 << 20
"""Bytes of a table: some hundred thousand rows."""


def read_rows(path: Path, *columns: str) -> list[dict[str, float]]:
    """The rows of a table, by column.

    Args:
        path: the file.
        columns: those that it has to have.

    Raises:
        RledError: it cannot be read, is cut, or has something in it that is no number; names the line.
    """
    try:
        reader = csv.DictReader(io.StringIO(read_text(path, "it", MAX_BYTES), newline=""))
        names = reader.fieldnames or []
        if missing := [name for name in columns if name not in names]:
            raise RledError(f"{path} has no column {', '.join(missing)}", "a table that this version wrote")
        return [_numbers(row, path, reader.line_num) for row in reader]
    except (OSError, csv.Error, ContractError) as error:
        raise RledError(f"{path} cannot be read ({error})", "a table that this version wrote") from None


def _numbers(row: dict[str, str], path: Path, line: int) -> dict[str, float]:
    """A row; a cut one has None for a column, one that is too long has None for a name."""
    try:
        if None in row:
            raise ValueError
        return {name: float(value) for name, value in row.items()}
    except (TypeError, ValueError):
        what, remedy = f"{path} is damaged in line {line}", "remove that line and those after it"
        raise RledError(what, "a number in each column", remedy) from None
