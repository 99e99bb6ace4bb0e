"""Parameters of the recorder and of what it starts."""

from dataclasses import dataclass

from rled_msgs_py.errors import RledError
from rled_msgs_py.params import param
from rled_msgs_py.topics import CLOCK_TOPIC, DIAGNOSTICS, MARKERS, Topic

EXTRA = {topic.name: topic for topic in (MARKERS, DIAGNOSTICS, CLOCK_TOPIC)}


@dataclass(frozen=True)
class RecordParams:
    """Parameters of the recorder and of what it starts."""

    output: str = param("", "folder of the bag", read_only=True)
    overwrite: bool = param(False, "replace the bag if there is one", read_only=True)
    topics: str = param("", f"more topics, separated by commas: {', '.join(EXTRA)}", read_only=True)
    operator: str = param(
        "none",
        "start a simulation and this operator, record till it ends",
        choices=("none", "scripted"),
        read_only=True,
    )
    operator_name: str = param("", "who demonstrates, said with each episode; empty: the operator", read_only=True)
    paused: bool = param(False, "begin no episode before ~/record asks for it", read_only=True)
    robot: str = param("panda", "robot to simulate", read_only=True)
    points: int = param(0, "points of the target curve to mark (ζᵃ); 0: all", low=0, high=100_000, read_only=True)
    trajectories: int = param(50, "targets to reach after that (ζᵇ)", low=0, high=1_000_000, read_only=True)
    seed: int = param(0, "seed of simulation and operator", low=0, high=2**31 - 1, read_only=True)
    operator_options: str = param("", 'more options of the operator, as typed: "--tremor 0.1"', read_only=True)
    sim_options: str = param("", 'more options of the simulation, as typed: "--gui"', read_only=True)


def extra_topics(names: str) -> tuple[Topic, ...]:
    """The topics of a list of names separated by commas.

    Raises:
        RledError: one is unknown.
    """
    given = [name.strip() for name in names.split(",") if name.strip()]
    for name in given:
        if name not in EXTRA:
            raise RledError(f"unknown topic '{name}'", ", ".join(EXTRA))
    return tuple(EXTRA[name] for name in given)
