"""Rows of the table of faults."""

from collections.abc import Callable, Iterator

import pytest

from .table import DOCUMENT, WRITES, Row, keep


@pytest.fixture(scope="module")
def row(request: pytest.FixtureRequest) -> Iterator[Callable[[str, str, float, list[str]], None]]:
    """Takes a row: to be written, or compared with what the document says; ``test_table_PART`` has those of a part."""
    name = request.module.__name__.rpartition(".")[2]
    rows: list[Row] = []

    def take(fault: str, decision: str, milliseconds: float, outside_limits: list[str]) -> None:
        assert outside_limits == []
        rows.append(Row(fault, name.removeprefix("test_table_"), decision, milliseconds, not outside_limits))
        if not WRITES:
            assert rows[-1].text() in DOCUMENT.read_text(), "docs/faults.md says otherwise: make faults"

    yield take
    if WRITES:
        keep(name, rows)
