"""Events of the recorder in a bag, one a line, and where parts were taken out of it; the page reads events too."""

from functools import lru_cache
from pathlib import Path

from rled_msgs_py.bags import Bag, BagWriter, drop, review, trim
from rled_msgs_py.records import Text
from rled_msgs_py.topics import EPISODE_EVENTS
from rled_teleop.recording.episode_events import EpisodeEvents, Provenance
from rled_teleop.web.graph_state import GraphState

from ...rled_msgs_py.samples import PERIOD, TASK, recording
from ..mutators.texts import mutate_lines
from ..mutators.values import json_text

EVENT = {"event": "start", "episode": 0, "stamp": 0}


@lru_cache
def seeds() -> list[bytes]:
    episodes = EpisodeEvents(Provenance("keyboard", "1"))
    episodes.describe(TASK)
    told = [episodes.start(0), episodes.stop(3 * PERIOD), *episodes.judge("keep", 3 * PERIOD)]
    told += [episodes.start(4 * PERIOD), *episodes.judge("discard", 8 * PERIOD)]
    return ["\n".join(["[]", *told]).encode(), "\n".join(["[[20000000, 60000000]]", *told[:2]]).encode()]


def mutate(data, other, rng):
    parts, donors = data.split(b"\n"), other.split(b"\n")
    if rng.random() < 0.3:
        return mutate_lines(data, other, rng)
    at = rng.randrange(len(parts))
    parts[at] = json_text(parts[at], rng.choice(donors), rng).replace(b"\n", b" ")
    return b"\n".join(parts)


def read(data: bytes, folder: Path) -> None:
    cuts, *events = data.decode(errors="replace").replace("\0", "").split("\n")
    graph = GraphState()
    with BagWriter(folder / "bag", metadata={"cuts": cuts}) as bag:
        for topic, record in recording(5):
            bag.write(topic, record)
        for event in events[:20]:
            graph.on_event(event)
            bag.write(EPISODE_EVENTS, Text(event))
    found = Bag(folder / "bag")
    review(found)
    trim(found, folder / "trimmed", 0.0, 0.1, lambda _: None)
    drop(found, folder / "dropped", [0], lambda _: None)
