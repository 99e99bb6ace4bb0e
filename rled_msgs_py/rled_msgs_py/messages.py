"""Records to messages and back, for any set of message classes with ROS field names.

rclpy's generated classes and those of a bag library differ in type only, so one pair of functions per
record serves both: ``to_msg`` builds with the classes it is given, ``from_msg`` reads attributes.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from rled_msgs_py import topics
from rled_msgs_py.errors import ContractError
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
    Vector,
)

NANOSECONDS = 1_000_000_000
LATEST = 2**31 * NANOSECONDS


class MessageTypes(NamedTuple):
    """The message classes that records are built with; ``array`` and ``octet`` make the field values they take."""

    Time: Any
    Header: Any
    JointState: Any
    Point: Any
    Quaternion: Any
    Pose: Any
    PoseStamped: Any
    KeyValue: Any
    DiagnosticStatus: Any
    DiagnosticArray: Any
    String: Any
    array: Callable[[Vector], Any]
    octet: Callable[[int], Any]


def stamp_to_msg(stamp: int, types: MessageTypes) -> Any:
    """builtin_interfaces/Time of a stamp in ns.

    Raises:
        ContractError: before zero, or later than its 32 bits can say.
    """
    if not 0 <= stamp < LATEST:
        raise ContractError(f"stamp of {stamp} ns", f"0 to {LATEST - 1} ns")
    return types.Time(sec=int(stamp // NANOSECONDS), nanosec=int(stamp % NANOSECONDS))


def stamp_from_msg(time: Any) -> int:
    """Nanoseconds of a builtin_interfaces/Time.

    Raises:
        ContractError: before zero, or a second or more in the nanoseconds.
    """
    if time.sec < 0 or time.nanosec >= NANOSECONDS:
        raise ContractError(f"stamp of {time.sec} s and {time.nanosec} ns", "0 s or later, less than 10^9 ns")
    return int(time.sec) * NANOSECONDS + int(time.nanosec)


def _header(stamp: int, frame: str, types: MessageTypes) -> Any:
    return types.Header(stamp=stamp_to_msg(stamp, types), frame_id=frame)


def _joint_state(
    stamp: int, names: tuple[str, ...], position: Vector, velocity: Vector | None, types: MessageTypes
) -> Any:
    return types.JointState(
        header=_header(stamp, "", types),
        name=list(names),
        position=types.array(position),
        velocity=types.array(_EMPTY if velocity is None else velocity),
        effort=types.array(_EMPTY),
    )


def joint_sample_to_msg(sample: JointSample, types: MessageTypes) -> Any:
    """sensor_msgs/JointState with position and velocity."""
    return _joint_state(sample.stamp, sample.names, sample.position, sample.velocity, types)


def joint_sample_from_msg(msg: Any) -> JointSample:
    """Read a sensor_msgs/JointState; a driver that leaves ``velocity`` empty means zero."""
    names = tuple(msg.name)
    velocity = msg.velocity if len(msg.velocity) else np.zeros(len(names))
    return JointSample(stamp_from_msg(msg.header.stamp), names, msg.position, velocity)


def delta_command_to_msg(command: DeltaCommand, types: MessageTypes) -> Any:
    """sensor_msgs/JointState whose ``position`` is Δq (rad)."""
    return _joint_state(command.stamp, command.names, command.delta, None, types)


def delta_command_from_msg(msg: Any) -> DeltaCommand:
    """Read a sensor_msgs/JointState whose ``position`` is Δq (rad)."""
    return DeltaCommand(stamp_from_msg(msg.header.stamp), tuple(msg.name), msg.position)


def pose_sample_to_msg(sample: PoseSample, types: MessageTypes) -> Any:
    """geometry_msgs/PoseStamped."""
    px, py, pz = sample.position.tolist()
    qx, qy, qz, qw = sample.orientation.tolist()
    pose = types.Pose(position=types.Point(x=px, y=py, z=pz), orientation=types.Quaternion(x=qx, y=qy, z=qz, w=qw))
    return types.PoseStamped(header=_header(sample.stamp, sample.frame, types), pose=pose)


def pose_sample_from_msg(msg: Any) -> PoseSample:
    """Read a geometry_msgs/PoseStamped."""
    p, q = msg.pose.position, msg.pose.orientation
    stamp = stamp_from_msg(msg.header.stamp)
    return PoseSample(stamp, msg.header.frame_id, np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w]))


def _diagnostic(health: Health, types: MessageTypes) -> Any:
    status = types.DiagnosticStatus(
        level=types.octet(health.level.value),
        name=health.name,
        message=health.message,
        hardware_id="",
        values=[types.KeyValue(key=key, value=value) for key, value in health.values.items()],
    )
    return types.DiagnosticArray(header=_header(health.stamp, "", types), status=[status])


def health_to_msg(health: Health, types: MessageTypes) -> Any:
    """diagnostic_msgs/DiagnosticArray with one status."""
    return _diagnostic(health, types)


def health_from_msg(msg: Any) -> Health:
    """Read a diagnostic_msgs/DiagnosticArray that holds one status."""
    if len(msg.status) != 1:
        raise ContractError(f"a diagnostic array of {len(msg.status)} statuses", "one status")
    status = msg.status[0]
    level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
    if level not in (0, 1, 2):
        raise ContractError(f"diagnostic level {level}", "0 (OK), 1 (WARN), 2 (ERROR)")
    values = {pair.key: pair.value for pair in status.values}
    return Health(stamp_from_msg(msg.header.stamp), Level(level), status.name, status.message, values)


def gate_decision_to_msg(decision: GateDecision, types: MessageTypes) -> Any:
    """diagnostic_msgs/DiagnosticArray: message "actor: reason", figures as key-values."""
    values = {
        "uncertainty": repr(float(decision.uncertainty)),
        "threshold": repr(float(decision.threshold)),
        "measure": decision.measure,
        "episode": str(decision.episode),
        "step": str(decision.step),
        "code": str(decision.code.value),
    }
    message = f"{decision.actor.value}: {decision.reason}"
    return _diagnostic(Health(decision.stamp, decision.level, "safety_gate", message, values), types)


def gate_decision_from_msg(msg: Any) -> GateDecision:
    """Read a decision off ``safety_gate``."""
    health = health_from_msg(msg)
    actor, colon, reason = health.message.partition(": ")
    if not colon or actor not in {each.value for each in Actor}:
        raise ContractError(f"gate message '{health.message}'", "agent|expert|human|hold: reason")
    values = _values(health, "uncertainty", "threshold", "measure", "episode", "step", "code")
    code = _count(values[5])
    if code not in set(GateCode):
        raise ContractError(f"gate code {code}", f"0 to {max(GateCode).value}")
    return GateDecision(
        health.stamp,
        health.level,
        Actor(actor),
        reason,
        _number(values[0]),
        _number(values[1]),
        values[2],
        _count(values[3]),
        _count(values[4]),
        GateCode(code),
    )


def task_status_to_msg(status: TaskStatus, types: MessageTypes) -> Any:
    """diagnostic_msgs/DiagnosticArray; level WARN in a risky state, and where a displacement was refused."""
    values = {
        "episode": str(status.episode),
        "step": str(status.step),
        "reward": repr(float(status.reward)),
        "targets_reached": str(status.targets_reached),
        "risky": str(int(status.risky)),
        "violations": str(status.violations),
        "terminated": str(int(status.terminated)),
        "truncated": str(int(status.truncated)),
    }
    said = ["risky state"] if status.risky else []
    if status.refused:
        values["refused"] = status.refused
        said.append(f"refused: {status.refused}")
    level, message = (Level.WARN, ", ".join(said)) if said else (Level.OK, "ok")
    return _diagnostic(Health(status.stamp, level, "task", message, values), types)


def task_status_from_msg(msg: Any) -> TaskStatus:
    """Read the status off ``task_status``."""
    health = health_from_msg(msg)
    keys = ("episode", "step", "reward", "targets_reached", "risky", "violations", "terminated", "truncated")
    episode, step, reward, reached, risky, violations, terminated, truncated = _values(health, *keys)
    return TaskStatus(
        health.stamp,
        _count(episode),
        _count(step),
        _number(reward),
        _count(reached),
        _flag(risky),
        _count(violations),
        _flag(terminated),
        _flag(truncated),
        health.values.get("refused", ""),
    )


def text_to_msg(text: Text, types: MessageTypes) -> Any:
    """std_msgs/String."""
    return types.String(data=text.data)


def text_from_msg(msg: Any) -> Text:
    """Read a std_msgs/String."""
    return Text(msg.data)


def _values(health: Health, *keys: str) -> list[str]:
    missing = [key for key in keys if key not in health.values]
    if missing:
        raise ContractError(f"'{health.name}' lacks {', '.join(missing)}", ", ".join(keys))
    return [health.values[key] for key in keys]


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ContractError(f"'{text}' in a status", "a number") from None


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit()):
        raise ContractError(f"'{text}' in a status", "a count, 0 or more")
    return int(text)


def _flag(text: str) -> bool:
    if text not in ("0", "1"):
        raise ContractError(f"'{text}' in a status", "0 or 1")
    return text == "1"


_EMPTY: Vector = np.empty(0)

TO_MSG: Mapping[type, Callable[[Any, MessageTypes], Any]] = {
    JointSample: joint_sample_to_msg,
    PoseSample: pose_sample_to_msg,
    DeltaCommand: delta_command_to_msg,
    GateDecision: gate_decision_to_msg,
    TaskStatus: task_status_to_msg,
    Text: text_to_msg,
    Health: health_to_msg,
}

FROM_MSG: Mapping[str, Callable[[Any], Record]] = {
    topics.JOINT_STATES.name: joint_sample_from_msg,
    topics.EE_POSE.name: pose_sample_from_msg,
    topics.TARGET_POSE.name: pose_sample_from_msg,
    topics.TASK_STATUS.name: task_status_from_msg,
    topics.JOINT_DELTA.name: delta_command_from_msg,
    topics.HUMAN_JOINT_DELTA.name: delta_command_from_msg,
    topics.SAFETY_GATE.name: gate_decision_from_msg,
    topics.MARKED_JOINT_STATES.name: joint_sample_from_msg,
    topics.MARKED_EE_POSE.name: pose_sample_from_msg,
    topics.ROBOT_DESCRIPTION.name: text_from_msg,
    topics.TASK_DESCRIPTION.name: text_from_msg,
    topics.EPISODE_EVENTS.name: text_from_msg,
    topics.DIAGNOSTICS.name: health_from_msg,
}
"""How to read a message, by the relative name of its topic."""
