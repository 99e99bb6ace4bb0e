"""Measure: SIGKILL a recorder of five topics at 1 kHz at random moments; see what each bag has lost.

    python tests/recording/kills.py --kills 200

Every bag is repaired once and read by this project's reader, by mcap's and by rosbags'. A message counts as lost when
it was published, or received by the recorder, before the kill and is not in the bag. What is printed is how long before
the kill the first lost one was.
"""

import argparse
import json
import os
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from load import FIVE, PERIOD, shared, start_publishing
from mcap.reader import make_reader
from rled_msgs_py.bags import Bag, repair
from rled_msgs_py.bags.header import stamp_of
from rled_msgs_py.ros.node import run_node
from rled_teleop.nodes.record_demos import record
from rled_teleop.nodes.recorder import Recorder
from rled_teleop.recording.params import RecordParams
from rosbags.rosbag2 import Reader

LIMIT = 0.050
WAIT_TIMEOUT = 30.0
MAX_MESSAGES = 3_600_000


class Loss(NamedTuple):
    """What one kill has cost.

    Attributes:
        since_published: from the publication of the first lost message after the last kept one to the kill (s).
        since_received: from the reception of the first lost message to the kill (s).
        since_handled: the same without the message that the recorder had in hand (s).
        silence: from the last reception of any message to the kill (s): a recorder that got no processor time.
        not_delivered: messages between kept ones that the recorder never received: lost by DDS.
    """

    since_published: float
    since_received: float
    since_handled: float
    silence: float
    not_delivered: int


