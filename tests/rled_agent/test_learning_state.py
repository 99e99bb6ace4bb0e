"""What learning has come to, packed for a file and unpacked again."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from rled_agent.learners.td3 import TD3Config
from rled_agent.methods.method import Learning, Problem
from rled_agent.methods.td3 import TD3
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.tensor_file import TensorFileError
from rled_agent.replay.n_step import NStepReplay
from rled_agent.replay.prioritised import PrioritisedReplay
from rled_agent.replay.transitions import Step
from rled_agent.training.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from rled_agent.training.learning_state import learning_state, pack, part_of, restore_learning, restoring

TINY = Architecture(hidden=(6,))
CONFIG = TD3Config(actor=TINY, critic=TINY)


def empty(seed: int = 0, observation: int = 4, capacity: int = 20, config: TD3Config = CONFIG) -> Learning:
    generators = np.random.default_rng(seed), torch.Generator().manual_seed(seed)
    return TD3(learner=config).learning(Problem(observation, 2, capacity, *generators))


def prioritised(seed: int = 0) -> Learning:
    """Learning over three steps, from transitions drawn by their errors."""
    plain = empty(seed)
    replay = NStepReplay(3, PrioritisedReplay(plain.replay))
    return plain._replace(replay=replay, batches=replay)


def step(drawing: np.random.Generator, is_last: bool) -> Step:
    state, action, following = (drawing.normal(size=size).astype(np.float32) for size in (4, 2, 4))
    return Step(state, action, 1.0, 0.9, following, is_last=is_last)


def learn(learning: Learning, seed: int = 0, steps: int = 30, updates: int = 3) -> Learning:
    drawing = np.random.default_rng(seed)
    for k in range(steps):
        learning.replay.add(step(drawing, k % 8 == 7))
    for _ in range(updates):
        batch = learning.batches.sample(8)
        learning.batches.update_priorities(batch.indices, learning.learner.update(batch).td_error)
    return learning


@pytest.mark.parametrize("make", [empty, prioritised])
def test_learning_goes_on_from_a_file_bit_for_bit(make, tmp_path):
    one, other = learn(make(0)), learn(make(1), seed=1, steps=5)
    write_checkpoint(tmp_path / "c.safetensors", pack(**learning_state(one)))
    restore_learning(read_checkpoint(tmp_path / "c.safetensors"), other)
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


@pytest.mark.parametrize("name", ["learner.critic_adam.weights.0.exp_avg", "replay.rows", "generator.state"])
def test_state_that_lacks_a_tensor_is_refused_by_its_name(name):
    tensors, state = pack(**learning_state(learn(empty())))
    del tensors[name]
    short = name.removeprefix("learner.").removeprefix("replay.").removesuffix(".state")
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


@pytest.mark.parametrize("name", ["replay.rows", "generator.state"])
@pytest.mark.parametrize("tensor", [torch.zeros(0), torch.zeros(3, dtype=torch.uint8), torch.zeros(2, 2, 2)])
def test_a_state_with_a_tensor_of_another_kind_is_refused(name, tensor):
    tensors, state = pack(**learning_state(empty()))
    with pytest.raises(TensorFileError), restoring("it"):
        restore_learning(Checkpoint(tensors | {name: tensor}, state), empty())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("replay.priorities", torch.zeros(0)),
        ("replay.priorities", torch.full((20,), -1.0, dtype=torch.float64)),
        ("replay.greatest", "much"),
        ("replay.greatest", None),
        ("replay.greatest", 0.0),
        ("replay.priorities", torch.zeros(20, dtype=torch.float64)),
        ("replay.waiting.source", torch.tensor([0.0])),
        ("replay.waiting.source", torch.full((2,), 9.0)),
        ("replay.waiting.observation", torch.zeros(2, 7)),
    ],
)
def test_priorities_and_windows_that_cannot_be_are_refused(name, value):
    checkpoint = pack(**learning_state(learn(prioritised())))
    where = checkpoint.tensors if torch.is_tensor(value) else checkpoint.state
    assert name in {**checkpoint.tensors, **checkpoint.state}
    where[name] = value
    with pytest.raises(TensorFileError), restoring("it"):
        restore_learning(checkpoint, prioritised())


def test_parts_are_told_apart_by_their_names():
    checkpoint = pack(one={"a": torch.ones(1), "b.c": 3}, other={"a": 4})
    assert (set(checkpoint.tensors), checkpoint.state) == ({"one.a"}, {"one.b.c": 3, "other.a": 4})
    assert part_of(checkpoint, "one") == {"a": torch.ones(1), "b.c": 3}
    assert part_of(checkpoint, "other") == {"a": 4}
    with pytest.raises(KeyError, match="on"):
        part_of(checkpoint, "on")
