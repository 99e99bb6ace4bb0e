"""Sticks and buttons, the device behind them, and the mapping of kinesthetic mode; without ROS."""

import os
from collections import namedtuple
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import JointSample
from rled_teleop.operators.follower import Follower
from rled_teleop.operators.gamepad import DEAD_ZONE, Gamepad, Layout, PadState
from rled_teleop.operators.gamepad_device import AXES, BUTTONS, is_gamepad, open_pad, read_pad
from rled_teleop.operators.jog import Jog
from rled_teleop.operators.keys import Request
from rled_teleop.operators.mapping import RecordingMapping

Q = np.array([-0.8, 1.6])
LAYOUT = Layout()


@pytest.fixture
def jog(task, chain):
    return Jog(task, chain)


@pytest.fixture
def pad():
    return Gamepad(LAYOUT, joints=2, timeout=0.3)


def state(axes=(), buttons=()):
    deflections = dict(axes)
    return PadState(tuple(deflections.get(k, 0.0) for k in range(8)), tuple(k in buttons for k in range(11)))


def test_nothing_moves_without_the_deadman_button(pad, jog):
    pad.take(state({LAYOUT.x: 1.0}), 0.0)
    assert pad.delta(jog, Q, 0.0) is None
    pad.take(state({LAYOUT.x: 1.0}, {LAYOUT.deadman}), 0.0)
    assert np.abs(pad.delta(jog, Q, 0.0)).max() > 0


def test_a_silent_gamepad_counts_as_let_go(pad, jog):
    pad.take(state({LAYOUT.x: 1.0}, {LAYOUT.deadman}), 0.0)
    assert pad.delta(jog, Q, 0.29) is not None
    assert pad.delta(jog, Q, 0.3) is None


def test_the_dead_zone_is_nothing_and_beyond_it_motion_begins_at_zero():
    assert state({0: DEAD_ZONE}).axis(0) == 0.0
    assert state({0: DEAD_ZONE + 1e-6}).axis(0) == pytest.approx(0.0, abs=1e-5)
    assert state({0: -1.0}).axis(0) == -1.0
    assert state({0: -2.0}).axis(0) == -1.0
    assert state().axis(99) == state().axis(-1) == state({0: np.nan}).axis(0) == 0.0


def test_turbo_is_four_times_as_fast(pad, jog):
    moved = []
    for buttons in ({LAYOUT.deadman}, {LAYOUT.deadman, LAYOUT.turbo}):
        pad.take(state({LAYOUT.turn: 1.0}, buttons), 0.0)
        moved.append(pad.delta(jog, Q, 0.0)[0])
    np.testing.assert_allclose(moved, [0.025, 0.1])


def test_a_held_deadman_button_alone_holds_still(pad, jog):
    pad.take(state((), {LAYOUT.deadman}), 0.0)
    np.testing.assert_array_equal(pad.delta(jog, Q, 0.0), np.zeros(2))


def test_buttons_ask_once_when_pressed(pad):
    assert pad.take(state((), {LAYOUT.mark, LAYOUT.start}), 0.0) == [Request.MARK, Request.START]
    assert pad.take(state((), {LAYOUT.mark, LAYOUT.stop}), 0.1) == [Request.STOP]
    assert pad.take(state((), {LAYOUT.keep, LAYOUT.discard}), 0.2) == [Request.KEEP, Request.DISCARD]


def test_the_next_joint_is_turned_round_and_round(pad, jog):
    for expected in (1, 0):
        pad.take(state((), {LAYOUT.next_joint}), 0.0)
        pad.take(state(), 0.0)
        assert pad.joint == expected


@given(axes=st.lists(st.floats(allow_nan=True, width=32), max_size=8), buttons=st.lists(st.booleans(), max_size=11))
def test_whatever_a_gamepad_says_is_a_jog_that_the_simulation_takes(axes, buttons):
    from rled_sim.robots import robot_named
    from rled_sim.tasks import reach_task

    robot = robot_named("planar")
    jog = Jog(reach_task(robot).description, robot.chain)
    pad = Gamepad(LAYOUT, joints=2, timeout=0.3)
    pad.take(PadState(tuple(axes), tuple(buttons)), 0.0)
    delta = pad.delta(jog, np.array(robot.home), 0.0)
    assert delta is None or np.abs(delta).max() <= jog.task.max_delta


