"""What the networks propose: the expert, the agent, and who of them was drawn for an episode."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rled_agent.deploy.controller import ActorSettings, Controller, load_policies, make_controller
from rled_agent.nn.policy import load_policy
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import Actor

from ..graph.team import actor_like

SETTINGS = ActorSettings("iqr", passes=30, noise=0.0, phi=0.0, seed=3)
EPISODES = 400


@pytest.fixture(scope="module")
def unsure(planar_expert: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return actor_like(planar_expert, tmp_path_factory.mktemp("agent") / "actor.safetensors")


def observation(expert: Path) -> np.ndarray:
    return np.linspace(0.1, 0.4, load_policy(expert).network.sizes[0])


def drivers(controller: Controller, state: np.ndarray) -> list[Actor]:
    """Who drives each of many episodes."""
    found = []
    for _ in range(EPISODES):
        controller.begin()
        first, second = (controller.propose(state).policy for _ in range(2))
        assert first.actor is second.actor
        assert first.drawn is (first.actor is Actor.EXPERT)
        found.append(first.actor)
    return found


@pytest.mark.parametrize("dropout", [True, False])
def test_the_share_of_episodes_of_the_expert_is_phi(planar_expert, unsure, dropout):
    agent = unsure if dropout else planar_expert
    controller = make_controller(load_policies(str(planar_expert), str(agent)), replace(SETTINGS, phi=0.3))
    share = drivers(controller, observation(planar_expert)).count(Actor.EXPERT) / EPISODES
    assert abs(share - 0.3) < 4 * np.sqrt(0.3 * 0.7 / EPISODES)


def test_phi_changes_from_the_next_episode_on(planar_expert, unsure):
    state = observation(planar_expert)
    controller = make_controller(load_policies(str(planar_expert), str(unsure)), SETTINGS)
    assert set(drivers(controller, state)) == {Actor.AGENT}
    controller.adjust(replace(SETTINGS, phi=1.0))
    assert controller.propose(state).policy.actor is Actor.AGENT
    assert set(drivers(controller, state)) == {Actor.EXPERT}


def test_an_episode_of_the_expert_is_what_the_expert_would_do(planar_expert, unsure):
    state, expert = observation(planar_expert), load_policy(planar_expert)
    controller = make_controller(load_policies(str(planar_expert), str(unsure)), replace(SETTINGS, phi=1.0))
    controller.begin()
    proposed = controller.propose(state)
    limit = expert.task.max_delta
    assert proposed.policy.delta == pytest.approx(np.clip(expert.act(state), -limit, limit))
    assert (proposed.policy.measure, proposed.expert) == ("none", None)


def test_an_actor_without_dropout_explores_with_noise(planar_expert):
    state, limit = observation(planar_expert), load_policy(planar_expert).task.max_delta
    still = make_controller(load_policies("", str(planar_expert)), SETTINGS).propose(state).policy.delta
    noisy = make_controller(load_policies("", str(planar_expert)), replace(SETTINGS, noise=0.1))
    drawn = np.array([noisy.propose(state).policy.delta for _ in range(500)])
    deviation = 0.1 * limit  # δ counts in halves of the action range
    median = np.median(np.abs(drawn - still)[np.abs(drawn) < limit])
    assert median == pytest.approx(0.6745 * deviation, rel=0.2)  # of a normal distribution, one half of it cut off


def test_phi_without_an_expert_is_refused(planar_expert):
    with pytest.raises(RledError, match=r"phi is 0.2 without an expert; accepted: 0"):
        make_controller(load_policies("", str(planar_expert)), replace(SETTINGS, phi=0.2))
