"""Expert and actor share an episode: a guide that begins it, proposals that critics choose from."""

import json

import numpy as np
from rled_agent.exploration.agent import Noise
from rled_agent.exploration.jump_start import JumpStart
from rled_agent.exploration.proposals import Proposals
from rled_msgs_py.records import Actor

STATE = np.zeros(4, dtype=np.float32)
AGENT, EXPERT = (np.array(action, dtype=np.float32) for action in ([0.5, -0.5], [0.25, 0.75]))
SILENT = Noise(0.0, np.random.default_rng(0))


def jump_start() -> JumpStart:
    return JumpStart(lambda _: AGENT, lambda _: EXPERT, SILENT, guide_steps=4, stages=2, tolerance=0.1)


def episodes(strategy: JumpStart, returns: list[float]) -> list[str]:
    """Who acted in five steps of each: e of the expert, a of the agent."""
    acted = []
    for each in returns:
        strategy.begin()
        acted.append("".join(strategy.act(STATE).actor.value[0] for _ in range(5)))
        strategy.end(each)
    return acted


def test_the_guide_begins_each_episode_and_is_shorter_in_each_stage():
    strategy = jump_start()
    assert episodes(strategy, [100.0] * 6) == ["eeeea"] * 5 + ["eeaaa"]
    # the last five of 100, 75, 75, 75, 75, 150 have 80 on average, too little beside 100, and then 90, which will do
    assert episodes(strategy, [75.0] * 4 + [150.0]) == ["eeaaa"] * 5
    assert episodes(strategy, [0.0] * 12) == ["aaaaa"] * 12


def test_what_lacks_is_a_share_of_negative_returns_too():
    strategy = jump_start()
    assert episodes(strategy, [-100.0] * 5 + [-112.0] * 6) == ["eeeea"] * 5 + ["eeaaa"] * 6
    # with one of −105 the last five have −110.6 on average, with two of them −109.2
    assert episodes(strategy, [-105.0] * 3) == ["eeaaa"] * 2 + ["aaaaa"]


def test_a_jump_start_goes_on_from_its_state():
    one, other = jump_start(), jump_start()
    assert json.loads(json.dumps(one.state_dict())) == one.state_dict()
    for results in ([], [100.0] * 7 + [90.0] * 2):
        episodes(one, results)
        one.begin()
        one.act(STATE)
        other.begin()
        other.load_state_dict(json.loads(json.dumps(one.state_dict())))
        assert [one.act(STATE).actor for _ in range(6)] == [other.act(STATE).actor for _ in range(6)]
        one.end(90.0)
        other.end(90.0)
        assert episodes(one, [90.0] * 9) == episodes(other, [90.0] * 9)


def test_the_critics_choose_between_two_proposals():
    wants = Proposals(lambda _: AGENT, lambda _: EXPERT, SILENT, lambda observation, action: float(action[1]))
    assert wants.act(STATE).actor is Actor.EXPERT
    assert np.array_equal(wants.act(STATE).action, EXPERT)
    shuns = Proposals(lambda _: AGENT, lambda _: EXPERT, SILENT, lambda observation, action: -float(action[1]))
    assert np.array_equal(shuns.act(STATE).action, AGENT)
    assert shuns.act(STATE).actor is Actor.AGENT


def test_noise_is_on_the_actors_proposal_when_the_critics_see_it():
    seen = []
    noisy = Proposals(
        lambda _: AGENT,
        lambda _: EXPERT,
        Noise(0.3, np.random.default_rng(5)),
        lambda observation, action: seen.append(action) or float(np.array_equal(action, EXPERT)) - 1.0,
    )
    assert noisy.act(STATE).actor is Actor.EXPERT
    same = np.random.default_rng(5).normal(0.0, 0.3, 2)
    assert any(np.allclose(each, np.clip(AGENT + same, -1.0, 1.0)) for each in seen)
