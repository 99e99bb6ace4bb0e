"""What is drawn: trail, curves, limits, the robot's links, the list of episodes."""

import json
import math
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from rled_msgs_py.bags import Bag, BagWriter
from rled_msgs_py.bags.review import review
from rled_msgs_py.records import (
    Actor,
    DeltaCommand,
    GateCode,
    GateDecision,
    Health,
    JointSample,
    Level,
    PoseSample,
    TaskStatus,
    Text,
)
from rled_msgs_py.tick import STATE_TOPICS, Tick
from rled_msgs_py.topics import EPISODE_EVENTS, JOINT_DELTA, ROBOT_DESCRIPTION, TASK_DESCRIPTION
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task
from rled_teleop.web import episode_buffer
from rled_teleop.web.curves import DECISIONS, EPISODES, Curves
from rled_teleop.web.episode_buffer import MAX_TICKS
from rled_teleop.web.episode_log import EpisodeLog
from rled_teleop.web.graph_state import MAX_REPORTS, GraphState
from rled_teleop.web.limits_view import arc, edges
from rled_teleop.web.robot import Link, load_robot, pose_of, product, quaternion
from rled_teleop.web.trail import COLOURS, MAX_PIECES, Trail

PLANAR = ROBOTS["planar"]
TASK = reach_task(PLANAR).description


def tick(k: int, x: float, episode: int = 0, step: int = 0, reward: float = 0.0, reached: int = 0) -> Tick:
    stamp = k * TASK.period
    q = np.array([x, 1.0])
    return Tick(
        JointSample(stamp, TASK.joint_names, q, np.zeros(2)),
        PoseSample(stamp, "world", np.array([x, 0.0, 0.1])),
        PoseSample(stamp, "world", np.array([1.0, 0.0, 0.1])),
        TaskStatus(stamp, episode, step, reward, reached, False, 0, False, False),
    )


def decision(k: int, actor: Actor, uncertainty: float = math.nan) -> GateDecision:
    return GateDecision(k * TASK.period, Level.OK, actor, "", uncertainty, 0.5, "qcd", 0, 0, GateCode.SURE)


def test_each_piece_of_the_trail_has_the_colour_of_who_acted() -> None:
    graph = GraphState()
    for k, actor in enumerate((Actor.AGENT, Actor.EXPERT, Actor.HUMAN)):
        graph.on_tick(tick(k, 0.1 * k), is_commanded=False)
        graph.on_decision(decision(k, actor))
    graph.on_tick(tick(3, 0.3), is_commanded=False)
    pieces = graph.pieces()
    assert pieces.points[:, :, 0] == pytest.approx(np.array([[0.0, 0.1], [0.1, 0.2], [0.2, 0.3]]))
    wanted = [COLOURS[each] for each in (Actor.AGENT, Actor.EXPERT, Actor.HUMAN)]
    assert [tuple(each) for each in pieces.colours[:, 0].tolist()] == wanted


def test_without_a_gate_a_wish_makes_the_person_the_actor() -> None:
    graph = GraphState()
    graph.on_tick(tick(0, 0.0), is_commanded=True)
    graph.on_tick(tick(1, 0.1), is_commanded=False)
    assert tuple(graph.pieces().colours[0, 0].tolist()) == COLOURS[Actor.HUMAN]


def test_the_trail_begins_anew_with_an_episode_or_a_restarted_simulation_and_is_bounded() -> None:
    trail = Trail()
    for k in range(MAX_PIECES + 50):
        trail.add(tick(k, 0.001 * k), Actor.AGENT)
    assert len(trail.pieces().points) == MAX_PIECES
    trail.add(tick(10_000, 0.0, episode=1), Actor.AGENT)
    assert trail.pieces().points.shape == (0, 2, 3)
    trail.add(tick(10_001, 0.1, episode=1), Actor.AGENT)
    trail.add(tick(0, 0.0, episode=1), Actor.AGENT)
    assert not len(trail.pieces().points)


def test_curves_sum_rewards_and_shares_of_each_ended_episode() -> None:
    curves = Curves()
    for k, (episode, reward, reached) in enumerate([(0, 0.0, 0), (0, -1.0, 0), (0, 9.0, 1), (1, 0.0, 0), (1, -2.0, 0)]):
        curves.add_tick(tick(k, 0.0, episode, k, reward, reached))
        curves.add_decision(decision(k, Actor.EXPERT if k == 1 else Actor.AGENT, 0.25))
    assert np.array(curves.episodes())[:3, 0].tolist() == [0.0, 8.0, 1.0]
    assert curves.episodes()[3] == pytest.approx([1 / 3])
    assert curves.decisions()[1].tolist() == [0.25] * 5


