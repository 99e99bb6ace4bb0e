import json
import pickle
import resource
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import torch
from rled_agent.nn.tensor_file import TensorFileError
from rled_agent.training.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from safetensors.torch import save_file

TENSORS = {
    "weights": torch.arange(6.0).view(2, 3),
    "steps": torch.tensor(3.0),
    "state": torch.Generator().get_state(),
    "nothing": torch.zeros(0, 2),
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "run" / "checkpoint.safetensors"
    write_checkpoint(path, Checkpoint(TENSORS, {"step": 7}))
    return path


def test_what_is_written_is_read(tmp_path):
    state = {"step": 7, "generator": np.random.default_rng(0).bit_generator.state, "share": 0.1, "flag": True}
    write_checkpoint(tmp_path / "c.safetensors", Checkpoint(TENSORS, state))
    tensors, read = read_checkpoint(tmp_path / "c.safetensors")
    assert read == state
    assert tensors.keys() == TENSORS.keys()
    for name, tensor in TENSORS.items():
        assert tensors[name].dtype == tensor.dtype
        assert torch.equal(tensors[name], tensor)


def test_parts_of_larger_tensors_are_written_alone(tmp_path):
    write_checkpoint(tmp_path / "c.safetensors", Checkpoint({"part": torch.zeros(1000, 10)[:3, ::2]}, {}))
    assert (tmp_path / "c.safetensors").stat().st_size < 500
    assert read_checkpoint(tmp_path / "c.safetensors").tensors["part"].shape == (3, 5)


def test_a_missing_checkpoint_is_refused(tmp_path):
    with pytest.raises(TensorFileError, match=r"there is no .*gone; accepted: a rled-checkpoint file"):
        read_checkpoint(tmp_path / "gone")
    with pytest.raises(TensorFileError, match="there is no"):
        read_checkpoint(tmp_path)


def test_a_truncated_checkpoint_is_refused_wherever_it_is_cut(path):
    whole = path.read_bytes()
    for length in (0, 1, 8, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(TensorFileError, match="damaged") as caught:
            read_checkpoint(path)
        assert "\n" not in str(caught.value)


def test_a_checkpoint_with_a_changed_header_is_refused(path):
    whole = path.read_bytes()
    path.write_bytes(whole[:20] + b"\xff" + whole[21:])
    with pytest.raises(TensorFileError, match="damaged"):
        read_checkpoint(path)


@pytest.mark.parametrize(
    ("header", "what"),
    [
        (None, "is of no format; accepted: rled-checkpoint 4"),
        ({"format": "rled-policy", "version": "1"}, "is rled-policy 1; accepted: rled-checkpoint 4"),
        ({"format": "rled-checkpoint", "version": "1"}, "is rled-checkpoint 1; accepted: rled-checkpoint 4"),
        ({"format": "rled-checkpoint", "version": "4"}, "damaged"),
        ({"format": "rled-checkpoint", "version": "4", "state": "{"}, "damaged"),
    ],
)
def test_other_headers_are_refused(tmp_path, header, what):
    save_file(TENSORS, tmp_path / "c.safetensors", header)
    with pytest.raises(TensorFileError, match=what):
        read_checkpoint(tmp_path / "c.safetensors")


class Trap:
    """Says so when it is unpickled."""

    def __reduce__(self):
        return Path.touch, (Path("unpickled"),)


@pytest.mark.parametrize(
    "write", [lambda path: path.write_bytes(pickle.dumps(Trap())), lambda p: torch.save(Trap(), p)]
)
def test_a_pickle_is_refused_and_not_executed(tmp_path, monkeypatch, write):
    monkeypatch.chdir(tmp_path)
    write(Path("c.safetensors"))
    with pytest.raises(TensorFileError, match="damaged"):
        read_checkpoint(Path("c.safetensors"))
    assert not Path("unpickled").exists()


FILL = """
    import sys, torch
    from pathlib import Path
    from rled_agent.training.checkpoint import Checkpoint, write_checkpoint
    from rled_msgs_py.errors import command_line
    write = lambda: write_checkpoint(Path(sys.argv[1]), Checkpoint({"new": torch.ones(100_000)}, {"step": 8}))
    command_line(write)()
"""


def test_the_last_good_checkpoint_stays_when_the_next_does_not_fit(path):
    """The file size limit of a process stands for a full disk: writing fails half-way."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))

    before = path.read_bytes()
    command = [sys.executable, "-c", textwrap.dedent(FILL), str(path)]
    done = subprocess.run(command, capture_output=True, text=True, preexec_fn=limit)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith(f"error: can't write {path}")
    assert "what stood there stays" in done.stderr
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]
    write_checkpoint(path, Checkpoint({"new": torch.ones(100_000)}, {"step": 8}))
    assert read_checkpoint(path).state == {"step": 8}


def test_state_is_plain_json(path):
    from safetensors import safe_open

    with safe_open(path, "pt") as file:
        assert json.loads(file.metadata()["state"]) == {"step": 7}
