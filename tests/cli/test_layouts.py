"""Layouts for RViz, Foxglove and PlotJuggler: well-formed, and every topic, field, joint and key in them exists."""

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rled_msgs_py.records import Actor, GateCode, GateDecision, Level, TaskStatus
from rled_msgs_py.ros.convert import MESSAGE_CLASSES, qos_profile, to_msg
from rled_sim.robots import ROBOTS

from rled_msgs_py import topics

ROOT = Path(__file__).parents[2]
BRINGUP = ROOT / "ros_ws" / "src" / "rled_bringup"
RVIZ = yaml.safe_load((BRINGUP / "rviz" / "rled.rviz").read_text())["Visualization Manager"]
FOXGLOVE = json.loads((BRINGUP / "layouts" / "foxglove.json").read_text())
PLOTJUGGLER = ElementTree.parse(BRINGUP / "layouts" / "plotjuggler.xml").getroot()
TOPICS = {f"/{each.name.lstrip('/')}": each for each in vars(topics).values() if isinstance(each, topics.Topic)}
STATUS = {
    "/task_status": to_msg(TaskStatus(0, 0, 0, 0.0, 0, False, 0, False, False)),
    "/safety_gate": to_msg(
        GateDecision(0, Level.OK, Actor.AGENT, "sure", math.nan, math.nan, "none", 0, 0, GateCode.SURE)
    ),
}
JOINTS = {joint for robot in ROBOTS.values() for joint in robot.joint_names}
DISPLAYS = {
    "Grid": None,
    "MarkerArray": topics.MARKER_ARRAY,
    "Pose": topics.POSE_STAMPED,
    "RobotModel": topics.STRING,
}


def keys_of(topic: str) -> set[str]:
    return {pair.key for pair in STATUS[topic].status[0].values}


def fields_of(type_name: str, path: str) -> None:
    """Walk a path of fields through a message's definition; a slice stands for a list."""
    kind: Any = MESSAGE_CLASSES[type_name]
    for part in path.split("."):
        name = part.partition("[")[0]
        types = kind.get_fields_and_field_types()
        assert name in types, path
        found = re.fullmatch(r"(?:sequence<)?(\w+)/(\w+)>?", types[name])
        if found:
            kind = getattr(__import__(f"{found[1]}.msg", fromlist=["msg"]), found[2])


@pytest.mark.parametrize("display", RVIZ["Displays"], ids=lambda each: each["Name"])
def test_rviz_display_shows_a_topic_of_the_contract_with_a_matching_qos(display: dict[str, Any]) -> None:
    kind = display["Class"].removeprefix("rviz_default_plugins/")
    wanted = DISPLAYS[kind]
    if wanted is None:
        return
    shown = display.get("Topic", display.get("Description Topic"))
    topic = TOPICS[shown["Value"]]
    assert topic.type == wanted
    assert shown["Reliability Policy"] == "Reliable"
    if shown["Durability Policy"] == "Transient Local":
        assert topic.qos.durability == "transient_local"
    assert qos_profile(topic.qos).depth >= shown["Depth"]


def test_rviz_looks_at_the_frame_of_the_robots() -> None:
    assert RVIZ["Global Options"]["Fixed Frame"] == "world"


def panels(place: Any) -> Iterator[str]:
    if isinstance(place, str):
        yield place
    else:
        assert place["direction"] in ("row", "column")
        assert 0 < place["splitPercentage"] < 100
        yield from panels(place["first"])
        yield from panels(place["second"])


def test_foxglove_panels_are_placed_once_each() -> None:
    assert set(FOXGLOVE) == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
    assert sorted(panels(FOXGLOVE["layout"])) == sorted(FOXGLOVE["configById"])


def foxglove_paths() -> Iterator[str]:
    for config in FOXGLOVE["configById"].values():
        yield from (each["value"] for each in config.get("paths", ()))
        yield from config.get("topics", ())
        yield from filter(None, (config.get(key) for key in ("topicPath", "topicToRender")))
        yield from (layer["topic"] for layer in config.get("layers", {}).values() if "topic" in layer)


@pytest.mark.parametrize("path", sorted(set(foxglove_paths())))
def test_foxglove_path_leads_to_a_field_of_a_topic_of_the_contract(path: str) -> None:
    topic, _, field = path.partition(".")
    assert topic in TOPICS
    for key in re.findall(r'\{key=="(\w+)"\}', field):
        assert key in keys_of(topic)
    if field:
        fields_of(TOPICS[topic].type, re.sub(r"\{.*?\}", "", field))


def test_foxglove_button_calls_the_emergency_stop() -> None:
    (button,) = [each for name, each in FOXGLOVE["configById"].items() if name.startswith("CallService!")]
    assert button["serviceName"] == "/sim/estop"
    assert json.loads(button["requestPayload"]) == {"data": True}


def test_plotjuggler_layout_has_the_elements_that_it_reads() -> None:
    assert PLOTJUGGLER.tag == "root"
    tabs = PLOTJUGGLER.findall("tabbed_widget/Tab")
    assert [each.get("tab_name") for each in tabs] == [
        "panda: joints",
        "planar: joints",
        "end effector",
        "task",
        "gate",
    ]
    for splitter in PLOTJUGGLER.iter("DockSplitter"):
        sizes = [float(each) for each in splitter.get("sizes", "").split(";")]
        assert len(sizes) == int(splitter.get("count", 0)) == len(splitter.findall("DockArea"))
        assert np.sum(sizes) == pytest.approx(1.0, abs=1e-4)
    for area in PLOTJUGGLER.iter("DockArea"):
        assert [each.tag for each in area] == ["plot"]
        assert area[0].get("mode") == "TimeSeries"
        assert {each.tag for each in area[0]} == {"range", "limitY", "curve"}


@pytest.mark.parametrize("curve", sorted({each.get("name", "") for each in PLOTJUGGLER.iter("curve")}))
def test_plotjuggler_curve_is_a_series_of_a_topic_of_the_contract(curve: str) -> None:
    topic = next(each for each in TOPICS if curve.startswith(f"{each}/"))
    rest = curve.removeprefix(f"{topic}/").split("/")
    kind = TOPICS[topic].type
    if kind == topics.JOINT_STATE:  # PlotJuggler names a joint's series /topic/joint/field
        assert rest[0] in JOINTS
        assert rest[1] in ("position", "velocity")
    elif kind == topics.DIAGNOSTIC_ARRAY:  # and a status' series /topic/name/key, where no hardware_id is set
        (status,) = STATUS[topic].status
        assert (status.name, status.hardware_id) == (rest[0], "")
        assert rest[1] in keys_of(topic)
    else:
        fields_of(kind, ".".join(rest))


def test_plotjuggler_subscribes_to_topics_of_the_contract() -> None:
    assert {each.get("name") for each in PLOTJUGGLER.iter("topic")} <= set(TOPICS)


def test_recorded_bag_opens_with_the_reader_of_mcap_and_has_the_topics_of_the_layouts() -> None:
    (path,) = (ROOT / "bags").glob("planar_lemniscate/*.mcap")
    with path.open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        names = {channel.topic for channel in summary.channels.values()}
        assert {"/joint_states", "/ee_pose", "/target_pose", "/joint_delta", "/robot_description"} <= names
        schemas = {each.encoding for each in summary.schemas.values()}
        assert schemas == {"ros2msg"}
        counted = sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())
        assert counted == summary.statistics.message_count
