"""The arbiter: one decision at a time, worked out by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_agent.deploy.arbiter import Arbiter, ArbiterSettings, Situation
from rled_agent.deploy.piloting import Proposal
from rled_msgs_py.records import Actor, GateCode, Level
from rled_msgs_py.task_limits import Limits
from rled_sim.motion_guard import Guard
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

TASK = reach_task(ROBOTS["planar"]).description  # Δq_max is 0.1 rad, two joints
AT_ONCE = ArbiterSettings(blend=0)
AGENT, EXPERT, PERSON = np.array([0.01, 0.02]), np.array([-0.03, 0.04]), np.array([0.05, -0.05])


def arbiter(settings: ArbiterSettings = AT_ONCE, limits: Limits | None = None) -> Arbiter:
    return Arbiter(settings, Guard(TASK if limits is None else replace(TASK, limits=limits)), 2)


def situation(u=0.1, now=0.0, delta=AGENT, expert=EXPERT, age=0.0, q=(0.0, 1.0), note="") -> Situation:
    """Of an agent that proposes ``delta`` where it is sure, and an expert that stands by and acts from 0.5 on."""
    stands_in = None if expert is None else lambda: expert
    compared = u, "iqr", 0.5, note, stands_in
    if u < 0.5:
        return Situation(now, age, np.array(q), Proposal(Actor.AGENT, delta, GateCode.SURE, *compared))
    unsure = EXPERT if expert is None else expert
    return Situation(now, age, np.array(q), Proposal(Actor.EXPERT, unsure, GateCode.UNSURE, *compared))


def alone(proposal: Proposal) -> Situation:
    return Situation(0.0, 0.0, np.zeros(2), proposal)


def test_the_agent_acts_where_it_is_sure():
    outcome = arbiter().decide(situation(u=0.49))
    assert outcome.delta.tolist() == AGENT.tolist()
    assert outcome[1:] == (Actor.AGENT, Level.OK, GateCode.SURE, "iqr 0.49 < threshold 0.5")


@pytest.mark.parametrize(
    ("u", "reason"),
    [(0.5, "iqr 0.5 >= threshold 0.5"), (math.inf, "iqr inf >= threshold 0.5"), (math.nan, "iqr nan >= threshold 0.5")],
)
def test_the_expert_acts_where_the_agent_is_not_sure(u, reason):
    outcome = arbiter().decide(situation(u=u))
    assert outcome.delta.tolist() == EXPERT.tolist()
    assert outcome[1:] == (Actor.EXPERT, Level.WARN, GateCode.UNSURE, reason)


def test_what_the_code_does_not_say_stands_behind_the_reason():
    outcome = arbiter().decide(situation(u=0.6, note="for 1 of 3 steps"))
    assert outcome.reason == "iqr 0.6 >= threshold 0.5, for 1 of 3 steps"


def test_a_policy_without_uncertainty_always_acts():
    outcome = arbiter().decide(alone(Proposal(Actor.EXPERT, EXPERT)))
    assert outcome.delta.tolist() == EXPERT.tolist()
    assert outcome[1:] == (Actor.EXPERT, Level.OK, GateCode.UNGATED, "the expert is the policy")


def test_an_expert_drawn_for_the_episode_acts_and_says_so():
    outcome = arbiter().decide(alone(Proposal(Actor.EXPERT, EXPERT, GateCode.DRAWN)))
    assert outcome.delta.tolist() == EXPERT.tolist()
    assert outcome[1:] == (Actor.EXPERT, Level.OK, GateCode.DRAWN, "the expert was drawn for this episode")


def test_without_an_expert_what_is_not_within_the_limits_holds():
    outcome = arbiter().decide(alone(Proposal(Actor.AGENT, np.array([0.2, 0.0]))))
    assert outcome.delta.tolist() == [0.0, 0.0]
    assert outcome[1:4] == (Actor.HOLD, Level.ERROR, GateCode.LIMIT)


def test_a_person_comes_before_agent_and_expert_and_answers_one_state_a_command():
    one = arbiter()
    one.hear_person(PERSON, 0.0)
    outcome = one.decide(situation(u=1.0, now=0.1))
    assert outcome.delta.tolist() == PERSON.tolist()
    assert outcome[1:4] == (Actor.HUMAN, Level.WARN, GateCode.HUMAN)
    assert one.decide(situation(now=0.2)) is None  # it is the person's turn
    one.hear_person(-PERSON, 0.25)
    assert one.decide(situation(now=0.25)).delta.tolist() == (-PERSON).tolist()
    assert one.decide(situation(now=0.5)) is None
    assert one.decide(situation(now=0.56)).actor is Actor.AGENT  # let go 0.31 s ago


def test_a_command_that_came_too_long_ago_moves_nothing():
    one = arbiter()
    one.hear_person(PERSON, 0.0)
    assert one.decide(situation(now=1.0)).actor is Actor.AGENT
    assert one.decide(situation(now=1.1)).actor is Actor.AGENT


def test_control_passes_in_equal_parts():
    one = arbiter(replace(AT_ONCE, blend=3))
    assert one.decide(situation(now=0.0)).delta.tolist() == AGENT.tolist()
    parts = []
    for step in range(5):
        one.hear_person(PERSON, step * 0.1)
        parts.append(one.decide(situation(now=step * 0.1)).delta)
    expected = [AGENT + (PERSON - AGENT) * share for share in (0.25, 0.5, 0.75, 1.0, 1.0)]
    np.testing.assert_allclose(parts, expected, atol=1e-15)
    released = [one.decide(situation(now=2.0 + step)).delta for step in range(4)]  # it stood still before
    np.testing.assert_allclose(released, [AGENT * share for share in (0.25, 0.5, 0.75, 1.0)], atol=1e-15)


def test_the_emergency_stop_comes_before_everything():
    one = arbiter()
    one.stopped = True
    one.hear_person(PERSON, 0.0)
    outcome = one.decide(situation(now=0.0))
    assert outcome == (None, Actor.HOLD, Level.ERROR, GateCode.STOPPED, "the emergency stop is on")
    one.stopped = False
    assert one.decide(situation(now=0.1)) is None  # what was commanded meanwhile is forgotten
    assert one.decide(situation(now=0.5)).actor is Actor.AGENT


def test_what_a_limit_forbids_the_agent_the_expert_does_instead():
    limits = Limits(joint_lower=(-1.0, 0.5), joint_upper=(1.0, 2.0))
    one = arbiter(limits=limits)
    outcome = one.decide(situation(u=0.1, q=(0.995, 1.0)))  # the agent would turn the first joint to 1.005 rad
    assert outcome.delta.tolist() == EXPERT.tolist()
    assert outcome[1:4] == (Actor.EXPERT, Level.WARN, GateCode.LIMIT)
    assert "1.005 rad" in outcome.reason
    outcome = one.decide(situation(u=0.1, q=(0.995, 1.0), expert=AGENT))
    assert outcome.delta.tolist() == [0.0, 0.0]
    assert outcome[1:4] == (Actor.HOLD, Level.ERROR, GateCode.LIMIT)
    assert one.decide(situation(u=1.0, q=(0.0, 1.97))).code is GateCode.LIMIT  # the expert would leave, too


@pytest.mark.parametrize("delta", [np.array([0.2, 0.0]), np.array([math.nan, 0.0])])
def test_a_proposal_that_no_robot_may_carry_out_is_not_the_agents_turn(delta):
    outcome = arbiter().decide(situation(u=0.1, delta=delta))
    assert (outcome.actor, outcome.code) == (Actor.EXPERT, GateCode.LIMIT)


def test_an_old_state_is_not_acted_on():
    one = arbiter(replace(AT_ONCE, state_timeout=0.1))
    assert one.decide(situation(age=0.1)).actor is Actor.AGENT
    outcome = one.decide(situation(age=0.11))
    assert outcome == (None, Actor.HOLD, Level.ERROR, GateCode.STALE, "the state is 0.110 s old")
    assert arbiter().decide(situation(age=1e6)).actor is Actor.AGENT


def test_where_it_is_unsure_a_person_is_asked_and_then_the_expert_acts():
    one = arbiter(replace(AT_ONCE, query_timeout=2.0))
    asked = one.decide(situation(u=0.6, now=10.0))
    assert asked[:4] == (None, Actor.HOLD, Level.ERROR, GateCode.ASKING)
    assert asked.reason == "iqr 0.6 >= threshold 0.5; a person is asked, for 2.0 s more"
    assert one.decide(situation(u=0.6, now=11.9)).code is GateCode.ASKING
    assert one.decide(situation(u=0.6, now=12.0)).actor is Actor.EXPERT
    assert one.decide(situation(u=0.6, now=12.1)).actor is Actor.EXPERT  # not asked again for the same trouble
    assert one.decide(situation(u=0.1, now=12.2)).actor is Actor.AGENT
    assert one.decide(situation(u=0.6, now=12.3)).code is GateCode.ASKING


def test_a_person_answers_the_question_by_driving():
    one = arbiter(replace(AT_ONCE, query_timeout=2.0))
    one.decide(situation(u=0.6, now=0.0))
    one.hear_person(PERSON, 1.0)
    assert one.decide(situation(u=0.6, now=1.0)).actor is Actor.HUMAN
    assert one.decide(situation(u=0.6, now=1.5)).code is GateCode.ASKING  # asked anew after letting go


SITUATIONS = st.tuples(
    st.floats(allow_nan=True), st.floats(0.0, 0.4), st.sampled_from([AGENT, EXPERT, np.array([1.0, 0.0])]),
    st.sampled_from([None, EXPERT]), st.sampled_from([None, PERSON]), st.booleans(),
)  # fmt: skip
SETTINGS = st.builds(
    ArbiterSettings, st.integers(0, 4), st.floats(0.05, 1.0), st.sampled_from([0.0, 0.2]), st.sampled_from([0.0, 0.5])
)


@given(SETTINGS, st.lists(SITUATIONS, max_size=20))
def test_whatever_happens_a_decision_is_lawful_and_repeatable(settings, events):
    one, other, now = arbiter(settings), arbiter(settings), 0.0
    for u, wait, delta, expert, person, stopped in events:
        now += wait
        outcomes = []
        for each in (one, other):
            each.stopped = stopped
            if person is not None:
                each.hear_person(person, now)
            outcomes.append(each.decide(situation(u=u, now=now, delta=delta, expert=expert, age=wait)))
        first, second = outcomes
        assert (first is None) == (second is None)
        if first is None:
            continue
        assert first[1:] == second[1:]
        if first.delta is not None:
            assert np.abs(first.delta).max() <= TASK.max_delta
            assert first.delta.tolist() == second.delta.tolist()
        if stopped:
            assert (first.delta, first.code) == (None, GateCode.STOPPED)
        if first.actor is Actor.HOLD and first.delta is not None:
            assert not first.delta.any()
