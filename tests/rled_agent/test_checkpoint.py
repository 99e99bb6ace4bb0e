"""Checkpoints of a run, and what learning has come to, packed for a file and unpacked again."""

import json
import pickle
import resource
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from rled_agent.learners.td3 import TD3Config
from rled_agent.methods.method import Learning, Problem
from rled_agent.methods.td3 import TD3
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.tensor_file import TensorFileError
from rled_agent.replay.n_step import NStepReplay
from rled_agent.replay.prioritised import PrioritisedReplay
from rled_agent.replay.transitions import Source, Step
from rled_agent.training.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from rled_agent.training.learning_state import (
    learning_state,
    pack,
    part_of,
    require_layout,
    restore_learning,
    restoring,
    seed_of,
    together,
)
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
        (None, "is of no format; accepted: rled-checkpoint 5"),
        ({"format": "rled-policy", "version": "1"}, "is rled-policy 1; accepted: rled-checkpoint 5"),
        ({"format": "rled-checkpoint", "version": "1"}, "is rled-checkpoint 1; accepted: rled-checkpoint 5"),
        ({"format": "rled-checkpoint", "version": "5"}, "damaged"),
        ({"format": "rled-checkpoint", "version": "5", "state": "{"}, "damaged"),
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


# What learning has come to, packed for a file and unpacked again.


TINY = Architecture(hidden=(6,))
CONFIG = TD3Config(actor=TINY, critic=TINY)


def empty(*seeds: int, observation: int = 4, capacity: int = 20, config: TD3Config = CONFIG) -> Learning:
    return TD3(learner=config).learning(Problem(observation, 2, capacity, Draws(seeds or (0,))))


def prioritised(*seeds: int) -> Learning:
    """Learning over three steps, from transitions drawn by their errors."""
    plain = empty(*seeds)
    replay = NStepReplay(3, PrioritisedReplay(plain.replay))
    return plain._replace(replay=replay, batches=replay)


def step(drawing: np.random.Generator, is_last: bool, seeds: int) -> Step:
    state, action, following = (torch.from_numpy(drawing.normal(size=(seeds, size))).float() for size in (4, 2, 4))
    reward, discount, source = (torch.full((seeds,), value) for value in (1.0, 0.9, float(Source.AGENT)))
    return Step(state, action, reward, discount, following, source, torch.full((seeds,), is_last))


def learn(learning: Learning, seed: int = 0, steps: int = 30, updates: int = 3) -> Learning:
    drawing = np.random.default_rng(seed)
    for k in range(steps):
        learning.replay.add(step(drawing, k % 8 == 7, learning.learner.draws.population))
    for _ in range(updates):
        batch = learning.batches.sample(8)
        learning.batches.update_priorities(batch.indices, learning.learner.update(batch).td_error)
    return learning


@pytest.mark.parametrize("make", [empty, prioritised])
def test_learning_goes_on_from_a_file_bit_for_bit(make, tmp_path):
    one, other = learn(make()), learn(make(), seed=1, steps=5)
    write_checkpoint(tmp_path / "c.safetensors", pack(**learning_state(one)))
    restore_learning(read_checkpoint(tmp_path / "c.safetensors"), other)
    other.learner.draws.taken = one.learner.draws.taken
    for each in (one, other):
        learn(each, seed=2, steps=6)
    assert one.learner.updates == other.learner.updates == 6
    left, right = (pack(**learning_state(each)) for each in (one, other))
    assert left.state == right.state
    assert all(torch.equal(left.tensors[name], right.tensors[name]) for name in left.tensors)


@pytest.mark.parametrize(
    "other",
    [{"config": replace(CONFIG, critics=1)}, {"observation": 5}, {"capacity": 10}],
    ids=["critics", "observation", "capacity"],
)
def test_state_of_other_networks_or_of_more_transitions_is_refused(other):
    learning = empty(**other)
    before = learning.learner.actor.vector()
    with (
        pytest.raises(TensorFileError, match=r"^it: (it holds|a replay of shape) .*; begin again without it"),
        restoring("it"),
    ):
        restore_learning(pack(**learning_state(learn(empty()))), learning)
    assert (learning.learner.actor.vector() == before).all()


@pytest.mark.parametrize("name", ["learner.critic_adam.weights.0.exp_avg", "replay.rows"])
def test_state_that_lacks_a_tensor_is_refused_by_its_name(name):
    tensors, state = pack(**learning_state(learn(empty())))
    del tensors[name]
    short = name.removeprefix("learner.").removeprefix("replay.")
    with pytest.raises(TensorFileError, match=f"it.*{short}"), restoring("it"):
        restore_learning(Checkpoint(tensors, state), empty())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("replay.added", value) for value in (-1, 1.5, "three", None)),
        *(("learner.updates", value) for value in (2**70, True)),
    ],
)
def test_a_state_whose_counts_are_none_is_refused(name, value):
    tensors, state = pack(**learning_state(empty()))
    said = f"says .* as {name.split('.')[1]}; accepted: a whole number, 0 or more"
    with pytest.raises(TensorFileError, match=said), restoring("it"):
        restore_learning(Checkpoint(tensors, state | {name: value}), empty())


