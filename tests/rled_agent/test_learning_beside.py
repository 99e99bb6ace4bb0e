"""Learning beside control, in a process of its own for which nobody waits."""

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
from rled_agent.deploy.step_pipe import RobotStep, from_row, row_width, to_row
from rled_agent.learners.td3 import TD3Config
from rled_agent.methods import Problem
from rled_agent.methods.td3 import TD3
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.policy import load_policy
from rled_agent.nn.tensor_file import TensorFileError
from rled_agent.replay.transitions import Source, Step
from rled_agent.training.checkpoint import read_checkpoint, write_checkpoint
from rled_agent.training.config import Schedule, TrainConfig
from rled_agent.training.learning_state import learning_state, pack
from rled_agent.training.run_directory import RunDirectory
from rled_msgs_py.errors import RledError

PATIENCE = 60.0


def await_that(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)


def numbered(number: int, observation: float = 0.5) -> RobotStep:
    state = np.full(4, observation, dtype=np.float32)
    return RobotStep(state, np.zeros(2, np.float32), -1.0, 1.0, state, Source.AGENT, False, number)


def test_a_step_that_is_not_finite_is_not_offered(planar_expert, tmp_path):
    client = LearnerClient(load_policy(planar_expert).network, planar_expert, tmp_path / "state.safetensors")
    try:
        client.offer(numbered(0, np.inf))
        assert (client.offered, client.dropped) == (1, 1)
    finally:
        client.close(0.0)


@pytest.fixture
def client(make_policy, tmp_path: Path) -> Iterator[LearnerClient]:
    policy = make_policy(dropout=0.2, layer_norm=True)
    policy.save(tmp_path / "policy.safetensors")
    client = LearnerClient(policy.network, tmp_path / "policy.safetensors", tmp_path / "state.safetensors", "low")
    yield client
    if client.running:
        client.close(PATIENCE)


def test_the_process_learns_hands_weights_over_and_keeps_its_state(client, tmp_path):
    before = client._actor.vector()
    client.save()  # it may not even have begun to listen

    def handed_over() -> bool:
        for _ in range(10):
            client.offer(numbered(client.offered))
        client.refresh()
        assert client.running
        return client.handovers > 1

    await_that(handed_over)
    assert not (client._actor.vector() == before).all()
    state = tmp_path / "state.safetensors"
    client.save()
    await_that(state.exists)
    client.close(PATIENCE)
    found = read_checkpoint(state).state
    assert 500 < found["replay.added"] <= client.offered - client.dropped
    assert 0 < found["learner.updates"] <= found["replay.added"] - 500


@pytest.mark.parametrize(("priority", "policy", "niceness"), [("idle", os.SCHED_IDLE, 0), ("low", os.SCHED_OTHER, 10)])
def test_learning_lets_control_go_first(planar_expert, tmp_path, priority, policy, niceness):
    network = load_policy(planar_expert).network
    client = LearnerClient(network, planar_expert, tmp_path / "state.safetensors", priority)
    try:
        process = client._process.pid
        assert os.sched_getscheduler(process) == policy
        assert os.getpriority(os.PRIO_PROCESS, process) == min(os.nice(0) + niceness, 19)
    finally:
        client.close(0.0)


def test_a_dead_process_costs_steps_and_nothing_else(client):
    os.kill(client._process.pid, signal.SIGKILL)
    await_that(lambda: not client.running)
    client.offer(numbered(0))
    client.refresh()
    client.save()
    assert (client.offered, client.dropped) == (1, 1)
    client.close(PATIENCE)


# What the learner process begins with, learns from and keeps.


TINY = Architecture(hidden=(6,))
CONFIG = TD3Config(actor=TINY, critic=TINY)


@pytest.mark.parametrize("settings", [{"layer_norm": True}, {"dropout": 0.2}, {"activation": "leaky_relu"}])
def test_it_begins_with_the_very_network_of_the_policy(make_policy, tmp_path, settings):
    make_policy(**settings).save(tmp_path / "policy")
    policy = load_policy(tmp_path / "policy")
    process = LearnerProcess(Options(tmp_path / "policy", "slot", tmp_path / "state"))
    for network in (process.learner.actor, process.learner.target_actor):
        assert network.population == 1
        assert network.architecture == policy.network.architecture
        assert (network.vector() == policy.network.vector()).all()


