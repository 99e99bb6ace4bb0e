"""The second table of docs/faults.md names tests that are there."""

import re

from .table import BY_HAND, DOCUMENT, ROOT

ROWS = re.findall(r"^\| (.+?) \| .+ \| `(.+?)::(.+?)` \|$", DOCUMENT.read_text().partition(BY_HAND)[2], re.MULTILINE)


def test_the_table_has_rows():
    assert len(ROWS) >= 32
    assert len(ROWS) == DOCUMENT.read_text().partition(BY_HAND)[2].count("::")


def test_the_test_of_each_row_is_there():
    missing = [
        f"{path}::{name}"
        for _, path, name in ROWS
        if not re.search(rf"^(async )?def {name}\(", (ROOT / path).read_text(), re.MULTILINE)
    ]
    assert missing == []
