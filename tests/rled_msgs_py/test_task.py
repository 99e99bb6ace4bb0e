"""The task description travels as JSON and refuses what makes no task."""

import json
from dataclasses import asdict, fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.errors import ContractError
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.task_limits import NO_LIMITS, Limits, Zone

from .samples import TASK, TEXTS

NUMBERS = st.floats(-1e6, 1e6)
POSITIVE = st.floats(1e-9, 1e6)


@st.composite
def tasks(draw):
    names = tuple(draw(st.lists(TEXTS.filter(bool), min_size=1, max_size=7, unique=True)))
    axes = tuple(draw(st.lists(st.sampled_from([0, 1, 2]), min_size=1, unique=True)))
    bounds = {}
    for what, size in (("joint", len(names)), ("workspace", len(axes))):
        pairs = [sorted(draw(st.tuples(NUMBERS, NUMBERS))) for _ in range(size)]
        bounds[f"{what}_lower"] = tuple(pair[0] for pair in pairs)
        bounds[f"{what}_upper"] = tuple(pair[1] for pair in pairs)
    return TaskDescription(
        robot=draw(TEXTS),
        task=draw(TEXTS),
        frame=draw(TEXTS),
        tip_link=draw(TEXTS),
        joint_names=names,
        max_delta=draw(POSITIVE),
        axes=axes,
        observation=draw(st.sampled_from(["displacement_and_joints", "position_and_target"])),
        reward=draw(st.sampled_from(["dense", "sparse"])),
        reward_reached=draw(NUMBERS),
        tolerance=draw(POSITIVE),
        targets_per_episode=draw(st.integers(0, 100)),
        max_steps=draw(st.integers(0, 10**6)),
        period=draw(st.integers(1, 10**10)),
        **bounds,
    )


@given(tasks())
def test_description_survives_json(task):
    assert TaskDescription.from_json(task.to_json()) == task


HUGE = 10**400
DEEP = TASK.to_json().replace('"axes": [0, 1]', '"axes": ' + "[" * 800 + "]" * 800)
"""JSON that can be read, but nested deeper than it can be looked at."""


def test_text_that_is_no_json_is_refused():
    for text in ["", "{", "nonsense", "[" * 100_000, DEEP]:
        with pytest.raises(ContractError, match=r"the task description is (no JSON|nested too deeply)"):
            TaskDescription.from_json(text)


def test_other_fields_are_refused():
    for text in ["[]", "{}", "3", "null", json.dumps(asdict(TASK) | {"colour": "red"})]:
        with pytest.raises(ContractError, match="has other fields; accepted: robot, task"):
            TaskDescription.from_json(text)


def test_a_wrong_kind_of_value_is_refused_naming_the_field():
    for value in [None, True, {}, [None], [[1]], float("nan"), 10**400, [10**400]]:
        for field in [each.name for each in fields(TaskDescription)]:
            with pytest.raises(ContractError, match=field):
                TaskDescription.from_json(json.dumps(asdict(TASK) | {field: value}))


WRONG = {
    "robot": 3,
    "joint_names": "ab",
    "joint_lower": "ab",
    "joint_upper": [3.0, "3"],
    "max_delta": 0.0,
    "tolerance": -1e-3,
    "period": 0.02,
    "axes": [0, 3],
    "observation": "everything",
    "reward": "shaped",
    "targets_per_episode": -1,
    "max_steps": -1,
    "workspace_lower": [-1.0],
    "workspace_upper": [1.0, float("inf")],
}


def test_a_value_that_makes_no_task_is_refused():
    for field, value in WRONG.items():
        with pytest.raises(ContractError, match=field):
            TaskDescription.from_json(json.dumps(asdict(TASK) | {field: value}))


def test_bounds_the_wrong_way_round_are_refused():
    with pytest.raises(ContractError, match="joint_lower"):
        replace(TASK, joint_lower=TASK.joint_upper, joint_upper=TASK.joint_lower)


def test_a_joint_named_twice_is_refused():
    with pytest.raises(ContractError, match="distinct"):
        replace(TASK, joint_names=("elbow", "elbow"))


def test_choices_are_listed():
    with pytest.raises(ContractError, match="reward 'shaped'; accepted: dense, sparse"):
        replace(TASK, reward="shaped")


def test_position_and_target_observation_by_hand():
    x = TASK.observe(np.array([0.1, 0.2]), np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]))
    assert x.tolist() == [1.0, 2.0, 4.0, 5.0]


def test_displacement_and_joints_observation_by_hand():
    task = replace(
        TASK,
        observation="displacement_and_joints",
        axes=(0, 1, 2),
        workspace_lower=(-1.0,) * 3,
        workspace_upper=(1.0,) * 3,
    )
    x = task.observe(np.array([[0.1, 0.2]]), np.array([[1.0, 2.0, 3.0]]), np.array([[4.0, 6.0, 8.0]]))
    assert x.tolist() == [[3.0, 4.0, 5.0, 0.1, 0.2]]
    lower, upper = task.observation_bounds()
    assert lower.tolist() == [-2.0, -2.0, -2.0, -3.0, 0.0]
    assert upper.tolist() == [2.0, 2.0, 2.0, 3.0, 3.0]