@pytest.mark.parametrize("name", ["replay.rows", "learner.actor.weights.0"])
@pytest.mark.parametrize("tensor", [torch.zeros(0), torch.zeros(3, dtype=torch.uint8), torch.zeros(2, 2, 2)])
def test_a_state_with_a_tensor_of_another_kind_is_refused(name, tensor):
    tensors, state = pack(**learning_state(empty()))
    with pytest.raises(TensorFileError), restoring("it"):
        restore_learning(Checkpoint(tensors | {name: tensor}, state), empty())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("replay.priorities", torch.zeros(0)),
        ("replay.priorities", torch.full((1, 20), -1.0, dtype=torch.float64)),
        ("replay.greatest", "much"),
        ("replay.greatest", None),
        ("replay.greatest", torch.zeros(1, dtype=torch.float64)),
        ("replay.greatest", torch.ones(2, dtype=torch.float64)),
        ("replay.priorities", torch.zeros(1, 20, dtype=torch.float64)),
        ("replay.waiting.source", torch.zeros(1, 1)),
        ("replay.waiting.source", torch.zeros(2)),
        ("replay.waiting.observation", torch.zeros(1, 2, 7)),
        ("replay.waiting.observation", torch.zeros(1, 3, 4)),
    ],
)
def test_priorities_and_windows_that_cannot_be_are_refused(name, value):
    checkpoint = pack(**learning_state(learn(prioritised())))
    assert name in checkpoint.tensors
    if torch.is_tensor(value):
        checkpoint.tensors[name] = value
    else:
        checkpoint.state[name] = checkpoint.tensors.pop(name) and value
    with pytest.raises(TensorFileError), restoring("it"):
        restore_learning(checkpoint, prioritised())


def test_parts_are_told_apart_by_their_names():
    checkpoint = pack(one={"a": torch.ones(1), "b.c": 3}, other={"a": 4})
    assert (set(checkpoint.tensors), checkpoint.state) == ({"one.a"}, {"one.b.c": 3, "other.a": 4})
    assert part_of(checkpoint, "one") == {"a": torch.ones(1), "b.c": 3}
    assert part_of(checkpoint, "other") == {"a": 4}
    with pytest.raises(KeyError, match="on"):
        part_of(checkpoint, "on")


@pytest.mark.parametrize("make", [empty, prioritised])
def test_the_state_of_a_population_is_that_of_its_seeds(make):
    whole = pack(**learning_state(learn(make(3, 1, 2))))
    parts = [seed_of(whole, k, 3) for k in range(3)]
    again = together(parts)
    assert again.state == whole.state == parts[0].state
    assert again.tensors.keys() == whole.tensors.keys()
    for name, tensor in whole.tensors.items():
        assert torch.equal(again.tensors[name], tensor), name
        assert parts[0].tensors[name].shape[0] * 3 == tensor.shape[0], name
    one = pack(**learning_state(learn(make(3))))
    assert {name: each.shape for name, each in parts[0].tensors.items()} == {
        name: each.shape for name, each in one.tensors.items()
    }


def test_checkpoints_of_several_steps_are_no_population():
    parts = [Checkpoint({"a.b": torch.ones(1)}, {"run.step": step, "run.drawn": 5}) for step in (10, 10, 20)]
    assert together(parts[:2]).state == {"run.step": 10, "run.drawn": 5}
    parts += [Checkpoint(parts[0].tensors, state) for state in ({"run.drawn": 5}, {"run.step": 10})]
    for other, name in ((2, "step"), (3, "step"), (4, "drawn")):
        with pytest.raises(TensorFileError, match=rf"the checkpoints differ in run\.{name}; accepted: those of one"):
            together([parts[0], parts[other]])
    with pytest.raises(TensorFileError, match=r"differ in run\.drawn"):
        together([parts[4], parts[0]])


@pytest.mark.parametrize("state", [{}, {"a": torch.ones(2)}, {"a": 3}, {"a": torch.ones(3), "b": torch.ones(3)}])
def test_a_state_of_other_tensors_is_refused_by_names_and_shapes(state):
    require_layout({"a": torch.zeros(3)}, {"a": torch.ones(3)}, "it")
    with pytest.raises(TensorFileError, match=r"the checkpoint has \{.*\} as it; accepted: \{'a': \(3,\)\}"):
        require_layout(state, {"a": torch.ones(3)}, "it")
