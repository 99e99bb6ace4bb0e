"""Records to test with: one small recording, and strategies that draw any record."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st
from rled_msgs_py.bags import BagWriter
from rled_msgs_py.messages import LATEST
from rled_msgs_py.records import (
    Actor,
    DeltaCommand,
    GateCode,
    GateDecision,
    Health,
    JointSample,
    Level,
    PoseSample,
    Record,
    TaskStatus,
    Text,
)
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.topics import Topic

from rled_msgs_py import topics

NAMES = ("shoulder", "elbow")
PERIOD = 20_000_000
URDF = "<robot name='planar'/>"
TASK = TaskDescription(
    robot="planar",
    task="reach",
    frame="world",
    tip_link="tip",
    joint_names=NAMES,
    joint_lower=(-3.0, 0.0),
    joint_upper=(3.0, 3.0),
    max_delta=0.1,
    axes=(0, 1),
    workspace_lower=(-1.0, -1.0),
    workspace_upper=(1.0, 1.0),
    observation="position_and_target",
    reward="dense",
    reward_reached=10.0,
    tolerance=1e-3,
    targets_per_episode=1,
    max_steps=100,
    period=PERIOD,
)


def tick(k: int) -> list[tuple[Topic, Record]]:
    """What is recorded of one tick of a made-up motion."""
    stamp, q = k * PERIOD, np.array([0.01 * k, 0.5 - 0.001 * k])
    return [
        (topics.JOINT_STATES, JointSample(stamp, NAMES, q, 50 * q)),
        (topics.EE_POSE, PoseSample(stamp, "world", np.array([q[0], q[1], 0.25]))),
        (topics.TARGET_POSE, PoseSample(stamp, "world", np.ones(3))),
        (topics.TASK_STATUS, TaskStatus(stamp, 0, k, -0.5 * k, 0, k % 5 == 4, k // 5, False, k == 99)),
        (topics.JOINT_DELTA, DeltaCommand(stamp, NAMES, np.array([0.01, -0.001]))),
    ]


def descriptions() -> list[tuple[Topic, Record]]:
    return [(topics.ROBOT_DESCRIPTION, Text(URDF)), (topics.TASK_DESCRIPTION, Text(TASK.to_json()))]


def recording(ticks: int) -> list[tuple[Topic, Record]]:
    """Everything that a small bag holds."""
    return descriptions() + [entry for k in range(ticks) for entry in tick(k)]


def write_bag(path: Path, ticks: int = 20, flush_every: int = 2, **options: Any) -> Path:
    with BagWriter(path, **options) as bag:
        for number, (topic, record) in enumerate(recording(ticks)):
            bag.write(topic, record)
            if number % (5 * flush_every) == 0:
                bag.flush()
    return path


def same(left: Any, right: Any) -> bool:
    """Whether two records hold the same, to the last bit."""
    if type(left) is not type(right):
        return False
    return all(_same_value(getattr(left, each.name), getattr(right, each.name)) for each in fields(left))


def _same_value(left: Any, right: Any) -> bool:
    if isinstance(left, np.ndarray):
        return left.shape == right.shape and left.tobytes() == right.tobytes()
    return left == right or (left != left and right != right)


STAMPS = st.integers(0, LATEST - 1)
TEXTS = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=12)
FINITE = st.floats(allow_nan=False, allow_infinity=False)
COUNTS = st.integers(0, 10**12)
NAME_LISTS = st.lists(TEXTS.filter(bool), min_size=1, max_size=8, unique=True).map(tuple)


def vectors(size: int) -> st.SearchStrategy[list[float]]:
    return st.lists(FINITE, min_size=size, max_size=size)


@st.composite
def orientations(draw: st.DrawFn) -> list[float]:
    four = np.array(draw(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4)))
    norm = np.linalg.norm(four)
    return [0.0, 0.0, 0.0, 1.0] if norm < 0.1 else (four / norm).tolist()


@st.composite
def joint_samples(draw: st.DrawFn) -> JointSample:
    names = draw(NAME_LISTS)
    return JointSample(draw(STAMPS), names, draw(vectors(len(names))), draw(vectors(len(names))))


@st.composite
def delta_commands(draw: st.DrawFn) -> DeltaCommand:
    names = draw(NAME_LISTS)
    return DeltaCommand(draw(STAMPS), names, draw(vectors(len(names))))


POSES = st.builds(PoseSample, STAMPS, TEXTS, vectors(3), orientations())
HEALTHS = st.builds(Health, STAMPS, st.sampled_from(Level), TEXTS, TEXTS, st.dictionaries(TEXTS, TEXTS, max_size=4))
STATUSES = st.builds(
    TaskStatus, STAMPS, COUNTS, COUNTS, FINITE, COUNTS, st.booleans(), COUNTS, st.booleans(), st.booleans(), TEXTS
)
DECISIONS = st.builds(
    GateDecision,
    STAMPS,
    st.sampled_from(Level),
    st.sampled_from(Actor),
    TEXTS,
    st.floats(),
    st.floats(),
    TEXTS,
    COUNTS,
    COUNTS,
    st.sampled_from(GateCode),
)

RECORDS: dict[Topic, st.SearchStrategy[Any]] = {
    topics.JOINT_STATES: joint_samples(),
    topics.EE_POSE: POSES,
    topics.TARGET_POSE: POSES,
    topics.TASK_STATUS: STATUSES,
    topics.JOINT_DELTA: delta_commands(),
    topics.HUMAN_JOINT_DELTA: delta_commands(),
    topics.SAFETY_GATE: DECISIONS,
    topics.MARKED_JOINT_STATES: joint_samples(),
    topics.MARKED_EE_POSE: POSES,
    topics.ROBOT_DESCRIPTION: st.builds(Text, TEXTS),
    topics.TASK_DESCRIPTION: st.builds(Text, TEXTS),
    topics.EPISODE_EVENTS: st.builds(Text, TEXTS),
    topics.DIAGNOSTICS: HEALTHS,
}
ENTRIES = st.one_of([st.tuples(st.just(topic), records) for topic, records in RECORDS.items()])
"""A topic of the contract and a record for it."""