def test_curves_are_bounded() -> None:
    curves = Curves()
    for k in range(2 * DECISIONS):
        curves.add_tick(tick(k, 0.0, episode=k))
        curves.add_decision(decision(k, Actor.AGENT, 0.1))
    assert len(curves.episodes()[0]) == EPISODES
    assert len(curves.decisions()[0]) == DECISIONS


def test_a_box_has_twelve_edges_and_a_flat_one_four() -> None:
    box = edges(np.zeros(3), np.array([1.0, 2.0, 3.0]))
    assert box.shape == (12, 2, 3)
    assert np.linalg.norm(box[:, 1] - box[:, 0], axis=1).sum() == pytest.approx(4 * (1 + 2 + 3))
    assert edges(np.zeros(3), np.array([1.0, 2.0, 0.0])).shape == (4, 2, 3)


def test_an_arc_spans_the_limits_at_one_distance_from_its_joint() -> None:
    origin = np.eye(4)
    origin[:3, 3] = (1.0, 2.0, 3.0)
    link = Link(("a",), "j", origin, np.array([0.0, 0.0, 2.0]), False, ())
    rim = arc(link, -np.pi / 2, np.pi / 2)[1:-1, 0] - origin[:3, 3]
    assert rim[:, 2] == pytest.approx(np.zeros(len(rim)), abs=1e-6)
    assert np.ptp(np.linalg.norm(rim, axis=1)) < 1e-6
    assert arc(link, -np.pi / 2, np.pi / 2)[-2, 1] - origin[:3, 3] == pytest.approx(-rim[0], abs=1e-6)


