"""Command: draw all figures and write docs/results.md from the runs that are kept."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rled_msgs_py.errors import command_line
from rled_msgs_py.files import write_whole
from rled_msgs_py.outputs import require_output

from rled_agent.experiments.archive import Archive, KeptRun
from rled_agent.experiments.experiment import Experiment, Library, Run
from rled_agent.experiments.pictures import draw
from rled_agent.experiments.reproduce import EXPERIMENTS, KEPT
from rled_agent.experiments.tables import table
from rled_agent.training.progress import Progress

RESULTS = Path("docs/results.md")
FIGURES = Path("docs/results/figures")
VERDICTS = {
    "reproduced": "reproduced",
    "partly": "partly reproduced",
    "not": "not reproduced",
    "answered": "answered",
    "open": "open",
}
HERE = "run it in the project's folder"
HEAD = """# Results

Chapter 4, figure by figure, and what stands beside it. Made by `make figures` from the runs in `results/runs`: a file
an experiment, a line of JSON a run, with its variant, seed, command, settings, versions and metrics.
`make reproduce ARGS=--anew` makes all runs again, with `FIG=4.6` those of one figure; what each one is made with stands
in `results/experiments`. Curves show the mean over seeds and one standard deviation either way, as far as any seed
went; numbers are interquartile means over seeds with 95 % bootstrap intervals.

"""


@dataclass(frozen=True)
class Options:
    """Draw the figures named and write docs/results.md; run it in the project's folder."""

    figures: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """as 4.6, or another file of docs/results/experiments; all of them by default, and then docs/results.md too"""


@command_line
def main() -> None:
    """Run the command."""
    options = tyro.cli(Options, prog="draw_figures")
    require_output(FIGURES, remedy=HERE)
    require_output(RESULTS.parent, RESULTS.name, remedy=HERE)
    library = Library(EXPERIMENTS)
    names = list(options.figures) or library.names()
    sections: list[str] = []
    summary = ["| figure | claim or question | verdict |\n|---|---|---|\n"]
    with Progress("figure", len(names)) as progress:
        for done, name in enumerate(names, start=1):
            experiment = library.read(name)
            sections.append(_section(library, experiment))
            summary.append(
                f"| [{name}](#{_anchor(experiment)}) | {experiment.claim} | {VERDICTS[experiment.verdict]} |\n"
            )
            progress.say(done, {})
    if not options.figures:
        write_whole(RESULTS, HEAD + "".join(summary) + "\n" + "\n".join(sections))
        print(f"wrote {RESULTS}")


def _heading(experiment: Experiment) -> str:
    figure = f"Figure {experiment.name}: " if experiment.name[0].isdigit() else ""
    return f"{figure}{experiment.title}"


def _anchor(experiment: Experiment) -> str:
    letters = (each for each in _heading(experiment).lower() if each.isalnum() or each in " -_")
    return "".join(letters).replace(" ", "-")


def _section(library: Library, experiment: Experiment) -> str:
    """Pictures, numbers and verdict of one experiment."""
    source = library.read(experiment.runs_of) if experiment.runs_of else experiment
    runs = source.runs()
    archived = Archive(KEPT).read(source.name)
    kept = [archived[run.name] for run in runs if run.name in archived and archived[run.name].is_of(run)]
    variants: dict[str, list[KeptRun]] = {}
    for each in kept:
        variants.setdefault(source.variants[each.name.variant].label, []).append(each)
    variants = {each.label: variants[each.label] for each in source.variants.values() if each.label in variants}
    parts = [f"## {_heading(experiment)}\n\n", f"*Claim:* {experiment.claim}\n\n"]
    parts.append(f"*Verdict:* **{VERDICTS[experiment.verdict]}**. {experiment.reason}".rstrip() + "\n\n")
    parts.append(f"*Settings:* {experiment.settings or source.settings}\n\n")
    parts.append(_effort(source, runs, kept))
    if variants and experiment.drawings:
        path = FIGURES / f"{experiment.name}.png"
        draw(path, experiment.drawings, variants, _heading(experiment))
        parts.append(f"![{_heading(experiment)}](results/figures/{path.name})\n\n")
        parts += [f"{table(drawing, variants)}\n" for drawing in experiment.drawings]
    return "".join(parts)


def _effort(source: Experiment, runs: list[Run], kept: list[KeptRun]) -> str:
    """How many runs, how long they took and where, and the command of the first one."""
    hours = sum(each.record["seconds"] for each in kept) / 3600.0
    processors = ", ".join(sorted({each.record["processor"] for each in kept})) or "nowhere yet"
    first = shlex.join(runs[0].command) if runs else ""
    return (
        f"*Runs:* {len(kept)} of {len(runs)}, {hours:.1f} processor hours ({processors}). `make reproduce "
        f"FIG={source.name} ARGS=--anew` makes them again; the first one is `{first}`.\n\n"
    )


if __name__ == "__main__":
    main()
