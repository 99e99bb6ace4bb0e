"""Checkpoints: all state of a run, in a safetensors file whose header holds JSON."""

import json
from pathlib import Path
from typing import Any, NamedTuple

from rled_msgs_py.errors import ContractError
from rled_msgs_py.untrusted import read_json
from torch import Tensor

from rled_agent.nn.tensor_file import TensorFile, damaged, open_tensors, write_tensors

FORMAT = "rled-checkpoint"
VERSION = 5


class Checkpoint(NamedTuple):
    """State of a run.

    Attributes:
        tensors: arrays by dotted name.
        state: everything else, plain JSON values.
    """

    tensors: dict[str, Tensor]
    state: dict[str, Any]

    def joined(self, other: "Checkpoint") -> "Checkpoint":
        """Both as one."""
        return Checkpoint(self.tensors | other.tensors, self.state | other.state)

    def without(self, part: str) -> "Checkpoint":
        """All but one part."""
        tensors, state = (
            {name: each for name, each in values.items() if not name.startswith(f"{part}.")} for values in self
        )
        return Checkpoint(tensors, state)


def write_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint whole; what stood there before stays until the new one is complete.

    Raises:
        TensorFileError: the disk is full or can't be written.
    """
    header = {"format": FORMAT, "version": str(VERSION), "state": json.dumps(checkpoint.state)}
    write_tensors(path, checkpoint.tensors, header)


def read_checkpoint(path: Path) -> Checkpoint:
    """Read what ``write_checkpoint`` wrote.

    Raises:
        TensorFileError: missing, damaged, or of another program or version.
    """
    with open_tensors(path, FORMAT, VERSION) as file:
        return Checkpoint(file.read(), _state(file))


def read_state(path: Path) -> dict[str, Any]:
    """Everything but the tensors of a checkpoint.

    Raises:
        TensorFileError: as ``read_checkpoint``.
    """
    with open_tensors(path, FORMAT, VERSION) as file:
        return _state(file)


def _state(file: TensorFile) -> dict[str, Any]:
    try:
        state = read_json(file.header["state"], "its state")
    except (KeyError, ContractError) as error:
        raise damaged(file.path, FORMAT, f"header: {error}") from None
    if not isinstance(state, dict):
        raise damaged(file.path, FORMAT, "header: its state is no object")
    return state
