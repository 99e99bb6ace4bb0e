"""Inputs that once failed, packed into one file of JSON lines: the target, the finding's name, the input.

An input that is printable text is written as it is, any other in base64.
"""

import base64
import json
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

CASES = Path(__file__).parent / "cases.jsonl"


class Case(NamedTuple):
    """An input that a target must read or refuse."""

    target: str
    name: str
    data: bytes


def read_cases(path: Path = CASES) -> list[Case]:
    return [_unpacked(json.loads(line)) for line in path.read_text("ascii").splitlines()]


def cases_of(target: str) -> list[Case]:
    return [case for case in read_cases() if case.target == target]


def add_cases(found: Iterable[Path], path: Path = CASES) -> list[Case]:
    """Add findings, each in a folder that is named as its target; return those that are new."""
    known = {(case.target, case.name): case for case in (read_cases(path) if path.exists() else ())}
    given = [Case(each.absolute().parent.name, each.name, each.read_bytes()) for each in found]
    new = [case for case in given if known.get((case.target, case.name)) != case]
    known |= {(case.target, case.name): case for case in new}
    path.write_text("".join(_packed(known[key]) + "\n" for key in sorted(known)), "ascii")
    return new


def _packed(case: Case) -> str:
    is_text = case.data.isascii() and case.data.decode("ascii").replace("\n", "").isprintable()
    said = {"text": case.data.decode("ascii")} if is_text else {"base64": base64.b64encode(case.data).decode("ascii")}
    return json.dumps({"target": case.target, "name": case.name} | said)


def _unpacked(line: dict[str, str]) -> Case:
    data = line["text"].encode("ascii") if "text" in line else base64.b64decode(line["base64"], validate=True)
    return Case(line["target"], line["name"], data)
