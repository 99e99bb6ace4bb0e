"""The policy of a running graph, read back and held against what its nodes are known to do."""

import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rled_msgs_py.processes import program
from rled_msgs_py.ros.security_policy import Rights, policy


def allowed(profile: ElementTree.Element, kind: str, verb: str) -> set[str]:
    return {each.text or "" for each in profile.findall(f"{kind}s[@{verb}='ALLOW']/{kind}")}


def test_a_policy_allows_what_was_seen_and_nothing_else() -> None:
    one = Rights("/left", "sim", frozenset({"/b", "/a"}), frozenset(), frozenset({"/left/sim/reset"}), frozenset())
    root = ElementTree.fromstring(policy([one]))
    assert (root.tag, root.attrib) == ("policy", {"version": "0.2.0"})
    (enclave,) = root.findall("enclaves/enclave")
    assert enclave.attrib == {"path": "/left/sim"}
    (profile,) = enclave.findall("profiles/profile")
    assert profile.attrib == {"ns": "/left", "node": "sim"}
    assert [(each.tag, each.attrib) for each in profile] == [
        ("topics", {"publish": "ALLOW"}),
        ("services", {"reply": "ALLOW"}),
    ]
    assert [each.text for each in profile.iter("topic")] == ["/a", "/b"]


@pytest.mark.usefixtures("children")
def test_the_policy_of_a_running_graph_names_its_nodes_topics_and_services(tmp_path: Path) -> None:
    path = tmp_path / "policy.xml"
    command = [*program("rled_msgs_py", "security_policy"), str(path), "--seconds", "4"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    profiles = {each.attrib["node"]: each for each in ElementTree.parse(path).getroot().iter("profile")}
    assert set(profiles) == {"sim", "observer"}
    assert {"/joint_states", "/task_status", "/clock", "/diagnostics"} <= allowed(profiles["sim"], "topic", "publish")
    assert "/joint_delta" in allowed(profiles["sim"], "topic", "subscribe")
    assert {"/sim/reset", "/sim/estop"} <= allowed(profiles["sim"], "service", "reply")
    assert "/joint_delta" not in allowed(profiles["sim"], "topic", "publish")
    assert "/joint_states" in allowed(profiles["observer"], "topic", "subscribe")


def test_without_a_graph_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    command = [*program("rled_msgs_py", "security_policy"), str(tmp_path / "policy.xml"), "--seconds", "0.5"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "no node was seen" in done.stderr
    assert not list(tmp_path.iterdir())