@pytest.mark.parametrize("observation", ["displacement_and_joints", "position_and_target"])
def test_observations_of_tensors_are_those_of_arrays(observation):
    import torch

    task = replace(TASK, observation=observation)
    states = [np.random.default_rng(size).normal(size=(4, size)) for size in (2, 3, 3)]
    np.testing.assert_array_equal(task.observe(*map(torch.from_numpy, states)).numpy(), task.observe(*states))


@given(st.lists(st.floats(0.0, 1.0), min_size=8, max_size=8))
def test_observations_within_workspace_and_limits_are_within_the_bounds(shares):
    for observation in ("displacement_and_joints", "position_and_target"):
        task = replace(TASK, observation=observation)
        span = np.subtract(task.workspace_upper, task.workspace_lower)
        points = [np.append(task.workspace_lower + np.array(part) * span, 0.0) for part in (shares[:2], shares[2:4])]
        q = task.joint_lower + np.array(shares[4:6]) * np.subtract(task.joint_upper, task.joint_lower)
        x = task.observe(q, *points)
        lower, upper = task.observation_bounds()
        assert (lower - 1e-12 <= x).all()
        assert (x <= upper + 1e-12).all()


def test_another_robots_description_is_refused_naming_the_field():
    for other in [
        {"robot": "panda"},
        {"joint_names": ("a", "b")},
        {"observation": "displacement_and_joints"},
        {"max_delta": 0.2},
    ]:
        with pytest.raises(ContractError, match=f"the bag is for {next(iter(other))}"):
            TASK.require_same_robot(replace(TASK, **other), "the bag")


def test_another_reward_is_the_same_robot():
    TASK.require_same_robot(replace(TASK, reward="sparse"), "the bag")


ZONES = [("box", 3), ("sphere", 1), ("cylinder", 2)]


@st.composite
def some_limits(draw, n):
    def vector(size, numbers=NUMBERS):
        return draw(st.one_of(st.just(()), st.tuples(*[numbers] * size)))

    bounds = {}
    for what, size in (("joint", n), ("tip", 3)):
        lower = vector(size)
        bounds |= {f"{what}_lower": lower, f"{what}_upper": tuple(each + draw(POSITIVE) for each in lower)}
    zones = draw(st.lists(st.sampled_from(ZONES), max_size=3))
    return Limits(
        velocity=vector(n, POSITIVE),
        acceleration=vector(n, POSITIVE),
        keep_out=tuple(Zone(shape, draw(st.tuples(*[NUMBERS] * 3)), (0.1,) * size) for shape, size in zones),
        collisions=draw(st.booleans()),
        **bounds,
    )


@given(some_limits(2))
def test_limits_survive_json(limits):
    task = replace(TASK, limits=limits)
    assert TaskDescription.from_json(task.to_json()) == task


def test_json_of_before_there_were_limits_is_read_as_having_none():
    values = asdict(TASK)
    del values["limits"]
    assert TaskDescription.from_json(json.dumps(values)) == TASK
    assert TASK.limits == NO_LIMITS


def test_limits_that_make_no_sense_are_refused():
    for limits, said in [
        ({"colour": 3}, "limits has other fields"),
        ({"velocity": [1.0]}, "velocity has 1 values; accepted: 2"),
        ({"velocity": [1.0, 0.0]}, "velocity"),
        ({"acceleration": [1.0, -1.0]}, "acceleration"),
        ({"joint_lower": [0.0, 0.0]}, "joint_lower"),
        ({"joint_lower": [0.0], "joint_upper": [1.0]}, "joint_lower has 1 values"),
        ({"tip_lower": [0.0, 0.0], "tip_upper": [1.0, 1.0]}, "tip_lower"),
        ({"tip_lower": [0.0, 0.0, 2.0], "tip_upper": [1.0, 1.0, 1.0]}, "at most tip_upper"),
        ({"collisions": 1}, "collisions 1; accepted: true or false"),
        ({"keep_out": [3]}, "keep_out"),
        ({"keep_out": [{"shape": "cone", "centre": [0, 0, 0], "size": [1]}]}, "accepted: box, sphere, cylinder"),
        ({"keep_out": [{"shape": "sphere", "centre": [0, 0], "size": [1]}]}, "centre"),
        ({"keep_out": [{"shape": "cylinder", "centre": [0, 0, 0], "size": [1]}]}, "radius, height"),
        ({"keep_out": [{"shape": "sphere", "centre": [0, 0, 0], "size": [0]}]}, "more than 0"),
    ]:
        text = json.dumps(asdict(TASK) | {"limits": asdict(NO_LIMITS) | limits})
        with pytest.raises(ContractError, match=said):
            TaskDescription.from_json(text)
