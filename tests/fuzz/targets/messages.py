"""Bytes on each topic of the contract: refused, or a record that travels on unchanged."""

from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from rled_msgs_py.bags.header import moved, sim_stamp
from rled_msgs_py.errors import ContractError
from rled_msgs_py.messages import decode, encode
from rled_msgs_py.records import Actor, GateCode, GateDecision, Health, Level, Text
from rled_msgs_py.tick import STATE_NAMES, TickAssembler
from rled_msgs_py.topics import DIAGNOSTICS, EPISODE_EVENTS, RECORDED, SAFETY_GATE, TARGET_REQUEST
from rled_teleop.recording.episode_events import EPISODE, REACHED, count_of

from ...rled_msgs_py.samples import PERIOD, descriptions, same, tick
from ..mutators.messages import mutate_cdr

TOPICS = [*RECORDED, DIAGNOSTICS, TARGET_REQUEST]
RECORDS = {
    **dict([*descriptions(), *tick(3)]),
    SAFETY_GATE: GateDecision(PERIOD, Level.OK, Actor.AGENT, "sure", 0.1, 0.2, "", 3, 4, GateCode(0)),
    DIAGNOSTICS: Health(PERIOD, Level.WARN, "sim", "slow", {"ticks": "3", "late": "nan"}),
    EPISODE_EVENTS: Text("{}"),
}


@lru_cache
def seeds() -> list[bytes]:
    """A byte that tells the topic, and the message."""
    return [bytes([TOPICS.index(topic)]) + encode(topic, record) for topic, record in RECORDS.items()]


def mutate(data, other, rng):
    number = rng.randbytes(1) if rng.random() < 0.05 else data[:1]
    return number + mutate_cdr(data[1:], other[1:], rng)


def read(data: bytes, _: Path) -> None:
    topic, message = TOPICS[(data or b"\0")[0] % len(TOPICS)], data[1:]
    if len(message) >= 4:  # what comes over DDS has its encapsulation
        sim_stamp(topic.name, topic.type, message)
        with suppress(ContractError):
            moved(topic.name, topic.type, message, PERIOD)
        count_of(REACHED, message), count_of(EPISODE, message)
    record = decode(topic, message)
    try:
        again = encode(topic, record)
    except ContractError as error:
        raise AssertionError(f"a record that was read cannot be written: {error}") from error
    assert same(decode(topic, again), record), "another record after a way through a message"
    if topic.name in STATE_NAMES:
        TickAssembler().add(topic.name, record)