def test_links_stand_where_the_kinematics_say() -> None:
    for name in sorted(ROBOTS):
        robot, model = ROBOTS[name], load_robot(ROBOTS[name].description)
        assert not model.missing
        assert sum(len(link.shapes) for link in model.links) >= 3
        q = np.random.default_rng(0).uniform(-1.0, 1.0, len(robot.joint_names))
        poses: dict[tuple[str, ...], tuple[np.ndarray, np.ndarray]] = {
            (): (np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
        }
        for link in model.links:
            position, turn = pose_of(link, dict(zip(robot.joint_names, q, strict=True)))
            at, about = poses[link.path[:-1]]
            w, v = about[0], about[1:]
            moved = at + position + 2 * np.cross(v, np.cross(v, position) + w * position)
            poses[link.path] = moved, product(about, turn)
        tip = next(path for path in poses if path and path[-1] == robot.tip_link)
        assert poses[tip][0] == pytest.approx(robot.chain.position(q), abs=1e-9)


def test_quaternion_of_half_a_turn_about_x() -> None:
    assert np.abs(quaternion(np.diag([1.0, -1.0, -1.0]))) == pytest.approx([0.0, 1.0, 0.0, 0.0])


def test_a_mesh_that_is_not_found_is_named_and_the_rest_is_shown(tmp_path: Path) -> None:
    urdf = PLANAR.description.replace(
        "</robot>",
        '<link name="extra"><visual><geometry><mesh filename="package://nowhere/x.obj"/></geometry></visual></link>'
        '<joint name="fix" type="fixed"><parent link="tip"/><child link="extra"/></joint></robot>',
    )
    model = load_robot(urdf)
    assert model.missing == ("package://nowhere/x.obj",)
    assert sum(len(link.shapes) for link in model.links) >= 3


def test_an_episode_is_listed_with_its_state_and_measured_when_it_has_ended() -> None:
    log = EpisodeLog()
    log.add_event("start", 0, "")
    assert log.running
    for k in range(20):
        log.add_tick(tick(k, 0.01 * k, step=k, reached=int(k == 19)))
        log.add_delta(DeltaCommand(k * TASK.period, TASK.joint_names, np.array([0.01, 0.0])))
    log.add_event("stop", 0, "reached")
    assert [each.state for each in log.entries()] == ["ended"]
    log.measure(TASK)
    (entry,) = log.entries()
    assert entry.quality is not None
    assert entry.quality.reached == 1.0
    assert entry.quality.detour == pytest.approx(1.0)
    assert entry.seconds == pytest.approx(0.38)
    log.add_event("discard", 0, "reached")
    assert [each.state for each in log.entries()] == ["discard"]


def test_an_episode_in_real_time_is_measured_as_its_bag_is(tmp_path: Path) -> None:
    log, ticks = EpisodeLog(), real_time(targets=12)
    path = tmp_path / "bag"
    with BagWriter(path) as bag:
        bag.write(TASK_DESCRIPTION, Text(TASK.to_json()))
        bag.write(ROBOT_DESCRIPTION, Text(PLANAR.description))
        for event, stamp in (("start", 0), ("stop", ticks[-1].stamp)):
            if event == "stop":
                for each in ticks:
                    log.add_tick(each)
                    for topic, record in zip(STATE_TOPICS, each, strict=True):
                        bag.write(topic, record)
                    if each.status.step % 2 == 0:
                        command = DeltaCommand(each.stamp, TASK.joint_names, np.array([0.01, 0.0]))
                        log.add_delta(command)
                        bag.write(JOINT_DELTA, command)
            log.add_event(event, 0, "")
            bag.write(EPISODE_EVENTS, Text(json.dumps({"event": event, "episode": 0, "stamp": stamp})))
    log.measure(TASK)
    (entry,), (quality,) = log.entries(), review(Bag(path)).qualities
    assert entry.quality is not None
    assert (entry.quality.reached, entry.quality.detour) == (quality.reached, quality.detour)


def real_time(targets: int) -> list[Tick]:
    """A drive in which each second tick is a hold, which repeats the step, and the last target is not reached."""
    steps = np.arange(20 * targets) // 2
    return [tick(k, 0.001 * step, 0, step, 0.0, step // 10) for k, step in enumerate(steps.tolist())]


def test_an_hour_of_one_episode_takes_some_megabytes() -> None:
    log = EpisodeLog()
    log.add_event("start", 0, "")
    tracemalloc.start()
    for k in range(5_000):
        log.add_tick(tick(k, 0.001 * k))
        log.add_delta(DeltaCommand(k * TASK.period, TASK.joint_names, np.zeros(2)))
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert taken * MAX_TICKS / 5_000 < 12e6


def test_later_ticks_than_the_most_and_other_joints_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(episode_buffer, "MAX_TICKS", 10)
    kept = episode_buffer.EpisodeBuffer()
    for k in range(20):
        strange = tick(k, 0.0)._replace(joints=JointSample(k, ("x", "y"), np.zeros(2), np.zeros(2)))
        kept.add_tick(tick(k, 0.1 * k) if k != 3 else strange)
        kept.add_delta(DeltaCommand(k * TASK.period, TASK.joint_names[::-1], np.array([0.02, 0.01])))
    line = kept.timeline(TASK.joint_names[::-1])
    assert line.moments.tolist() == [k * TASK.period for k in range(11) if k != 3]
    assert line.q[-1] == pytest.approx([1.0, 1.0])
    assert line.q[1] == pytest.approx([1.0, 0.1])
    assert line.action[0] == pytest.approx([0.02, 0.01])


def test_another_recorder_begins_the_list_anew() -> None:
    log = EpisodeLog()
    for number in (0, 1, 0):
        log.add_event("start", number, "")
    assert [each.number for each in log.entries()] == [0]


def test_an_event_that_cannot_be_read_is_left_out() -> None:
    for text in [
        "",
        "[]",
        "{}",
        '{"event": "start"}',
        '{"event": "start", "episode": "x"}',
        '{"event": "start", "episode": 1e999}',
        "[" * 100_000,
    ]:
        graph = GraphState()
        graph.on_event(text)
        assert graph.log.entries() == []


def test_reports_of_ever_more_nodes_are_not_all_kept() -> None:
    graph = GraphState()
    for number in range(2 * MAX_REPORTS):
        graph.on_health(Health(0, Level.OK, str(number), "", {}))
        graph.on_health(Health(0, Level.OK, "again and again", "", {}))
    assert graph.health("0") is None
    assert graph.health(str(2 * MAX_REPORTS - 1)) is not None
    assert graph.health("again and again") is not None


LINK = "<robot name='r'><link name='a'>{}</link></robot>"
TEXTS = {
    "nothing": "",
    "no XML": "{}",
    "no name": "<robot><link name='a'/></robot>",
    "a joint without links": "<robot name='r'><link name='a'/><joint name='j' type='fixed'/></robot>",
    "an empty geometry": LINK.format("<visual><geometry/></visual>"),
    "a mesh without a file": LINK.format("<visual><geometry><mesh/></geometry></visual>"),
    "a colour beyond white": LINK.format(
        "<visual><geometry><box size='1 1 1'/></geometry><material name='m'><color rgba='2 2 2 1'/></material></visual>"
    ),
}


def test_a_description_that_cannot_be_drawn_is_one_kind_of_error():
    for text in TEXTS.values():
        with pytest.raises(ValueError, match=r"the robot description cannot be drawn \(\w+: "):
            load_robot(text)


def test_our_robots_are_drawn():
    for robot in ROBOTS.values():
        assert not load_robot(robot.description).missing