Axis = namedtuple("Axis", "value min max")


class FakeDevice:
    """What evdev shows of an Xbox gamepad: sticks of 16 bits, a hat, buttons."""

    name = "fake pad"

    def __init__(self, values=(), pressed=(), gone=False):
        self.values, self.pressed, self.gone = dict(values), pressed, gone

    def capabilities(self):
        return {1: list(BUTTONS), 3: [(code, None) for code in AXES]}

    def absinfo(self, axis_num):
        if self.gone:
            raise OSError(19, "No such device")
        if axis_num in (0x10, 0x11):
            return Axis(self.values.get(axis_num, 0), -1, 1)
        return Axis(self.values.get(axis_num, 0), -32768, 32767)

    def active_keys(self):
        return list(self.pressed)


def test_a_device_reads_like_joy():
    read = read_pad(FakeDevice({0: -32768, 1: 32767, 0x10: 1}, {BUTTONS[4]}))
    assert read.axes[0] == 1.0  # left is positive
    assert read.axes[1] == -1.0
    assert read.axes[6] == -1.0
    assert read.axes[2] == pytest.approx(0.0, abs=1e-4)
    assert [k for k, pressed in enumerate(read.buttons) if pressed] == [LAYOUT.deadman]


def test_an_unplugged_device_is_said():
    with pytest.raises(RledError, match="fake pad is gone"):
        read_pad(FakeDevice(gone=True))


def test_a_keyboard_is_no_gamepad():
    keyboard = FakeDevice()
    keyboard.capabilities = lambda: {1: [30, 31]}
    assert not is_gamepad(keyboard)
    assert is_gamepad(FakeDevice())


def test_no_gamepad_or_no_library_is_one_line():
    with pytest.raises(RledError, match=r"evdev|no gamepad"):
        open_pad("auto")


def sample(**angles):
    return JointSample(0, tuple(angles), np.array(list(angles.values())), np.zeros(len(angles)))


def test_the_mapping_is_scale_and_offset_joint_by_joint():
    text = "{shoulder: {name: a, scale: -2.0, offset: 0.5}, elbow: {name: b}}"
    mapping = RecordingMapping.from_yaml(text, ("shoulder", "elbow"))
    np.testing.assert_allclose(mapping.robot_joints(sample(b=1.0, c=9.0, a=0.25)), [0.0, 1.0])


def test_no_mapping_is_the_same_names(tmp_path):
    mapping = RecordingMapping.from_yaml("", ("shoulder", "elbow"))
    np.testing.assert_allclose(mapping.robot_joints(sample(elbow=1.0, shoulder=0.25)), [0.25, 1.0])
    (tmp_path / "map.yaml").write_text("elbow: {offset: 0.1}\n")
    mapping = RecordingMapping.from_yaml(str(tmp_path / "map.yaml"), ("shoulder", "elbow"))
    np.testing.assert_allclose(mapping.robot_joints(sample(elbow=1.0, shoulder=0.25)), [0.25, 1.1])


def test_a_wrong_mapping_is_refused():
    for text in [
        "{nose: {}}",
        "[1]",
        "{elbow: 3}",
        "{elbow: {scal: 1}}",
        "{elbow: {scale: a}}",
        "{elbow: {offset: .nan}}",
        "{",
        "gone.yaml",
    ]:
        with pytest.raises(RledError, match="the mapping"):
            RecordingMapping.from_yaml(text, ("shoulder", "elbow"))


def test_a_device_without_a_joint_is_refused():
    mapping = RecordingMapping.from_yaml("{elbow: {name: b}}", ("shoulder", "elbow"))
    with pytest.raises(RledError, match="no joint b; accepted: shoulder"):
        mapping.robot_joints(sample(shoulder=1.0))