def steps(count: int, seed: int = 0, first: int = 0, **parts: object) -> np.ndarray:
    """Rows of steps in one episode."""
    drawing, rows = np.random.default_rng(seed), []
    for k in range(count):
        state, action, following = (drawing.normal(size=size).astype(np.float32) for size in (4, 2, 4))
        whole = RobotStep(state, action, -1.0, 1.0, following, Source.AGENT, False, first + k)
        rows.append(to_row(whole._replace(**parts)))
    return np.array(rows)


def test_gradient_steps_are_owed_for_transitions(make_policy, tmp_path):
    make_policy().save(tmp_path / "policy")
    RunDirectory(tmp_path).create({"config": TrainConfig(TD3(), schedule=Schedule(capacity=30)).to_dict()})
    options = Options(tmp_path / "policy", "slot", tmp_path / "state", train_after=10, updates_per_step=0.5)
    process = LearnerProcess(options)
    for rows, owed in ((steps(10), 0), (steps(7), 4), (steps(1), 0), (steps(20), 10)):
        process.add(rows)
        begun = process.learner.updates
        while process.is_due():
            process.update()
        assert process.learner.updates - begun == owed
    assert len(process.learning.replay) == 30


def test_transitions_are_counted_with_the_methods_discount(make_policy, tmp_path):
    make_policy().save(tmp_path / "policy")
    RunDirectory(tmp_path).create({"config": TrainConfig(TD3(learner=TD3Config(gamma=0.5))).to_dict()})
    process = LearnerProcess(Options(tmp_path / "policy", "slot", tmp_path / "state"))
    process.add(np.concatenate([steps(1), steps(1, discount=0.0, is_last=True), steps(1, source=Source.EXPERT)]))
    kept = process.learning.replay.rows[0, :3].numpy()
    assert kept[:, 7].tolist() == [0.5, 0.0, 0.5]
    assert kept[:, -1].tolist() == [Source.AGENT, Source.AGENT, Source.EXPERT]
    np.testing.assert_array_equal(kept[0, :4], steps(1)[0, :4])
    np.testing.assert_array_equal(kept[0, 8:12], steps(1)[0, 6:10])


def test_it_goes_on_from_the_run_of_the_policy(make_policy, tmp_path):
    policy, run = make_policy(), RunDirectory(tmp_path)
    policy.save(run.policy_path)
    settings = replace(CONFIG, gamma=0.5, actor=policy.network.architecture)
    config = TrainConfig(TD3(learner=settings), schedule=Schedule(capacity=50))
    run.create({"config": config.to_dict()})
    learning = config.method.learning(Problem(4, 2, 50, Draws([7])))
    learning.replay.rows[:, :40], learning.replay.added, learning.learner.updates = 1.0, 40, 33
    run.save(pack(**learning_state(learning), run={"drawn": 12_345}))

    process = LearnerProcess(Options(run.policy_path, "slot", tmp_path / "state"))
    assert process.learner.config == settings
    assert (process.learner.critic.vector() == learning.learner.critic.vector()).all()
    assert (process.learning.replay.added, process.learner.updates) == (40, 33)
    assert process.learner.draws.taken == 12_345
    assert not process.is_due()
    process.add(steps(1))
    assert process.is_due()


