"""Safetensors files of ours: named tensors behind a header of texts, read with care from wherever; no pickle."""

import errno
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import torch
from rled_msgs_py.errors import RledError
from rled_msgs_py.files import whole_file
from rled_msgs_py.untrusted import MAX_TEXT
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor


class TensorFileError(RledError):
    """A file of tensors that can't be written or read."""


def write_tensors(path: Path, tensors: dict[str, Tensor], header: dict[str, str]) -> None:
    """Write a safetensors file whole.

    Raises:
        TensorFileError: the disk is full or can't be written.
    """
    try:
        with whole_file(path) as temporary:
            save_file({name: each.contiguous() for name, each in tensors.items()}, temporary, header)
            _sort_header(temporary)
    except (OSError, SafetensorError) as error:
        full = isinstance(error, SafetensorError) or error.errno in (errno.ENOSPC, errno.EDQUOT)
        remedy = "free disk space; what stood there stays" if full else "write somewhere else"
        raise TensorFileError(f"can't write {path} ({error})", "", remedy) from None


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


class Layout(NamedTuple):
    """What a tensor has to be.

    Attributes:
        shape: its sizes.
        kind: its numbers, as safetensors names them.
    """

    shape: tuple[int, ...]
    kind: str = "F32"


class TensorFile(NamedTuple):
    """An open safetensors file of ours, of which only the header was read.

    Attributes:
        path: where it lies.
        header: texts by name.
        file: as the library has it; it has checked that the tensors fill the file.
    """

    path: Path
    header: dict[str, str]
    file: Any

    def read(self, layouts: Mapping[str, Layout] | None = None) -> dict[str, Tensor]:
        """All tensors by name.

        Args:
            layouts: of all tensors that there have to be, looked at before any is read; any by default.

        Raises:
            TensorFileError: other tensors, or a number that is not finite.
        """
        names = list(self.file.keys())
        if layouts is not None:
            for name, layout in layouts.items():
                self._require(name, name in names, layout)
            if unknown := sorted(set(names) - set(layouts)):
                raise TensorFileError(f"{self.path} holds {unknown[0][:80]}", ", ".join(layouts), "use another file")
        return {name: self._finite(name) for name in names}

    def _require(self, name: str, is_there: bool, layout: Layout) -> None:
        found = None
        if is_there:
            part = self.file.get_slice(name)
            found = Layout(tuple(part.get_shape()), part.get_dtype())
        if found != layout:
            shown = f"{found.shape} {found.kind}" if found else "nothing"
            what, accepted = f"{self.path} holds {shown} as {name}", f"{layout.shape} {layout.kind}"
            raise TensorFileError(what, accepted, "use weights of this robot and task")

    def _finite(self, name: str) -> Tensor:
        tensor: Tensor = self.file.get_tensor(name)
        if tensor.is_floating_point() and not torch.isfinite(tensor).all():
            raise TensorFileError(f"{self.path} holds NaN or infinity in {name}", "finite numbers", "make it again")
        return tensor


@contextmanager
def open_tensors(path: Path, form: str, version: int) -> Iterator[TensorFile]:
    """Open a safetensors file of ours; nothing of it is in memory but its header, which is small.

    Raises:
        TensorFileError: missing, damaged, or of another program or version.
    """
    if not path.is_file():
        raise TensorFileError(f"there is no {path}", f"a {form} file")
    try:
        _require_small_header(path, form)
        with safe_open(path, "pt") as file:
            header = file.metadata() or {}
            found = f"{header.get('format', 'of no format')} {header.get('version', '')}".strip()[:80]
            if found != f"{form} {version}":
                raise TensorFileError(f"{path} is {found}", f"{form} {version}", "make it again with this version")
            yield TensorFile(path, header, file)
    except (SafetensorError, OSError, RuntimeError) as error:
        raise damaged(path, form, str(error)) from None


def _require_small_header(path: Path, form: str) -> None:
    with path.open("rb") as file:
        size = int.from_bytes(file.read(8), "little")
    if size > min(MAX_TEXT, path.stat().st_size):
        raise damaged(path, form, f"its header would have {size:,} bytes")


def damaged(path: Path, form: str, why: str) -> TensorFileError:
    """The error of a file that is not whole."""
    return TensorFileError(f"{path} is damaged ({why.partition(chr(10))[0][:300]})", f"a whole {form} file")
