"""The pose that is marked: of the newest tick whose joints are known, from however many publishers."""

import numpy as np
from rled_msgs_py.messages import decode, encode
from rled_msgs_py.records import JointSample, PoseSample
from rled_msgs_py.topics import EE_POSE, JOINT_STATES
from rled_teleop.recording.recent import RecentMessages

ARM = ("left", "right")
NAN = float("nan")


def joints(stamp: int, **position: float) -> bytes:
    values = list(position.values())
    return encode(JOINT_STATES, JointSample(stamp, tuple(position), np.array(values), np.zeros(len(values))))


def recent(*found: bytes, poses: tuple[int, ...]) -> RecentMessages:
    kept = RecentMessages()
    for data in found:
        kept.add(JOINT_STATES, data)
    for stamp in poses:
        kept.add(EE_POSE, encode(EE_POSE, PoseSample(stamp, "world", np.zeros(3))))
    return kept


def test_a_state_of_all_joints_is_marked_as_received() -> None:
    whole = joints(20, finger=NAN, right=2.0, left=1.0)
    pose = recent(joints(0, left=0.0, right=0.0), whole, joints(20, finger=0.1), poses=(0, 20, 40)).pose(ARM)
    assert pose is not None
    assert pose[0] == whole


def test_halves_are_marked_as_one_state() -> None:
    for later in [20, 17, 23]:
        halves = [
            joints(0, left=0.0),
            joints(max(later - 20, 0), right=0.5),
            joints(20, left=1.0),
            joints(later, right=2.0),
        ]
        pose = recent(*halves, poses=(0, 20) if later >= 20 else (0,)).pose(ARM)
        assert pose is not None
        sample = decode(JOINT_STATES, pose[0])
        assert isinstance(sample, JointSample)
        assert sample.names == ARM
        assert sample.stamp == decode(EE_POSE, pose[1]).stamp  # type: ignore[union-attr]


def test_a_state_that_is_not_known_is_not_marked() -> None:
    assert recent(joints(20, left=NAN, right=2.0), poses=(20,)).pose(ARM) is None
    assert recent(joints(20, left=1.0), poses=(20,)).pose(ARM) is None
    known = recent(joints(0, left=1.0, right=2.0), joints(20, left=NAN, right=2.0), poses=(0, 20)).pose(ARM)
    assert known is not None
    assert known[0] == joints(0, left=1.0, right=2.0)
