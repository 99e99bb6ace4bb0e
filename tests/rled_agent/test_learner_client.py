"""The control side of learning: a process of its own learns, and nobody waits for it."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from rled_agent.deploy.learner_client import LearnerClient
from rled_agent.deploy.step_pipe import Numbered
from rled_agent.nn.policy import load_policy
from rled_agent.replay.transitions import Step
from rled_agent.training.checkpoint import read_checkpoint

PATIENCE = 60.0


def await_that(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)


def numbered(number: int, observation: float = 0.5) -> Numbered:
    state = np.full(4, observation, dtype=np.float32)
    return Numbered(Step(state, np.zeros(2, np.float32), -1.0, 1.0, state), number)


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
