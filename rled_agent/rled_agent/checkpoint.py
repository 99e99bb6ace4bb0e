"""A checkpoint: one safetensors file whose header holds JSON, no pickle anywhere."""

import json
from pathlib import Path
from typing import Any, NamedTuple

from rled_msgs_py.errors import RledError
from rled_msgs_py.files import whole_file
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

FORMAT = "rled-checkpoint"
VERSION = 3


class CheckpointError(RledError):
    """A checkpoint that can't be written or read."""


class Checkpoint(NamedTuple):
    """State of a run.

    Attributes:
        tensors: arrays by dotted name.
        state: everything else, plain JSON values.
    """

    tensors: dict[str, Tensor]
    state: dict[str, Any]


def write_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint whole; what stood there before stays until the new one is complete.

    Raises:
        CheckpointError: the disk is full or can't be written.
    """
    header = {"format": FORMAT, "version": str(VERSION), "state": json.dumps(checkpoint.state)}
    write_tensors(path, checkpoint.tensors, header)


def write_tensors(path: Path, tensors: dict[str, Tensor], header: dict[str, str]) -> None:
    """Write a safetensors file whole.

    Raises:
        CheckpointError: the disk is full or can't be written.
    """
    try:
        with whole_file(path) as temporary:
            save_file({name: each.contiguous() for name, each in tensors.items()}, temporary, header)
            _sort_header(temporary)
    except (OSError, SafetensorError) as error:
        raise CheckpointError(f"can't write {path} ({error})", "", "free disk space; what stood there stays") from None


def _sort_header(path: Path) -> None:
    """Bring the texts of a header into one order: the library's differs from call to call, and with it the file."""
    with path.open("r+b") as file:
        size = int.from_bytes(file.read(8), "little")
        header = json.loads(file.read(size))
        header["__metadata__"] = dict(sorted(header["__metadata__"].items()))
        text = json.dumps(header, separators=(",", ":"), ensure_ascii=False).encode()
        assert len(text) <= size
        file.seek(8)
        file.write(text.ljust(size))


def read_checkpoint(path: Path) -> Checkpoint:
    """Read what ``write_checkpoint`` wrote.

    Raises:
        CheckpointError: missing, damaged, or of another program or version.
    """
    header, tensors = read_tensors(path, FORMAT, VERSION)
    try:
        return Checkpoint(tensors, json.loads(header["state"]))
    except (KeyError, ValueError) as error:
        raise damaged(path, FORMAT, f"header: {error}") from None


def read_tensors(path: Path, form: str, version: int) -> tuple[dict[str, str], dict[str, Tensor]]:
    """Header and tensors of a safetensors file of ours.

    Raises:
        CheckpointError: missing, damaged, or of another program or version.
    """
    if not path.is_file():
        raise CheckpointError(f"there is no {path}", f"a {form} file")
    try:
        with safe_open(path, "pt") as file:
            header = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, RuntimeError) as error:
        raise damaged(path, form, str(error)) from None
    found = f"{header.get('format', 'of no format')} {header.get('version', '')}".strip()
    if found != f"{form} {version}":
        raise CheckpointError(f"{path} is {found}", f"{form} {version}", "make it again with this version")
    return header, tensors


def damaged(path: Path, form: str, why: str) -> CheckpointError:
    """The error of a file that is not whole."""
    return CheckpointError(f"{path} is damaged ({why.partition(chr(10))[0]})", f"a whole {form} file")
