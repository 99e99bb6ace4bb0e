"""What was found: an input of a target, what it led to, and how to see it again."""

import hashlib
import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
FRAME = re.compile(r'File "(?P<file>[^"]+)", line \d+,? in (?P<function>\S+)')
LINES = 60
"""Of the beginning and of the end of a stack."""


class Finding(NamedTuple):
    """A failure.

    Attributes:
        kind: name of the error, ``hang``, ``memory`` or a signal's name.
        summary: in one line.
        stack: where it was, innermost last.
    """

    kind: str
    summary: str
    stack: str

    @property
    def cause(self) -> str:
        """What failures of one cause have in common: the kind and the innermost functions of the project."""
        ours = [Path(each["file"]).name + ":" + each["function"] for each in frames(self.stack)]
        return hashlib.sha256("\n".join([self.kind, *ours[-2:]]).encode()).hexdigest()[:8]

    @property
    def place(self) -> str:
        ours = list(frames(self.stack))
        return f"{Path(ours[-1]['file']).name}:{ours[-1]['function']}" if ours else "?"


def frames(stack: str) -> list[re.Match[str]]:
    """The frames of a stack that lie in the packages, or where there are none, all of them."""
    found = list(FRAME.finditer(stack))
    return [each for each in found if re.search(r"/rled_\w+/rled_\w+/", each["file"])] or found


def keep(folder: Path, target: str, finding: Finding, data: bytes) -> Path:
    """Write a finding below a folder; of one cause, the shortest input stays."""
    path = folder / target / f"{finding.kind}-{finding.cause}"
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and path.stat().st_size <= len(data):
        return path
    path.write_bytes(data)
    name = shlex.quote(str(path.relative_to(ROOT) if path.is_relative_to(ROOT) else path))
    text = [
        finding.summary,
        f"see it again: make fuzz ARGS={shlex.quote('--replay ' + name)}",
        f"make it a case: make fuzz ARGS={shlex.quote('--add ' + name)}",
        "",
        _shortened(finding.stack),
    ]
    path.with_suffix(".txt").write_text("\n".join(text))
    return path


def _shortened(stack: str) -> str:
    lines = stack.splitlines()
    return "\n".join(lines if len(lines) <= 2 * LINES else [*lines[:LINES], "...", *lines[-LINES:]])


def kept(folder: Path, target: str) -> list[Path]:
    """Inputs found before."""
    return sorted(path for path in (folder / target).glob("*-????????") if path.is_file())


def digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def of_stack(kind: str, summary: str, lines: Sequence[str]) -> Finding:
    """A finding of what ``faulthandler`` wrote, innermost first."""
    own = [each for each in lines if FRAME.search(each)]
    return Finding(kind, summary, "\n".join(reversed(own)))
