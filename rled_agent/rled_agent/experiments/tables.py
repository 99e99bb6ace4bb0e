"""The numbers of an experiment, as Markdown tables."""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from rled_agent.experiments.archive import Runs
from rled_agent.experiments.experiment import Drawing, Kind
from rled_agent.experiments.pictures import policy_name
from rled_agent.experiments.records import read_bins, read_cloning, read_episodes, read_experts, read_traces
from rled_agent.experiments.statistics import Curve, estimate
from rled_agent.training.evaluation import Trace

NEAR = 0.15
"""Distance from a target (m) below which a motion is near to it."""


def table(drawing: Drawing, variants: Runs) -> str:
    """The numbers behind one picture, each an interquartile mean over seeds with its 95 % bootstrap interval."""
    heads, rows = TABLES[drawing.kind](drawing, variants)
    lines = [heads, ["---"] * len(heads), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _curves(drawing: Drawing, variants: Runs) -> tuple[list[str], list[list[str]]]:
    groups = {
        label: [run.curve(drawing.metric).smoothed(drawing.window) for run in runs] for label, runs in variants.items()
    }
    if drawing.cloning:  # it takes no step of the environment
        groups[drawing.cloning] = [Curve(np.zeros(1), np.array([each])) for each in read_experts(drawing, variants)]
    heads = [drawing.label, "at the end", "over all of training", "seeds"]
    rows = [
        [label, str(estimate([c.end for c in curves])), str(estimate([c.mean for c in curves])), str(len(curves))]
        for label, curves in groups.items()
    ]
    if drawing.level is not None:
        heads.append(f"steps to {drawing.level:g}, by seed")
        for row, curves in zip(rows, groups.values(), strict=True):
            row.append(", ".join(_steps(curve.first_step(drawing.level)) for curve in curves))
    return heads, rows


def _steps(count: float) -> str:
    return f"{count:,.0f}" if np.isfinite(count) else "never"


def _cloning(_: Drawing, variants: Runs) -> tuple[list[str], list[list[str]]]:
    rows = []
    for label, runs in variants.items():
        columns = [read_cloning(run) for run in runs]
        first, last = (estimate([each["validation"][at] for each in columns]) for at in (0, -1))
        rises = estimate([float(np.mean(np.diff(each["validation"]) > 0.0)) for each in columns])
        rows.append([label, str(first), str(last), str(rises), str(len(runs))])
    return ["expert", "first validation error", "last", "share of validations that rose", "seeds"], rows


def _bins(_: Drawing, variants: Runs) -> tuple[list[str], list[list[str]]]:
    rows = []
    for label, runs in variants.items():
        found = [read_bins(run) for run in runs]
        for group, policies in found[0].items():
            for policy in policies:
                metrics = [_present(each[group][policy][name] for each in found) for name in SHOWN]
                cells = [str(estimate(values)) if values else "none" for values in metrics]
                rows.append([group, policy_name(policy, label, variants), *cells, str(len(runs))])
    return ["targets", "policy", *SHOWN.values(), "seeds"], sorted(rows, key=lambda row: _rank(row[0], variants))


SHOWN: Mapping[str, str] = {
    "success": "reached",
    "steps": "steps",
    "path_length": "path over straight",
    "jerk": "jerk (m/s³)",
}


def _present(values: Iterable[float]) -> list[float]:
    return [value for value in values if np.isfinite(value)]


def _rank(group: str, variants: Runs) -> int:
    run = next(iter(variants.values()))[0]
    return list(read_bins(run)).index(group)


def _paths(drawing: Drawing, variants: Runs) -> tuple[list[str], list[list[str]]]:
    rows = []
    for label, runs in variants.items():
        found = [read_traces(run, drawing.metric) for run in runs]
        for policy in found[0]:
            near, far = zip(*(_changes(each[policy]) for each in found), strict=True)
            name = policy_name(policy, label, variants)
            rows.append([name, str(estimate(far)), str(estimate(near)), str(len(runs))])
    heads = ["policy", f"change of Δq in a step (mrad), farther than {100 * NEAR:g} cm", "nearer", "seeds"]
    return heads, rows


def _changes(traces: Sequence[Trace]) -> tuple[float, float]:
    distance = np.concatenate([np.array(each.distance[2:]) for each in traces])
    change = 1e3 * np.concatenate([np.array(each.change) for each in traces])
    return float(change[distance < NEAR].mean()), float(change[distance >= NEAR].mean())


def _tradeoff(drawing: Drawing, variants: Runs) -> tuple[list[str], list[list[str]]]:
    metrics = {
        "demonstrated_share": "demonstrated actions",
        drawing.metric: drawing.label,
        "reward": "return",
        "qcd_median": "u_t, median",
    }
    rows = []
    for label, runs in variants.items():
        values = [[run.curve(name).mean for run in runs] for name in metrics]
        rows.append([label, *(str(estimate(each)) for each in values), str(len(runs))])
    return ["means over all of training", *metrics.values(), "seeds"], rows


def _episodes(_: Drawing, variants: Runs) -> tuple[list[str], list[list[str]]]:
    columns = {
        "targets reached": ("agent", "targets_reached"),
        "steps": ("agent", "steps"),
        "violations": ("agent", "violations"),
        "targets of the expert": ("expert", "targets_reached"),
        "steps of the expert": ("expert", "steps"),
    }
    rows = []
    for label, runs in variants.items():
        found = [read_episodes(run) for run in runs]
        cells = [str(estimate([each[policy][name] for each in found])) for policy, name in columns.values()]
        rows.append([label, *cells, str(len(runs))])
    return ["means of an episode", *columns, "seeds"], rows


TABLES: Mapping[Kind, Callable[[Drawing, Runs], tuple[list[str], list[list[str]]]]] = {
    "curves": _curves,
    "cloning": _cloning,
    "bins": _bins,
    "paths": _paths,
    "tradeoff": _tradeoff,
    "episodes": _episodes,
}