def test_what_a_person_did_is_learned_from_at_once_and_kept(make_policy, tmp_path, monkeypatch):
    make_policy().save(tmp_path / "policy")
    options = Options(tmp_path / "policy", "slot", tmp_path / "state", train_after=0, person_share=0.25)
    process, batches = LearnerProcess(options), []
    update = process.learner.update

    def watched(batch):
        batches.append(batch)
        return update(batch)

    monkeypatch.setattr(process.learner, "update", watched)
    process.add(steps(40))
    process.update()
    process.add(by_person := steps(3, seed=1, first=40, source=Source.HUMAN))
    process.update()
    before, after = batches
    assert before.reward.shape == after.reward.shape == (1, 100, 1)
    assert not before.demonstrated.any()
    assert after.demonstrated[0, -25:].all()
    shown = {tuple(row[:4]) for row in by_person.tolist()}
    assert {tuple(row) for row in after.observation[0, -25:].tolist()} == shown
    process.save()
    again = LearnerProcess(options)
    assert (again.learning.replay.added, len(again.by_person)) == (43, 3)
    np.testing.assert_array_equal(again.by_person.rows, process.by_person.rows)


def test_a_process_that_begins_again_learns_as_one_that_went_on(make_policy, tmp_path):
    make_policy(dropout=0.1).save(tmp_path / "policy")
    options = Options(tmp_path / "policy", "slot", tmp_path / "state", train_after=10)
    process = LearnerProcess(options)
    process.add(np.concatenate([steps(20), steps(4, seed=1, first=20, source=Source.HUMAN)]))
    for _ in range(10):
        process.update()
    process.save()
    again = LearnerProcess(options)
    for each in (process, again):
        each.add(steps(3, seed=2, first=24))
        for _ in range(10):
            each.update()
    assert process.learner.updates == again.learner.updates == 20
    assert process.learner.draws.taken == again.learner.draws.taken > 0
    for name, network in process.learner.networks().items():
        assert (again.learner.networks()[name].vector() == network.vector()).all(), name


@pytest.mark.parametrize("part", ["run", "learner", "replay", "by_person"])
def test_a_state_that_lacks_a_part_is_told_of(make_policy, tmp_path, part):
    make_policy().save(tmp_path / "policy")
    options = Options(tmp_path / "policy", "slot", tmp_path / "state")
    LearnerProcess(options).save()
    write_checkpoint(options.checkpoint, read_checkpoint(options.checkpoint).without(part))
    with pytest.raises(
        TensorFileError, match=rf"state is not as it was written \(no '{part}'\); .*begin again without"
    ):
        LearnerProcess(options)


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


# Weights that pass from one process to the other through memory.


@pytest.fixture
def both() -> Iterator[tuple[SharedParameters, SharedParameters]]:
    owner = SharedParameters(5)
    joined = SharedParameters(5, owner.name)
    yield owner, joined
    joined.close()
    owner.close()


def test_weights_are_handed_over_once(both):
    taker, giver = both
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


def test_a_write_in_progress_is_not_taken(both):
    taker, giver = both
    held = np.zeros(5, dtype=np.float32)
    giver.put(held)
    giver._versions[0] += 1  # what put does first
    assert not taker.take(held)
    giver._versions[1] = giver._versions[0]
    assert taker.take(held)


def test_memory_that_is_too_small_is_refused(both):
    with pytest.raises(RledError, match="too small"):
        SharedParameters(5000, both[0].name)


# Steps as rows of numbers and back.


@pytest.mark.parametrize("source", Source)
def test_a_step_comes_back_from_its_row(source):
    parts = np.array([1, 2, 3], np.float32), np.array([4, 5], np.float32), np.array([6, 7, 8], np.float32)
    state, action, following = parts
    step = RobotStep(state, action, -2.5, float(source % 2), following, source, source == Source.HUMAN, 41)
    row = to_row(step)
    assert (row.dtype, len(row)) == (np.float32, row_width(3, 2))
    back, number = from_row(row, 3)
    assert number == 41
    assert [each.dtype for each in back] == [torch.float32] * 6 + [torch.bool]
    for name in Step._fields:
        (one,) = getattr(back, name).tolist()  # of a population of one
        assert np.array_equal(one, getattr(step, name)), name


def test_a_row_is_written_to_the_pipe_in_one_piece():
    """A pipe takes 4096 bytes whole or not at all: 508 of observation and action would still do."""
    assert 4 * row_width(10, 7) < 4096
    assert 4 * row_width(250, 250) < 4096
