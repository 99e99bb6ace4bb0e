"""The kept runs of an experiment, a line of JSON a run, as the figures read them."""

from pathlib import Path

from rled_agent.experiments.archive import Archive, KeptRun
from rled_agent.experiments.experiment import Drawing, RunName
from rled_agent.experiments.tables import table

from .. import agent
from ..mutators.values import json_text

FIGURES = {"success": 0.9, "steps": 12.5, "path_length": 1.1, "jerk": 2.0, "violations": 0.0}
EPISODES = {"reward": -1.0, "steps": 20, "targets_reached": 3, "violations": 0}
DOCUMENTS = {
    "config": {"config": {}, "git": "1"},
    "evaluation": {"seen": {"expert": FIGURES, "agent": FIGURES}, "1 to 3 cm": {"expert": FIGURES}},
    "episodes": {"expert": EPISODES, "agent": EPISODES},
    "motions": {"seen": {"expert": [[[0.1, 0.05, 0.01], [0.01]]]}},
}
DRAWINGS = (
    Drawing("bins"),
    Drawing("episodes", "reward", "return"),
    Drawing("paths", "seen"),
    Drawing("curves", "reward"),
)


def seeds() -> list[bytes]:
    import numpy as np

    tables = {"metrics": {"step": np.array([10.0, 20.0]), "reward": np.array([-1.0, -0.5])}}
    with agent.folder() as folder:
        archive = Archive(folder)
        archive.add(
            KeptRun(
                RunName("x", "a", 0),
                {"command": ["train_agent"], "seconds": 1.0, "processor": "one"},
                DOCUMENTS,
                tables,
            )
        )
        return [next(folder.iterdir()).read_bytes()]


def mutate(data, other, rng):
    return json_text(data.strip(), other.strip(), rng).replace(b"\n", b" ") + b"\n"


def read(data: bytes, folder: Path) -> None:
    (folder / "x.jsonl").write_bytes(data)
    runs = list(Archive(folder).read("x").values())
    if runs:
        for drawing in DRAWINGS:
            table(drawing, {"run": runs})
