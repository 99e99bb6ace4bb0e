"""Records to the bytes of their messages and back, for DDS and for bags alike. No ROS in it.

Reading and writing these few types here costs half of a general serializer's time, and what lies between fields is
always zero, so equal records are equal bytes.
"""

from collections.abc import Callable, Mapping
from itertools import chain

import numpy as np

from rled_msgs_py import topics
from rled_msgs_py.cdr import CdrReader, CdrWriter
from rled_msgs_py.errors import ContractError, Unreadable
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
from rled_msgs_py.topics import DIAGNOSTIC_ARRAY, JOINT_STATE, POSE_STAMPED, STRING, Topic
from rled_msgs_py.vectors import Vector, rates_of

NANOSECONDS = 1_000_000_000
LATEST = 2**31 * NANOSECONDS
DIGITS = 18
"""Of a count, which then fits into 64 bits."""
_NONE: Vector = np.empty(0)


def encode(topic: Topic, record: Record) -> bytes:
    """The message that a record is on a topic, in plain CDR.

    Raises:
        ContractError: the record is of another kind than the topic, or its stamp is more than 32 bits of seconds.
    """
    if TYPES[type(record)] != topic.type:
        raise ContractError(f"a {type(record).__name__} for {topic.name}", f"a record of {topic.type}")
    to = CdrWriter()
    if isinstance(record, JointSample):
        _write_joints(to, record.stamp, record.names, record.position, record.velocity)
    elif isinstance(record, DeltaCommand):
        _write_joints(to, record.stamp, record.names, record.delta, _NONE)
    elif isinstance(record, PoseSample):
        _write_header(to, record.stamp, record.frame)
        to.doubles(record.position)
        to.doubles(record.orientation)
    elif isinstance(record, Text):
        to.text(record.data)
    else:
        _write_health(to, record if isinstance(record, Health) else HEALTH_OF[type(record)](record))
    return to.bytes()


def decode(topic: Topic, data: bytes) -> Record:
    """The record of a message received on a topic; bytes after the message are let pass.

    Raises:
        Unreadable: bytes that are no such message, or too many of them.
        ContractError: a wrong size, bad names, NaN or infinity, or a topic of which there are no records.
    """
    if topic.name not in FROM:
        raise ContractError(f"{topic.name} has no records", ", ".join(FROM))
    require_size(topic, data)
    return FROM[topic.name](CdrReader(data))


def require_size(topic: Topic, data: bytes) -> None:
    """Refuse a message that is larger than any on its topic; look before anything of it is read or kept.

    Raises:
        Unreadable: it is too large.
    """
    if len(data) > topic.max_bytes:
        raise Unreadable(f"a message of {len(data)} bytes", f"{topic.max_bytes} at most")


TYPES: Mapping[type, str] = {
    JointSample: JOINT_STATE,
    DeltaCommand: JOINT_STATE,
    PoseSample: POSE_STAMPED,
    GateDecision: DIAGNOSTIC_ARRAY,
    TaskStatus: DIAGNOSTIC_ARRAY,
    Health: DIAGNOSTIC_ARRAY,
    Text: STRING,
}
"""The message type of each kind of record."""


def _write_header(to: CdrWriter, stamp: int, frame: str) -> None:
    if not 0 <= stamp < LATEST:
        raise ContractError(f"stamp of {stamp} ns", f"0 to {LATEST - 1} ns")
    to.time(*divmod(int(stamp), NANOSECONDS))
    to.text(frame)


def _read_header(source: CdrReader) -> tuple[int, str]:
    seconds, nanoseconds = source.time()
    if seconds < 0 or nanoseconds >= NANOSECONDS:
        raise ContractError(f"stamp of {seconds} s and {nanoseconds} ns", "0 s or later, less than 10^9 ns")
    return seconds * NANOSECONDS + nanoseconds, source.text()


def _write_joints(to: CdrWriter, stamp: int, names: tuple[str, ...], position: Vector, velocity: Vector) -> None:
    _write_header(to, stamp, "")
    to.count(len(names))
    to.strings(names)
    for values in (position, velocity, _NONE):  # there is no effort
        to.count(len(values))
        to.doubles(values)


