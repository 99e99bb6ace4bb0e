import numpy as np
from rled_agent.behaviour import Noise
from rled_agent.peer_behaviour import JumpStart, Proposal
from rled_msgs_py.records import Actor

STATE = np.zeros(4, dtype=np.float32)
AGENT, EXPERT = (np.array(action, dtype=np.float32) for action in ([0.5, -0.5], [0.25, 0.75]))
SILENT = Noise(0.0, np.random.default_rng(0))


def jump_start() -> JumpStart:
    return JumpStart(lambda _: AGENT, lambda _: EXPERT, SILENT, guide_steps=4, guide_until=20)


def guided(behaviour: JumpStart, steps: int) -> str:
    behaviour.begin()
    return "".join(behaviour.act(STATE).actor.value[0] for _ in range(steps))


def test_the_guide_begins_each_episode_ever_more_briefly():
    behaviour = jump_start()
    # after k steps the guide has 4 (1 - k/20) steps of an episode: 4 at first, 3 at k = 5, 2 at 10, 1 at 15
    assert [guided(behaviour, 5) for _ in range(5)] == ["eeeea", "eeeaa", "eeaaa", "eaaaa", "aaaaa"]


def test_a_jump_start_goes_on_from_its_state():
    one, other = jump_start(), jump_start()
    guided(one, 7)
    state = one.state()
    other.begin()
    other.restore(state)
    assert [one.act(STATE).actor for _ in range(30)] == [other.act(STATE).actor for _ in range(30)]


def test_the_critics_choose_between_two_proposals():
    wants = Proposal(lambda _: AGENT, lambda _: EXPERT, SILENT, lambda observation, action: float(action[1]))
    assert wants.act(STATE).actor is Actor.EXPERT
    assert np.array_equal(wants.act(STATE).action, EXPERT)
    shuns = Proposal(lambda _: AGENT, lambda _: EXPERT, SILENT, lambda observation, action: -float(action[1]))
    assert np.array_equal(shuns.act(STATE).action, AGENT)
    assert shuns.act(STATE).actor is Actor.AGENT


def test_noise_is_on_the_actors_proposal_when_the_critics_see_it():
    seen = []
    noisy = Proposal(
        lambda _: AGENT,
        lambda _: EXPERT,
        Noise(0.3, np.random.default_rng(5)),
        lambda observation, action: seen.append(action) or float(np.array_equal(action, EXPERT)) - 1.0,
    )
    assert noisy.act(STATE).actor is Actor.EXPERT
    same = np.random.default_rng(5).normal(0.0, 0.3, 2)
    assert any(np.allclose(each, np.clip(AGENT + same, -1.0, 1.0)) for each in seen)
