"""Records refuse what no robot can mean; an answer to a reset is read as it was said, and nothing else is."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.errors import ContractError
from rled_msgs_py.records import DeltaCommand, JointSample, PoseSample, TaskStatus
from rled_msgs_py.reset_answer import ResetAnswer

NAMES = ("shoulder", "elbow")


def test_delta_that_is_not_finite_is_refused():
    for bad in [float("nan"), float("inf"), -float("inf")]:
        with pytest.raises(ContractError, match="delta holds"):
            DeltaCommand(0, NAMES, np.array([0.0, bad]))


def test_a_joint_that_is_not_known_is_refused_where_it_is_used():
    for bad in [float("nan"), float("inf")]:
        sample = JointSample(7, ("finger", *NAMES), [bad, 1.0, 2.0], [bad, bad, bad])
        assert sample.ordered(NAMES).position.tolist() == [1.0, 2.0]
        with pytest.raises(ContractError, match=r"the joint state of 7 ns: finger is at .*accepted: a finite position"):
            sample.ordered(("shoulder", "finger"))


def test_a_sample_without_a_joint_is_refused_where_it_is_used():
    with pytest.raises(ContractError, match=r"joint state of 7 ns names shoulder; accepted: .*lacks elbow"):
        JointSample(7, ("shoulder",), [1.0], [0.0]).ordered(NAMES)


def test_delta_of_another_size_is_refused():
    for values in [[], [0.0], [0.0, 0.0, 0.0], [[0.0, 0.0]]]:
        with pytest.raises(ContractError, match=r"accepted: \(2,\)"):
            DeltaCommand(0, NAMES, values)


def test_names_that_do_not_tell_joints_apart_are_refused():
    for names in [(), ("elbow", "elbow"), ("shoulder", "")]:
        with pytest.raises(ContractError, match="distinct, non-empty joint names"):
            DeltaCommand(0, names, np.zeros(len(names)))


def test_orientation_that_is_no_unit_quaternion_is_refused():
    for orientation in [[0, 0, 0, 0], [0, 0, 0, 1.1], [0, 0, 0, float("nan")]]:
        with pytest.raises(ContractError, match="orientation"):
            PoseSample(0, "world", np.zeros(3), orientation)


def test_pose_without_orientation_is_not_rotated():
    assert PoseSample(0, "world", np.zeros(3)).orientation.tolist() == [0, 0, 0, 1]


def test_reward_that_is_not_finite_is_refused():
    with pytest.raises(ContractError, match="reward is nan"):
        TaskStatus(0, 0, 0, float("nan"), 0, False, 0, False, False)


def test_arrays_are_copies_that_cannot_be_written():
    given = np.zeros(2)
    sample = JointSample(0, NAMES, given, given)
    given[0] = 1.0
    assert sample.position[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        sample.position[0] = 1.0


def test_joints_in_another_order_are_accepted_by_name():
    sample = JointSample(7, NAMES, [1.0, 2.0], [3.0, 4.0]).ordered(("elbow", "shoulder"))
    assert (sample.stamp, sample.names) == (7, ("elbow", "shoulder"))
    assert (sample.position.tolist(), sample.velocity.tolist()) == ([2.0, 1.0], [4.0, 3.0])
    assert DeltaCommand(7, NAMES, [1.0, 2.0]).ordered(("elbow", "shoulder")).delta.tolist() == [2.0, 1.0]


def test_other_joints_are_refused_naming_the_difference():
    for wanted in [("shoulder",), ("shoulder", "wrist"), ("shoulder", "elbow", "wrist")]:
        offender = "wrist" if "wrist" in wanted else "elbow"
        with pytest.raises(ContractError, match=f"differs in .*{offender}"):
            DeltaCommand(0, NAMES, [1.0, 2.0]).ordered(wanted)


# What the simulation answers to a reset is read as it was said, and nothing else is.


counts = st.integers(0, 2**63 - 1)


@given(counts, counts)
def test_an_answer_is_read_as_it_was_said(episode: int, stamp: int) -> None:
    answer = ResetAnswer.of(episode, stamp)
    assert ResetAnswer.from_json(answer.to_json()) == answer


def test_another_answer_is_refused() -> None:
    whole = json.loads(ResetAnswer.of(1, 5).to_json())
    texts = ["", "-1", "episode 1 begins at 5 ns", "{}", "[]", "x" * 10**6, "{" * 10**5]
    changed = [{"stamp": stamp} for stamp in (-5, 1e9, True, "5", None, 9**99)]
    changed += [{"episode": -1}, {"text": 5}, {"more": 1}]
    for text in [*texts, *(json.dumps(whole | each) for each in changed), json.dumps({"stamp": 5})]:
        with pytest.raises(ContractError) as error:
            ResetAnswer.from_json(text)
        assert len(str(error.value)) < 2000
