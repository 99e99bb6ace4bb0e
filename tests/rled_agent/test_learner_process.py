"""Learning in a process of its own: the slot for weights, the state it keeps, the process."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from rled_agent.deploy.learner_client import LearnerClient
from rled_agent.deploy.learner_process import LearnerProcess, Options
from rled_agent.deploy.online_learning import OnlineLearning
from rled_agent.deploy.shared_parameters import SharedParameters
from rled_agent.learners.td3 import Learner, LearnerConfig
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.policy import load_policy
from rled_agent.nn.tensor_file import TensorFileError
from rled_agent.replay.uniform import Replay
from rled_agent.training.checkpoint import Checkpoint, read_checkpoint
from rled_agent.training.config import Schedule, TrainConfig
from rled_agent.training.learning_state import pack, unpack
from rled_agent.training.run_directory import RunDirectory
from rled_msgs_py.errors import RledError

PATIENCE = 60.0
TINY = Architecture(hidden=(6,))
CONFIG = LearnerConfig(actor=TINY, critic=TINY)


def await_that(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)


@pytest.fixture
def slots() -> Iterator[tuple[SharedParameters, SharedParameters]]:
    owner = SharedParameters(5)
    joined = SharedParameters(5, owner.name)
    yield owner, joined
    joined.close()
    owner.close()


def test_weights_are_handed_over_once(slots):
    taker, giver = slots
    held = np.zeros(5, dtype=np.float32)
    assert not taker.take(held)
    giver.put(np.arange(5, dtype=np.float32))
    assert taker.take(held)
    assert held.tolist() == [0, 1, 2, 3, 4]
    assert not taker.take(held)
    giver.put(held + 1)
    giver.put(held + 2)
    assert taker.take(held)
    assert held.tolist() == [2, 3, 4, 5, 6]
    assert not taker.take(held)


def test_a_write_in_progress_is_not_taken(slots):
    taker, giver = slots
    held = np.zeros(5, dtype=np.float32)
    giver.put(held)
    giver._versions[0] += 1  # what put does first
    assert not taker.take(held)
    giver._versions[1] = giver._versions[0]
    assert taker.take(held)


def test_a_slot_that_is_too_small_is_refused(slots):
    with pytest.raises(RledError, match="too small"):
        SharedParameters(5000, slots[0].name)


def test_a_transition_that_is_not_finite_is_not_offered(planar_expert, tmp_path):
    apprentice = LearnerClient(load_policy(planar_expert).network, planar_expert, tmp_path / "state.safetensors")
    try:
        apprentice.offer(np.array([0.0, np.inf], dtype=np.float32))
        assert (apprentice.offered, apprentice.dropped) == (1, 1)
    finally:
        apprentice.close(0.0)


def learned(seed: int = 0, rows: int = 30) -> tuple[Learner, Replay]:
    learner, replay = Learner(4, 2, CONFIG, torch.Generator().manual_seed(seed)), Replay(4, 2, 20)
    drawing = np.random.default_rng(seed)
    for _ in range(rows):
        state, action, following = (drawing.normal(size=size).astype(np.float32) for size in (4, 2, 4))
        replay.add(state, action, 1.0, False, following)
    for _ in range(3):
        learner.update(replay.sample(8, learner.generator))
    return learner, replay


def test_state_is_unpacked_as_it_was_packed():
    one, other = learned(0), learned(1, rows=3)
    checkpoint = pack(*one)
    unpack(Checkpoint({name: each.clone() for name, each in checkpoint.tensors.items()}, checkpoint.state), *other)
    for learner, replay in (one, other):
        for _ in range(3):
            learner.update(replay.sample(8, learner.generator))
        replay.add(*(np.ones(size, dtype=np.float32) for size in (4, 2)), 0.0, True, np.ones(4, dtype=np.float32))
    assert one[0].updates == other[0].updates == 6
    tensors = [pack(*each).tensors for each in (one, other)]
    assert all(torch.equal(tensors[0][name], tensors[1][name]) for name in tensors[0])


@pytest.mark.parametrize(
    "other",
    [
        lambda: (Learner(4, 2, replace(CONFIG, critics=1), torch.Generator()), Replay(4, 2, 20)),
        lambda: (Learner(5, 2, CONFIG, torch.Generator()), Replay(5, 2, 20)),
        lambda: (Learner(4, 2, CONFIG, torch.Generator()), Replay(4, 2, 10)),
    ],
)
def test_state_of_other_networks_or_of_more_transitions_is_refused_and_nothing_changed(other):
    learner, replay = other()
    before = learner.actor.vector()
    with pytest.raises(TensorFileError, match="the checkpoint holds"):
        unpack(pack(*learned()), learner, replay)
    assert (learner.actor.vector() == before).all()
    assert len(replay) == 0


def test_state_that_lacks_a_tensor_is_refused():
    tensors, state = pack(*learned())
    del tensors["critic_adam.weights.0.exp_avg"]
    with pytest.raises(TensorFileError, match=r"holds nothing as critic_adam.weights.0.exp_avg"):
        unpack(Checkpoint(tensors, state), *learned())


@pytest.mark.parametrize("settings", [{"layer_norm": True}, {"dropout": 0.2}, {"activation": "leaky_relu"}])
def test_the_student_begins_with_the_very_network_of_the_policy(make_policy, tmp_path, settings):
    make_policy(**settings).save(tmp_path / "policy")
    policy = load_policy(tmp_path / "policy")
    student = LearnerProcess(Options(tmp_path / "policy", "slot", tmp_path / "state"))
    for network in (student.learner.actor, student.learner.target_actor):
        assert network.architecture == policy.network.architecture
        assert (network.vector() == policy.network.vector()).all()


def transitions(count: int) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(count, 4 + 2 + 2 + 4)).astype(np.float32)


def marked(count: int, by_person: bool = False) -> np.ndarray:
    return np.column_stack([transitions(count), np.full(count, by_person, dtype=np.float32)])


def test_gradient_steps_are_owed_for_transitions(make_policy, tmp_path):
    make_policy().save(tmp_path / "policy")
    config = TrainConfig(schedule=Schedule(capacity=30))
    RunDirectory(tmp_path).create({"config": config.to_dict()})
    options = Options(tmp_path / "policy", "slot", tmp_path / "state", train_after=10, updates_per_step=0.5)
    student = LearnerProcess(options)
    for rows, owed in ((marked(10), 0), (marked(7), 4), (marked(1), 0), (marked(20), 10)):
        student.add(rows)
        begun = student.learner.updates
        while student.is_due():
            student.update()
        assert student.learner.updates - begun == owed
    assert len(student.replay) == 30


def test_the_student_goes_on_from_the_run_of_the_policy(make_policy, tmp_path):
    policy, run = make_policy(), RunDirectory(tmp_path)
    policy.save(run.policy_path)
    settings = replace(CONFIG, gamma=0.5, actor=policy.network.architecture)
    run.create({"config": TrainConfig(learner=settings, schedule=Schedule(capacity=50)).to_dict()})
    learner, replay = Learner(4, 2, settings, torch.Generator().manual_seed(7)), Replay(4, 2, 50)
    replay.rows[:40], replay.added, learner.updates = transitions(40), 40, 33
    run.save(pack(learner, replay))

    student = LearnerProcess(Options(run.policy_path, "slot", tmp_path / "state"))
    assert student.learner.config == settings
    assert (student.learner.critic.vector() == learner.critic.vector()).all()
    assert (student.replay.added, student.learner.updates) == (40, 33)
    assert not student.is_due()
    student.add(marked(1))
    assert student.is_due()


def test_what_a_person_did_is_learned_from_at_once_and_kept(make_policy, tmp_path, monkeypatch):
    make_policy().save(tmp_path / "policy")
    options = Options(tmp_path / "policy", "slot", tmp_path / "state", train_after=0, person_share=0.25)
    student, batches = LearnerProcess(options), []
    update = student.learner.update
    monkeypatch.setattr(student.learner, "update", lambda batch: (batches.append(batch), update(batch)))
    student.add(marked(40))
    student.update()
    student.add(by_person := marked(3, by_person=True))
    student.update()
    assert [batch.demonstrated for batch in batches] == [0, len(batches[0]) // 4]
    assert len(batches[0]) == len(batches[1])
    drawn = batches[1].rows[-batches[1].demonstrated :].numpy()
    assert {row.tobytes() for row in drawn} <= {row.tobytes() for row in by_person[:, :-1]}
    student.save()
    again = LearnerProcess(options)
    assert (again.replay.added, len(again.by_person)) == (43, 3)
    np.testing.assert_array_equal(again.by_person.rows[:3], by_person[:, :-1])


@pytest.fixture
def apprentice(make_policy, tmp_path: Path) -> Iterator[LearnerClient]:
    policy = make_policy(dropout=0.2, layer_norm=True)
    policy.save(tmp_path / "policy.safetensors")
    apprentice = LearnerClient(policy.network, tmp_path / "policy.safetensors", tmp_path / "state.safetensors", "low")
    yield apprentice
    if apprentice.running:
        apprentice.close(PATIENCE)


def test_the_apprentice_learns_hands_weights_over_and_keeps_its_state(apprentice, tmp_path):
    before = apprentice._actor.vector()
    apprentice.save()  # it may not even have begun to listen

    def handed_over() -> bool:
        for row in transitions(10):
            apprentice.offer(row)
        apprentice.renew()
        assert apprentice.running
        return apprentice.handovers > 1

    await_that(handed_over)
    assert not (apprentice._actor.vector() == before).all()
    state = tmp_path / "state.safetensors"
    apprentice.save()
    await_that(state.exists)
    apprentice.close(PATIENCE)
    checkpoint = read_checkpoint(state)
    assert 500 < checkpoint.state["added"] <= apprentice.offered - apprentice.dropped
    assert 0 < checkpoint.state["updates"] <= checkpoint.state["added"] - 500


@pytest.mark.parametrize(("priority", "policy", "niceness"), [("idle", os.SCHED_IDLE, 0), ("low", os.SCHED_OTHER, 10)])
def test_learning_lets_control_go_first(planar_expert, tmp_path, priority, policy, niceness):
    network = load_policy(planar_expert).network
    apprentice = LearnerClient(network, planar_expert, tmp_path / "state.safetensors", priority)
    try:
        process = apprentice._process.pid
        assert os.sched_getscheduler(process) == policy
        assert os.getpriority(os.PRIO_PROCESS, process) == min(os.nice(0) + niceness, 19)
    finally:
        apprentice.close(0.0)


def test_a_dead_apprentice_costs_transitions_and_nothing_else(apprentice):
    os.kill(apprentice._process.pid, signal.SIGKILL)
    await_that(lambda: not apprentice.running)
    apprentice.offer(transitions(1)[0])
    apprentice.renew()
    apprentice.save()
    assert (apprentice.offered, apprentice.dropped) == (1, 1)
    apprentice.close(PATIENCE)


def test_learning_does_not_go_on_with_what_another_policy_has_learned(make_policy, tmp_path):
    state, began, copied, other = (tmp_path / name for name in ("state", "began", "copied", "other"))
    make_policy(0, dropout=0.1).save(began)
    make_policy(0, dropout=0.1).save(copied)
    make_policy(1, dropout=0.1).save(other)
    LearnerProcess(Options(began, "slot", state)).save()
    LearnerProcess(Options(copied, "slot", state))
    said = f"holds what another policy than {other} has learned; accepted: .*; go on with --agent {began}, or name"
    with pytest.raises(TensorFileError, match=said):
        LearnerProcess(Options(other, "slot", state))
    with pytest.raises(TensorFileError, match=said):
        OnlineLearning(load_policy(other), str(other), str(state), "low").start()


def test_learning_does_not_begin_where_its_state_cannot_be_kept(make_policy, tmp_path):
    (tmp_path / "file").touch()
    make_policy().save(tmp_path / "policy")
    learning = OnlineLearning(
        load_policy(tmp_path / "policy"), str(tmp_path / "policy"), str(tmp_path / "file" / "state"), "low"
    )
    with pytest.raises(RledError, match=f"{tmp_path / 'file'} is no folder; .*name another --learning-state"):
        learning.start()


@pytest.mark.parametrize(
    ("part", "value"),
    [("added", -1), ("added", 1.5), ("added", "three"), ("added", None), ("updates", 2**70), ("updates", True)],
)
def test_a_state_whose_counts_are_none_is_refused(part, value):
    learner, replay = Learner(3, 2, CONFIG, torch.Generator()), Replay(3, 2, 20)
    tensors, state = pack(learner, replay)
    with pytest.raises(TensorFileError, match=f"says .* as {part}; accepted: a whole number, 0 or more"):
        unpack(Checkpoint(tensors, state | {part: value}), learner, replay)


@pytest.mark.parametrize("name", ["replay.rows", "generator"])
@pytest.mark.parametrize("tensor", [torch.zeros(0), torch.zeros(3, dtype=torch.uint8), torch.zeros(2, 2, 2)])
def test_a_state_with_a_tensor_of_another_kind_is_refused(name, tensor):
    learner, replay = Learner(3, 2, CONFIG, torch.Generator()), Replay(3, 2, 20)
    tensors, state = pack(learner, replay)
    with pytest.raises(TensorFileError):
        unpack(Checkpoint(tensors | {name: tensor}, state), learner, replay)
