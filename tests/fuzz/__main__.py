"""``make fuzz``: mutated inputs to every reader of what comes from elsewhere, guided by the lines that they reach."""

import argparse
import os
import signal
import sys
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from threading import Event

from .cases import add_cases, read_cases
from .findings import ROOT
from .target import names
from .watch import Job, Result, watch

SHORTEST = 5.0
"""Seconds for a target at least."""
LINE = "{:<18} {:>9} {:>8} {:>8} {:>8}"


def main() -> None:
    options = _options()
    if options.add:
        for case in add_cases(options.add):
            print(f"{case.target}/{case.name} is a case now")
        return
    stop = Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    jobs = _replays(options) if options.replay else _searches(options)
    print(LINE.format("target", "inputs", "per s", "branches", "findings"), flush=True)
    with ThreadPoolExecutor(options.jobs) as pool:
        waiting = [pool.submit(watch, job, stop) for job in jobs]
        results = [_said(each.result()) for each in as_completed(waiting)]
    sys.exit(_conclude(results, options.output, stop.is_set()))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="fuzz", description=__doc__)
    parser.add_argument("targets", nargs="*", metavar="target", help=f"of {', '.join(names())}; all by default")
    parser.add_argument("--minutes", type=float, default=5.0, help="in all (default: 5)")
    parser.add_argument("--seed", type=int, default=0, help="of what is drawn; 0 draws it too")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), help="processes at once")
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "fuzz", help="for findings and corpus")
    parser.add_argument("--replay", type=Path, nargs="+", default=[], help="read these findings or cases, nothing else")
    parser.add_argument("--add", type=Path, nargs="+", default=[], help="make these findings cases, nothing else")
    options = parser.parse_args()
    if unknown := sorted(set(options.targets) - set(names())):
        parser.error(f"there is no target {unknown[0]}; accepted: {', '.join(names())}")
    options.output = options.output.absolute()
    options.replay = [_unpacked(path, options.output / "cases") for path in options.replay]
    for path in [*options.replay, *options.add]:
        if path.absolute().parent.name not in names() or not path.is_file():
            parser.error(f"{path} is no finding; accepted: a file in a folder that is named as its target")
    return options


def _unpacked(path: Path, folder: Path) -> Path:
    """A file with a case that is named as ``TARGET/NAME``; any other path is left as it is."""
    case = next((each for each in read_cases() if f"{each.target}/{each.name}" == str(path)), None)
    if case is None:
        return path
    unpacked = folder / case.target / case.name
    unpacked.parent.mkdir(parents=True, exist_ok=True)
    unpacked.write_bytes(case.data)
    return unpacked


def _searches(options: argparse.Namespace) -> list[Job]:
    chosen = options.targets or names()
    seed = options.seed or int.from_bytes(os.urandom(4), "little") % 2**31
    share = max(SHORTEST, options.minutes * 60.0 * min(options.jobs, len(chosen)) / len(chosen))
    print(f"{len(chosen)} targets, {share:.0f} s each, {options.jobs} at once, seed {seed}", flush=True)
    return [Job(name, options.output, share, seed=seed) for name in chosen]


def _replays(options: argparse.Namespace) -> list[Job]:
    """A job for each target, which the name of a file's folder tells."""
    files = [path.absolute() for path in options.replay]
    return [
        Job(name, options.output, replay=[path for path in files if path.parent.name == name])
        for name in sorted({path.parent.name for path in files})
    ]


def _said(result: Result) -> Result:
    rate = result.inputs / max(result.seconds, 1e-9)
    print(
        LINE.format(result.target, result.inputs, f"{rate:.0f}", result.coverage or "", len(result.found)), flush=True
    )
    return result


def _conclude(results: Iterable[Result], output: Path, interrupted: bool) -> int:
    results = sorted(results, key=lambda each: each.target)
    print(f"\n{sum(each.inputs for each in results)} inputs, {sum(len(each.found) for each in results)} findings")
    for result in results:
        for name, summary in sorted(result.found.items()):
            print(f"{output / 'findings' / result.target / name}: {summary}")
        if result.failure:
            print(f"{result.target} could not be tried: {result.failure}")
    if any(result.found or result.failure for result in results):
        return 1
    return 130 if interrupted else 0


if __name__ == "__main__":
    main()
