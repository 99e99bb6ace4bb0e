"""``demos info``: what a bag holds, topic by topic and episode by episode."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from rled_msgs_py.bags import Bag, Review, review
from rled_msgs_py.bags.faults import LOST
from rled_msgs_py.bags.series import Floats, Series
from rled_msgs_py.bags.stamps import fallen_back
from rled_msgs_py.errors import command
from rled_msgs_py.messages import NANOSECONDS
from rled_msgs_py.topics import JOINT_DELTA

CELLS = 10
"""Cells of the coverage grid along each axis."""
FLAT = 1e-3
"""Extent below which an axis has no cells (m)."""


@dataclass(frozen=True)
class Info:
    """Say what a bag holds: topics, coverage, and the quality of each episode."""

    bag: tyro.conf.Positional[Path]
    """rosbag2 folder, .mcap or .db3 file"""
    json: bool = False
    """print JSON instead of tables"""

    def run(self) -> int:
        """Print it; returns the exit code."""
        bag = Bag(self.bag)
        described = describe(bag, review(bag))
        print(json.dumps(described, indent=2) if self.json else text_of(described))
        return 0


def describe(bag: Bag, found: Review) -> dict[str, Any]:
    """Everything that is told of a bag, as JSON takes it."""
    return {
        "bag": str(bag.path),
        "robot": bag.task.robot,
        "task": bag.task.task,
        "metadata": bag.metadata,
        "messages": bag.message_count,
        "seconds": round(found.seconds(int(found.timeline.moments[-1])), 3) if len(found.timeline.moments) else 0.0,
        "topics": [_topic(each) for each in found.series.values() if len(each.stamps)],
        "unanswered": _unanswered(found),
        "lost": sum(fault.kind == LOST for fault in found.faults),
        "faults": len(found.faults),
        "coverage": round(coverage(found.timeline.position[:, list(bag.task.axes)]), 3),
        "episodes": _episodes(found),
    }


def coverage(positions: Floats) -> float:
    """Share of the cells of the demonstrated box that were visited; positions (m), shape (k, m)."""
    if not len(positions):
        return 0.0
    lower, extent = positions.min(axis=0), np.ptp(positions, axis=0)
    wide = extent > FLAT
    if not wide.any():
        return 1.0
    cells = ((positions - lower)[:, wide] / extent[wide] * CELLS).astype(int).clip(0, CELLS - 1)
    visited: int = len(np.unique(cells, axis=0))
    return visited / float(CELLS ** int(wide.sum()))


def text_of(described: dict[str, Any]) -> str:
    """The same as tables."""
    head = "{bag}: robot {robot}, task {task}, {messages} messages, {seconds} s".format(**described)
    loss = "{unanswered} states without an answer, {lost} losses, {faults} faults".format(**described)
    more = f" (see: {command('demos', 'check', described['bag'])})" if described["faults"] else ""
    share = f"coverage: {described['coverage']:.1%} of the cells of the demonstrated box"
    tables = [_table(described[name]) for name in ("topics", "episodes") if described[name]]
    return "\n\n".join([head, tables[0] if tables else "", loss + more + "\n" + share, *tables[1:]])


def _topic(each: Series) -> dict[str, Any]:
    steps = np.diff(each.moments) / NANOSECONDS
    return {
        "topic": each.topic.name,
        "messages": len(each.stamps),
        "rate_hz": round(1.0 / float(np.median(steps)), 2) if len(steps) and np.median(steps) > 0 else 0.0,
        "longest_gap_s": round(float(steps.max(initial=0.0)), 3),
        "falls_back": int(fallen_back(each.stamps).sum()),
    }


def _unanswered(found: Review) -> int:
    """Ticks but the last without a displacement, inside episodes or not."""
    return int((~found.timeline.answered[:-1]).sum()) if len(found.series[JOINT_DELTA.name].stamps) else 0


def _episodes(found: Review) -> list[dict[str, Any]]:
    rows = []
    for episode, quality in zip(found.episodes, found.qualities, strict=True):
        rows.append(
            {
                "episode": episode.number,
                "begin_s": round(found.seconds(episode.first), 2),
                "seconds": round((episode.last - episode.first) / NANOSECONDS, 2),
                "targets": len(episode.segments),
                **{name: round(value, 3) for name, value in quality._asdict().items()},
                "kept": "yes" if episode.kept else "no",
                "operator": episode.operator,
                "outcome": episode.outcome,
            }
        )
    return rows


def _table(rows: list[dict[str, Any]]) -> str:
    """Rows under their names; columns in which nothing stands are left out."""
    names = [name for name in rows[0] if any(row[name] != "" for row in rows)]
    lines = [names, *([_cell(row[name]) for name in names] for row in rows)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(names))]
    return "\n".join("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)) for line in lines)


def _cell(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
