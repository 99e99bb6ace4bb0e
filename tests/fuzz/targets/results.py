"""What ``evaluate_agent`` wrote, as the figures read it; the first line names the file."""

from pathlib import Path

from rled_agent.experiments.experiment import Drawing
from rled_agent.experiments.tables import table

from ..mutators.objects import json_text

FIGURES = b'{"success": 0.9, "steps": 12.5, "path_length": 1.1, "jerk": 2.0, "violations": 0.0}'
EPISODES = b'{"reward": -1.0, "steps": 20, "targets_reached": 3, "violations": 0}'
SEEDS = {
    "evaluation.json": b'{"seen": {"expert": %s, "agent": %s}, "1 to 3 cm": {"expert": %s}}' % ((FIGURES,) * 3),
    "episodes.json": b'{"expert": %s, "agent": %s}' % (EPISODES, EPISODES),
    "motions.json": b'{"seen": {"expert": [[[0.1, 0.05, 0.01], [0.01]]]}}',
}
DRAWINGS = {
    "evaluation.json": Drawing("bands"),
    "episodes.json": Drawing("episodes", "reward", "return"),
    "motions.json": Drawing("paths", "seen"),
}


def seeds() -> list[bytes]:
    return [name.encode() + b"\n" + text for name, text in SEEDS.items()]


def mutate(data, other, rng):
    name, _, text = data.partition(b"\n")
    return name + b"\n" + json_text(text, other.partition(b"\n")[2], rng)


def read(data: bytes, folder: Path) -> None:
    head, _, text = data.partition(b"\n")
    name = head.decode(errors="replace")
    if name in SEEDS:
        (folder / name).write_bytes(text)
        table(DRAWINGS[name], {"run": [folder]})