def test_a_device_where_no_robot_can_follow_is_refused():
    mapping = RecordingMapping.from_yaml("{elbow: {scale: 2.0}}", ("shoulder", "elbow"))
    with pytest.raises(RledError, match="the device is at"):
        mapping.robot_joints(sample(shoulder=0.0, elbow=1.7e308))


def test_the_robot_follows_straight_and_holds_when_the_device_is_silent(jog):
    follower = Follower(RecordingMapping.from_yaml("", ("shoulder", "elbow")), speed=0.5, timeout=0.3)
    assert follower.delta(jog, Q, 0.0) is None
    follower.take(sample(shoulder=-0.4, elbow=1.4), 0.0)
    np.testing.assert_allclose(follower.delta(jog, Q, 0.1), [0.05, -0.025])
    np.testing.assert_allclose(follower.delta(jog, np.array([-0.4, 1.41]), 0.1), [0.0, -0.01])
    assert follower.delta(jog, Q, 0.3) is None


def test_a_mapping_file_from_elsewhere_is_refused_in_a_short_line(tmp_path):
    for content in [
        "elbow: {name: ä}".encode("latin-1"),
        "elbow: {name: b}".encode("utf-16"),
        b"\x00",
        b"[" * 30_000,
        b"a: " + b"{a: " * 30_000,
        b"x: &x [1, 1]\ny: &y [*x, *x, *x, *x]\nz: [*y, *y]",
        b"- elbow",
        b"elbow: 3",
        b"elbow: {name: [b]}",
        b"elbow: {scale: 1" + b"0" * 350 + b"}",
        b"elbow: {offset: .nan}",
        b"elbow: {scale: true}",
        b"elbow: {scale: '1.0'}",
        b"3: {name: b}",
        b"? [a]\n: b",
        b"elbow: !!python/name:os.system",
        b"a" * (5 << 20),
    ]:
        path = tmp_path / "map.yaml"
        path.write_bytes(content)
        with pytest.raises(RledError, match="the mapping") as caught:
            RecordingMapping.from_yaml(str(path), ("shoulder", "elbow"))
        assert len(str(caught.value)) < 500


@pytest.mark.parametrize("make", [lambda path: None, Path.mkdir, os.mkfifo], ids=["gone", "folder", "pipe"])
def test_a_mapping_file_that_is_none_is_named(tmp_path, make):
    path = tmp_path / "map.yaml"
    make(path)
    with pytest.raises(RledError, match=f"the mapping {path}"):
        RecordingMapping.from_yaml(str(path), ("shoulder", "elbow"))


def test_what_the_device_says_beside_its_joints_is_passed_over(jog):
    follower = Follower(RecordingMapping.from_yaml("", ("shoulder", "elbow")), speed=0.5, timeout=0.3)
    unknown = {"finger": float("nan"), "thumb": float("inf")}
    follower.take(sample(**unknown, shoulder=-0.4, elbow=1.4), 0.0)
    np.testing.assert_allclose(follower.delta(jog, Q, 0.1), [0.05, -0.025])
    follower.take(sample(**unknown), 0.1)
    np.testing.assert_allclose(follower.delta(jog, Q, 0.1), [0.05, -0.025])


def test_a_device_of_two_publishers_is_put_together(jog):
    follower = Follower(RecordingMapping.from_yaml("", ("shoulder", "elbow")), speed=0.5, timeout=0.3)
    with pytest.raises(RledError, match="no joint elbow"):
        follower.take(sample(shoulder=-0.4), 0.0)
    follower.take(sample(elbow=1.4), 0.05)
    np.testing.assert_allclose(follower.delta(jog, Q, 0.1), [0.05, -0.025])
    with pytest.raises(RledError, match="no joint elbow"):
        follower.take(sample(shoulder=-0.4), 0.36)  # the other half is silent by now
    assert follower.delta(jog, Q, 0.4) is None


def test_a_device_joint_that_is_not_known_is_named():
    follower = Follower(RecordingMapping.from_yaml("", ("shoulder", "elbow")), speed=0.5, timeout=0.3)
    with pytest.raises(RledError, match="the device is at nan with its joint elbow"):
        follower.take(sample(shoulder=0.0, elbow=float("nan"), finger=0.1), 0.0)
