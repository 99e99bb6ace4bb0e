"""The pictures of an experiment, from the figures of its runs."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from rled_msgs_py.pictures import stacked

from rled_agent.experiments.archive import Runs
from rled_agent.experiments.experiment import Drawing, Kind
from rled_agent.experiments.records import read_bins, read_cloning, read_episodes, read_experts, read_traces
from rled_agent.experiments.statistics import Estimate, Floats, common, estimate

SHOWN = 8
LINE, HANDLE, LABEL = 100, 8, 40
"""Letters across a picture, what the line before a legend's text takes of them, and letters along an axis."""


def draw(path: Path, drawings: Sequence[Drawing], variants: Runs, title: str) -> None:
    """Write the drawings of an experiment as one PNG, one above the other."""
    with stacked(path, len(drawings), 8.0, 5.0) as all_axes:
        for axes, drawing in zip(all_axes, drawings, strict=True):
            DRAW[drawing.kind](axes, drawing, variants)
        all_axes[0].set_title(title, fontsize=10)


def _draw_curves(axes: Axes, drawing: Drawing, variants: Runs) -> None:
    """Mean over the seeds, and a band of one standard deviation either way, as far as any seed went."""
    for color, (label, runs) in zip(_colors(len(variants), drawing.ordered), variants.items(), strict=True):
        curves = [run.curve(drawing.metric).smoothed(drawing.window) for run in runs]
        steps, values = common([curve for curve in curves if len(curve.steps)] or curves)
        mean, spread = values.mean(axis=0), values.std(axis=0)
        axes.plot(steps, mean, color=color, label=label, linewidth=1.5)
        low, high = np.maximum(mean - spread, values.min(axis=0)), np.minimum(mean + spread, values.max(axis=0))
        axes.fill_between(steps, low, high, color=color, alpha=0.15, linewidth=0)
    if drawing.cloning:
        axes.axhline(
            float(np.mean(read_experts(drawing, variants))), color="black", linestyle="--", label=drawing.cloning
        )
    axes.set(xlabel="environment steps", ylabel=fill(drawing.label, LABEL))
    if drawing.log:
        axes.set_yscale("log")
    _legend(axes)


def _draw_cloning(axes: Axes, _: Drawing, variants: Runs) -> None:
    for color, (label, runs) in zip(_colors(len(variants)), variants.items(), strict=True):
        for k, run in enumerate(runs):
            columns = read_cloning(run)
            for name, style in (("train", "-"), ("validation", "--")):
                named = f"{label}, {'training' if name == 'train' else name}" if k == 0 else None
                axes.semilogy(columns["step"], columns[name], style, color=color, alpha=0.6, label=named)
    axes.set(xlabel="gradient step", ylabel="mean squared error $J_d$, normalised actions")
    _legend(axes)


def _draw_bands(axes: Axes, _: Drawing, variants: Runs) -> None:
    """Success of each policy by distance from the demonstrated points."""
    for color, (label, runs) in zip(_colors(len(variants)), variants.items(), strict=True):
        evaluations = [read_bins(run) for run in runs]
        bins = list(evaluations[0])
        for policy in evaluations[0][bins[0]]:
            values = [estimate([each[group][policy]["success"] for each in evaluations]) for group in bins]
            heights, errors = _bars(values)
            style, named = "o--" if policy == "expert" else "o-", policy_name(policy, label, variants)
            axes.errorbar(range(len(bins)), heights, errors, fmt=style, color=color, capsize=3, label=named)
    axes.set(xlabel="targets", ylabel="share of targets reached", ylim=(-0.02, 1.02))
    axes.set_xticks(range(len(bins)), bins)
    _legend(axes)


def _draw_episodes(axes: Axes, drawing: Drawing, variants: Runs) -> None:
    """A figure of whole episodes of the expert and of the learned policy, one line a variant."""
    for policy in ("expert", "agent"):
        values = [estimate([read_episodes(run)[policy][drawing.metric] for run in runs]) for runs in variants.values()]
        middles, errors = _bars(values)
        axes.errorbar(middles, range(len(values)), xerr=errors, fmt="o", capsize=3, label=policy)
    axes.set(xlabel=drawing.label)
    axes.set_yticks(range(len(variants)), list(variants))
    axes.invert_yaxis()
    _legend(axes)


def _bars(values: Sequence[Estimate]) -> tuple[Floats, Floats]:
    """Middles and what their intervals reach below and above them, shape (2, k)."""
    middles = np.array([each.value for each in values])
    return middles, np.abs(np.array([[each.low, each.high] for each in values]).T - middles)


def _draw_paths(axes: Axes, drawing: Drawing, variants: Runs) -> None:
    """Distance from the target over the steps of some motions of the first seed."""
    for label, runs in variants.items():
        for k, (policy, traces) in enumerate(read_traces(runs[0], drawing.metric).items()):
            for j, each in enumerate(traces[:SHOWN]):
                named = policy_name(policy, label, variants) if j == 0 else None
                axes.plot(each.distance, ".-", color=f"C{k}", linewidth=1.0, markersize=4, alpha=0.7, label=named)
    axes.set(xlabel="step", ylabel="distance from the target (m)", ylim=(0.0, None))
    _legend(axes)


def _draw_tradeoff(axes: Axes, drawing: Drawing, variants: Runs) -> None:
    """What a share of demonstrated actions buys: one point a variant, means over all of training."""
    for color, (label, runs) in zip(_colors(len(variants), drawing.ordered), variants.items(), strict=True):
        shares, values = (
            np.array([run.curve(metric).mean for run in runs]) for metric in ("demonstrated_share", drawing.metric)
        )
        axes.errorbar(
            shares.mean(), values.mean(), values.std(), shares.std(), fmt="o", color=color, capsize=3, label=label
        )
    axes.set(xlabel="share of demonstrated actions while learning", ylabel=drawing.label)
    _legend(axes)


DRAW: Mapping[Kind, Callable[[Axes, Drawing, Runs], None]] = {
    "curves": _draw_curves,
    "cloning": _draw_cloning,
    "bins": _draw_bands,
    "paths": _draw_paths,
    "tradeoff": _draw_tradeoff,
    "episodes": _draw_episodes,
}


def policy_name(policy: str, variant: str, variants: Runs) -> str:
    """What a policy of a variant is called in legends and tables."""
    if policy != "expert":
        return variant
    return policy if len(variants) == 1 else f"{variant}, {policy}"


def _colors(count: int, ordered: bool = False) -> list[Any]:
    """Distinct ones, or a scale."""
    if not ordered:
        return [f"C{k}" for k in range(count)]
    return [colormaps["viridis"](k) for k in np.linspace(0.0, 0.9, count)]


def _legend(axes: Axes) -> None:
    longest = max(map(len, axes.get_legend_handles_labels()[1]), default=0)
    columns = max(1, min(4, LINE // (longest + HANDLE)))
    axes.figure.legend(loc="outside lower center", ncols=columns, frameon=False)
