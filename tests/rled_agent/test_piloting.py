"""What the loaded policies propose: the expert, the agent, and who of them was drawn for an episode."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rled_agent.deploy.piloting import Pilot, StrategySettings, load_policies
from rled_agent.nn.policy import GateSettings, load_policy
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import Actor, GateCode

from ..graph.team import actor_like

SETTINGS = StrategySettings(GateSettings("iqr", 1e6, 30))
SEED = 3
EPISODES = 400


@pytest.fixture(scope="module")
def unsure(planar_expert: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return actor_like(planar_expert, tmp_path_factory.mktemp("agent") / "actor.safetensors")


def observation(expert: Path) -> np.ndarray:
    return np.linspace(0.1, 0.4, load_policy(expert).network.sizes[0])


def pilot(expert: Path | str, agent: Path | str, settings: StrategySettings = SETTINGS) -> Pilot:
    return Pilot(load_policies(str(expert), str(agent)), settings, SEED)


def drivers(one: Pilot, state: np.ndarray) -> list[Actor]:
    """Who drives each of many episodes."""
    found = []
    for _ in range(EPISODES):
        one.begin()
        first, second = (one.propose(state) for _ in range(2))
        assert first.actor is second.actor
        assert (first.code is GateCode.DRAWN) is (first.actor is Actor.EXPERT)
        found.append(first.actor)
    return found


@pytest.mark.parametrize("dropout", [True, False])
def test_the_share_of_episodes_of_the_expert_is_phi(planar_expert, unsure, dropout):
    one = pilot(planar_expert, unsure if dropout else planar_expert, replace(SETTINGS, phi=0.3))
    share = drivers(one, observation(planar_expert)).count(Actor.EXPERT) / EPISODES
    assert abs(share - 0.3) < 4 * np.sqrt(0.3 * 0.7 / EPISODES)


def test_phi_changes_from_the_next_episode_on(planar_expert, unsure):
    state, one = observation(planar_expert), pilot(planar_expert, unsure)
    assert set(drivers(one, state)) == {Actor.AGENT}
    one.adjust(replace(SETTINGS, phi=1.0))
    assert one.propose(state).actor is Actor.AGENT
    assert set(drivers(one, state)) == {Actor.EXPERT}
    one.adjust(SETTINGS)
    assert one.propose(state).actor is Actor.EXPERT


def test_an_episode_of_the_expert_is_what_the_expert_would_do(planar_expert, unsure):
    state, expert = observation(planar_expert), load_policy(planar_expert)
    one = pilot(planar_expert, unsure, replace(SETTINGS, phi=1.0))
    one.begin()
    proposed, limit = one.propose(state), expert.task.max_delta
    assert proposed.delta == pytest.approx(np.clip(expert.act(state), -limit, limit), abs=1e-7)
    assert proposed[2:7:2] == (GateCode.DRAWN, "none", "")
    assert np.isnan([proposed.uncertainty, proposed.threshold]).all()


def test_an_actor_with_dropout_is_gated_and_the_expert_stands_by(planar_expert, unsure):
    state, expert = observation(planar_expert), load_policy(planar_expert)
    limit = expert.task.max_delta
    within = np.clip(expert.act(state), -limit, limit)
    for threshold, actor, code in ((1e6, Actor.AGENT, GateCode.SURE), (0.0, Actor.EXPERT, GateCode.UNSURE)):
        one = pilot(planar_expert, unsure, replace(SETTINGS, gate=GateSettings("iqr", threshold, 30)))
        proposed = one.propose(state)
        assert (proposed.actor, proposed.code, proposed.measure, proposed.threshold) == (actor, code, "iqr", threshold)
        assert 0.0 < proposed.uncertainty < 1.0
        assert proposed.expert() == pytest.approx(within)
        if actor is Actor.EXPERT:
            assert proposed.delta == pytest.approx(within, abs=1e-7)


def test_the_gate_dwells_on_when_its_settings_change(planar_expert, unsure):
    state, dwelling = observation(planar_expert), replace(SETTINGS, dwell=3)
    one = pilot(planar_expert, unsure, replace(dwelling, gate=GateSettings("iqr", 0.0, 30)))
    assert one.propose(state).actor is Actor.EXPERT
    one.adjust(dwelling)
    assert [one.propose(state).actor for _ in range(3)] == [Actor.EXPERT, Actor.EXPERT, Actor.AGENT]
    assert [one.propose(state).note for _ in range(2)] == ["", ""]


def test_without_an_expert_the_agent_acts_and_nobody_stands_by(planar_expert, unsure):
    proposed = pilot("", unsure).propose(observation(planar_expert))
    assert (proposed.actor, proposed.code, proposed.measure, proposed.expert) == (
        Actor.AGENT,
        GateCode.UNGATED,
        "none",
        None,
    )


def test_the_expert_alone_is_the_policy(planar_expert):
    proposed = pilot(planar_expert, "").propose(observation(planar_expert))
    assert (proposed.actor, proposed.code, proposed.expert) == (Actor.EXPERT, GateCode.UNGATED, None)


def test_an_actor_without_dropout_explores_with_noise(planar_expert):
    state, limit = observation(planar_expert), load_policy(planar_expert).task.max_delta
    still = pilot("", planar_expert).propose(state).delta
    noisy = pilot("", planar_expert, replace(SETTINGS, noise=0.1))
    drawn = np.array([noisy.propose(state).delta for _ in range(500)])
    deviation = 0.1 * limit  # δ counts in halves of the action range
    median = np.median(np.abs(drawn - still)[np.abs(drawn) < limit])
    assert median == pytest.approx(0.6745 * deviation, rel=0.2)  # of a normal distribution, one half of it cut off


def test_phi_without_an_expert_is_refused(planar_expert):
    with pytest.raises(RledError, match=r"phi is 0.2 without an expert; accepted: 0"):
        pilot("", planar_expert, replace(SETTINGS, phi=0.2))


def test_a_measure_that_the_policy_does_not_give_is_refused(planar_expert, unsure):
    with pytest.raises(RledError, match="measure is 'std' of dropout; accepted: qcd, iqr"):
        pilot(planar_expert, unsure, replace(SETTINGS, gate=GateSettings("std")))
