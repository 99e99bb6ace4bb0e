"""Gaps, bad messages and jumps of the clock: the rest is learned from, and the remedy that is printed keeps it."""

import shlex
import sys
from dataclasses import replace

import numpy as np
import pytest
from rled_agent.data.opening import open_demonstrations
from rled_msgs_py.bags import Bag, BagWriter, review
from rled_msgs_py.records import DeltaCommand, JointSample
from rled_teleop.cli import demos

from ..rled_msgs_py.samples import NAMES, PERIOD, descriptions, tick
from ..rled_msgs_py.test_bag_quality import event

TICKS = 200
EVERY = {"joint_states", "ee_pose", "target_pose", "task_status", "joint_delta"}


def gap(first, last, *names):
    """Entries without some topics, by default without any, from one tick up to another."""

    def spoil(found):
        gone = names or EVERY
        return [each for each in found if each[0].name not in gone or not first <= each[1].stamp // PERIOD < last]

    return spoil


def unknown(*places):
    def spoil(found):
        return [
            (topic, replace(record, position=np.array([0.0, np.nan])))
            if isinstance(record, JointSample) and record.stamp // PERIOD in places
            else (topic, record)
            for topic, record in found
        ]

    return spoil


def set_ahead(place):
    def spoil(found):
        return [
            (topic, replace(record, stamp=record.stamp + 150 * PERIOD * (record.stamp >= place * PERIOD)))
            for topic, record in found
        ]

    return spoil


def lost(*spans):
    return {k for first, last in spans for k in range(first, last)}


SPOILED = {
    "all topics at the start": (gap(15, 80), lost((15, 80))),
    "all topics in the middle": (gap(90, 120), lost((90, 120))),
    "all topics near the end": (gap(160, 190), lost((160, 190))),
    "few ticks": (gap(60, 62), lost((60, 62))),
    "joint_states": (gap(15, 80, "joint_states"), lost((15, 80))),
    "ee_pose": (gap(100, 165, "ee_pose"), lost((100, 165))),
    "target_pose at the end": (gap(130, TICKS, "target_pose"), lost((130, TICKS))),
    "task_status": (gap(20, 50, "task_status"), lost((20, 50))),
    "joint_delta": (gap(40, 90, "joint_delta"), lost((40, 90))),
    "two gaps": (lambda found: gap(30, 60)(gap(120, 150, "ee_pose")(found)), lost((30, 60), (120, 150))),
    "one joint that is not known": (unknown(70), {70}),
    "joints that are not known now and then": (unknown(20, 21, 90, 180), {20, 21, 90, 180}),
    "a clock that is set ahead": (set_ahead(100), set()),
}


def write(path, found, more=()):
    with BagWriter(path) as bag:
        for topic, record in [*descriptions(), *more, *found]:
            bag.write(topic, record)
    return path


@pytest.fixture(params=SPOILED.values(), ids=SPOILED.keys())
def spoiled(request, tmp_path):
    spoil, gone = request.param
    found = [
        (topic, replace(record, delta=np.array([0.01, 1e-4 * (record.stamp // PERIOD)])))
        if isinstance(record, DeltaCommand)
        else (topic, record)
        for k in range(TICKS)
        for topic, record in tick(k)
    ]
    return write(tmp_path / "a bag", spoil(found)), gone


def told_by(path):
    """The ticks that are learned from, known by what answers them, and what is said."""
    lines = list[str]()
    learned = open_demonstrations(path, "trajectories", 0.0, lines.append)
    return np.round(learned.answers.actions[:, 1] / 1e-4).astype(int).tolist(), lines, learned


def test_all_but_the_faulty_moments_is_learned_from_and_one_line_says_so(spoiled):
    path, gone = spoiled
    ticks, lines, learned = told_by(path)
    assert ticks == sorted(set(range(TICKS)) - gone)
    (line,) = lines
    assert line.startswith("left out: ")
    assert any(fault.what in line and fault.topics[0] in line for fault in review(Bag(path)).faults)
    assert f"{review(Bag(path)).seconds(review(Bag(path)).faults[0].first):.2f} s" in line
    is_parted = len(review(Bag(path)).timeline.moments) < TICKS and min(gone) < max(ticks)
    assert len(np.unique(learned.answers.trajectory)) >= 1 + is_parted


def test_the_remedies_leave_the_faults_out_and_keep_the_rest(spoiled, capsys, monkeypatch):
    path, gone = spoiled
    for number in range(9):
        monkeypatch.setattr(sys, "argv", ["demos", "check", str(path)])
        with pytest.raises(SystemExit) if review(Bag(path)).faults else pytest.MonkeyPatch.context():
            demos.main()
        said = capsys.readouterr().out.splitlines()[0]
        if "no faults" in said:
            break
        command = shlex.split(said.split("with: ")[1])
        path = path.with_name(f"new {number}")
        assert (command[0], command[-2:]) == ("demos", ["--output", "NEW"])
        monkeypatch.setattr(sys, "argv", [*command[:-1], str(path)])
        demos.main()
        capsys.readouterr()
    assert review(Bag(path)).faults == []
    kept = set(told_by(path)[0])
    assert kept <= set(range(TICKS)) - gone
    assert len(set(range(TICKS)) - gone - kept) <= 4  # at most the ticks beside


def test_a_gap_in_one_episode_leaves_the_others_whole(tmp_path):
    told = [event("start", 0, 0), event("stop", 0, 99), event("start", 1, 100), event("stop", 1, TICKS - 1)]
    found = gap(20, 60)([entry for k in range(TICKS) for entry in tick(k)])
    lines = list[str]()
    learned = open_demonstrations(write(tmp_path / "bag", found, told), "trajectories", 0.0, lines.append)
    assert len(learned) == TICKS - 40
    assert len(lines) == 1
    assert len(np.unique(learned.answers.trajectory)) == 3


def test_a_mark_that_is_not_known_is_left_out(tmp_path):
    from rled_msgs_py.records import PoseSample

    from rled_msgs_py import topics

    marks = []
    for k in range(5):
        q = np.array([0.1 * k, np.nan if k == 2 else 0.2])
        marks += [
            (topics.MARKED_JOINT_STATES, JointSample(k * PERIOD, NAMES, q, np.zeros(2))),
            (topics.MARKED_EE_POSE, PoseSample(k * PERIOD, "world", np.zeros(3))),
        ]
    from rled_agent.data.closed_form import demonstration_points

    path = write(tmp_path / "bag", [*marks, *(entry for k in range(5, 50) for entry in tick(k))])
    np.testing.assert_allclose(demonstration_points(Bag(path)).joints[:, 0], [0.0, 0.1, 0.3, 0.4])