def record_until_killed(bag: Path, received: np.ndarray) -> int:
    """Fork a recorder that notes when it received each message, shape (5, k); return its process id."""

    class Probe(Recorder):
        def _received(self, topic: Any, data: bytes) -> None:
            if topic in FIVE:
                received[FIVE.index(topic), (stamp_of(topic.type, data) or 0) // PERIOD] = time.monotonic()
            super()._received(topic, data)

    child = os.fork()
    if child == 0:
        try:
            sys.argv = ["record_demos", "--output", str(bag)]
            run_node(Probe, RecordParams, "record_demos", "", record)
        finally:
            os._exit(1)  # only a kill ends it
    return child


def contents(bag: Path) -> dict[str, list[bytes]]:
    """Messages of the five topics, on which all three readers must agree."""
    ours, mcap, rosbags = ({f"/{topic.name}": list[bytes]() for topic in FIVE} for _ in range(3))
    with (bag / f"{bag.name}_0.mcap").open("rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False):
            mcap.get(channel.topic, []).append(message.data)
    with Reader(bag) as reader:
        for connection, _, data in reader.messages():
            rosbags.get(connection.topic, []).append(data)
    read = Bag(bag)
    for topic in FIVE:
        ours[f"/{topic.name}"] = mcap[f"/{topic.name}"]
        stamps = [record.stamp for record in read.records(topic)]  # type: ignore[union-attr]
        assert stamps == [stamp_of(topic.type, data) for data in mcap[f"/{topic.name}"]], f"{bag}: readers differ"
    assert ours == rosbags, f"{bag}: rosbags reads something else"
    return ours


def loss_of(bag: Path, killed: float, published: np.ndarray, received: np.ndarray) -> Loss:
    """What of the messages published and received before the kill is not in the bag."""
    messages, sent_lost, came_lost, handled_lost, gaps = contents(bag), 0.0, 0.0, 0.0, 0
    newest = float(received[received < killed].max())
    joined = int(np.flatnonzero(received[-1])[0])  # what was published before comes from the latched topics' history
    numbers_of = [
        np.array([stamp_of(topic.type, data) for data in messages[f"/{topic.name}"]], dtype=np.int64) // PERIOD
        for topic in FIVE
    ]
    begin = max((min(numbers) for numbers in numbers_of if len(numbers)), default=0)  # the first tick that is whole
    for row, numbers in enumerate(numbers_of):
        in_bag = np.isin(np.arange(len(published)), numbers)
        last = max(joined, *numbers) if len(numbers) else joined
        belongs = (received[row] > 0) & (received[row] < killed) & (np.arange(len(published)) >= begin)
        came = received[row][belongs & ~in_bag]
        if len(came) and max(killed - came) > LIMIT:
            missing = np.flatnonzero(belongs & ~in_bag)
            print(f"{FIVE[row].name}: lost {missing[:5]} of {len(missing)}, bag {min(numbers, default=-1)} to {last}")
        sent = published[last + 1 :][(published[last + 1 :] > 0) & (published[last + 1 :] < killed)]
        came_lost = max(came_lost, *(killed - came)) if len(came) else came_lost
        handled = came[came < newest]
        handled_lost = max(handled_lost, *(killed - handled)) if len(handled) else handled_lost
        sent_lost = max(sent_lost, *(killed - sent)) if len(sent) else sent_lost
        gaps += int((~in_bag[joined + 1 : last]).sum())
    return Loss(float(sent_lost), float(came_lost), float(handled_lost), killed - newest, gaps)


def kill_one(bag: Path, after: float, published: np.ndarray) -> Loss | None:
    """Record, kill ``after`` seconds of recording, repair, read; None when the recorder has not joined the graph."""
    received = shared(len(FIVE), len(published))
    child = record_until_killed(bag, received)
    deadline = time.monotonic() + WAIT_TIMEOUT
    while not received[-1].any():
        if time.monotonic() > deadline:
            end(child)
            return None
        time.sleep(0.005)
    time.sleep(after)
    killed = time.monotonic()
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    lost = repair(bag).lost
    assert len(lost) <= 1, f"{bag}: {lost}"
    return loss_of(bag, killed, published, received)


def measure(kills: int, seed: int) -> dict[str, Any]:
    """Kill recorders one after another."""
    generator, losses = np.random.default_rng(seed), list[Loss]()
    published = shared(MAX_MESSAGES)
    load = start_publishing(published)
    try:
        while len(losses) < kills:
            began = time.monotonic()
            with tempfile.TemporaryDirectory() as folder:
                loss = kill_one(Path(folder) / "bag", generator.uniform(0.05, 1.0), published)
            if loss is None:
                print("a recorder did not join the graph in time; not counted, a new publisher is started", flush=True)
                end(load)
                published = shared(MAX_MESSAGES)
                load = start_publishing(published)
                continue
            losses.append(loss)
            took = time.monotonic() - began
            print(f"kill {len(losses)} ({took:.1f} s, load {os.getloadavg()[0]:.0f}): {loss}", flush=True)
    finally:
        end(load)
    return summary(losses)


def end(process: int) -> None:
    """Kill a child process."""
    os.kill(process, signal.SIGKILL)
    os.waitpid(process, 0)


def summary(losses: list[Loss]) -> dict[str, Any]:
    """Figures in ms."""
    table = 1e3 * np.array([each[:4] for each in losses])  # (kills, 4)
    figures: dict[str, Any] = {"kills": len(table), "readable_bags": len(table), "load_average": os.getloadavg()[0]}
    figures["not_delivered"] = sum(each.not_delivered for each in losses)
    for name, column in zip(Loss._fields[:4], table.T, strict=True):
        figures[name] = {
            "median_ms": round(float(np.median(column)), 1),
            "p99_ms": round(float(np.quantile(column, 0.99)), 1),
            "worst_ms": round(float(column.max()), 1),
            "beyond_50_ms": int((column > 1e3 * LIMIT).sum()),
        }
    return figures


def main() -> None:
    """Measure and print; exits with 1 when a bag missed more than 50 ms of what was received."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    figures = measure(options.kills, options.seed)
    print(json.dumps(figures, indent=2))
    sys.exit(1 if figures["since_received"]["beyond_50_ms"] else 0)


if __name__ == "__main__":
    main()