def _read_joints(source: CdrReader) -> tuple[int, tuple[str, ...], Vector, Vector]:
    stamp, _ = _read_header(source)
    names = source.texts()
    position, velocity, _ = (source.doubles(source.count()) for _ in range(3))
    return stamp, names, position, velocity


def _joint_sample(source: CdrReader) -> JointSample:
    stamp, names, position, velocity = _read_joints(source)
    return JointSample(stamp, names, position, rates_of(velocity, len(names)))


def _delta_command(source: CdrReader) -> DeltaCommand:
    return DeltaCommand(*_read_joints(source)[:3])


def _pose_sample(source: CdrReader) -> PoseSample:
    return PoseSample(*_read_header(source), source.doubles(3), source.doubles(4))


def _text(source: CdrReader) -> Text:
    return Text(source.text())


def _write_health(to: CdrWriter, health: Health) -> None:
    _write_header(to, health.stamp, "")
    to.count(1)
    to.octet(health.level.value)
    to.strings((health.name, health.message, ""))  # there is no hardware id
    to.count(len(health.values))
    to.strings(chain.from_iterable(health.values.items()))


def _health(source: CdrReader) -> Health:
    stamp, _ = _read_header(source)
    if (count := source.count()) != 1:
        raise ContractError(f"a diagnostic array of {count} statuses", "one status")
    level = source.octet()
    if level not in (0, 1, 2):
        raise ContractError(f"diagnostic level {level}", "0 (OK), 1 (WARN), 2 (ERROR)")
    name, message, _ = source.strings(3)
    values = source.strings(2 * source.members())
    return Health(stamp, Level(level), name, message, dict(zip(values[::2], values[1::2], strict=True)))


def _health_of_decision(decision: GateDecision) -> Health:
    """Message "actor: reason", metrics as key-values."""
    values = {
        "uncertainty": repr(float(decision.uncertainty)),
        "threshold": repr(float(decision.threshold)),
        "measure": decision.measure,
        "episode": str(decision.episode),
        "step": str(decision.step),
        "code": str(decision.code.value),
    }
    message = f"{decision.actor.value}: {decision.reason}"
    return Health(decision.stamp, decision.level, "safety_gate", message, values)


def _decision_of(health: Health) -> GateDecision:
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


def _health_of_status(status: TaskStatus) -> Health:
    """Level WARN in a risky state, and where a displacement was refused."""
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
    return Health(status.stamp, level, "task", message, values)


def _status_of(health: Health) -> TaskStatus:
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
    if not (text.isascii() and text.isdigit() and len(text) <= DIGITS):
        raise ContractError(f"'{text}' in a status", f"a count of {DIGITS} digits at most")
    return int(text)


def _flag(text: str) -> bool:
    if text not in ("0", "1"):
        raise ContractError(f"'{text}' in a status", "0 or 1")
    return text == "1"


HEALTH_OF: Mapping[type, Callable[..., Health]] = {GateDecision: _health_of_decision, TaskStatus: _health_of_status}
"""What of a record is said in the words of diagnostic_msgs."""


def _decision(source: CdrReader) -> GateDecision:
    return _decision_of(_health(source))


def _status(source: CdrReader) -> TaskStatus:
    return _status_of(_health(source))


FROM: Mapping[str, Callable[[CdrReader], Record]] = {
    topics.JOINT_STATES.name: _joint_sample,
    topics.EE_POSE.name: _pose_sample,
    topics.TARGET_POSE.name: _pose_sample,
    topics.TASK_STATUS.name: _status,
    topics.JOINT_DELTA.name: _delta_command,
    topics.HUMAN_JOINT_DELTA.name: _delta_command,
    topics.TARGET_REQUEST.name: _pose_sample,
    topics.SAFETY_GATE.name: _decision,
    topics.MARKED_JOINT_STATES.name: _joint_sample,
    topics.MARKED_EE_POSE.name: _pose_sample,
    topics.ROBOT_DESCRIPTION.name: _text,
    topics.TASK_DESCRIPTION.name: _text,
    topics.EPISODE_EVENTS.name: _text,
    topics.DIAGNOSTICS.name: _health,
}
"""How to read a message, by the relative name of its topic."""
