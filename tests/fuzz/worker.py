"""The process that reads inputs of one target; a watcher outlives it.

``guided`` lets atheris choose what is mutated by the lines that it reaches; ``drawn`` mutates seeds at random, which
needs no instrumentation and gives the same inputs every time.
"""

import argparse
import ctypes
import faulthandler
import logging
import os
import signal
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from random import Random

from . import findings
from .bounds import INPUT
from .cases import cases_of
from .judge import Growth, Judge
from .slot import Slot
from .target import Target, load

COVERED = [f"{__package__}.targets", "rled_msgs_py", "rled_sim", "rled_agent", "rled_teleop", "rosbags", "yourdfpy"]
"""Packages whose lines guide the search."""
OWN_SHARE = 0.7
"""Of the mutations; the rest is libFuzzer's own, by bytes."""
PR_SET_PDEATHSIG = 1
GREW = 88
"""Exit code of a process whose memory has grown."""
DRAWN = 0.7
"""Seconds of processor time after which nothing more is drawn."""
SHORTEST = 3.0
"""Seconds of a guided search at least, however long its start takes."""
QUIET = [f"-handle_{each}=0" for each in ("segv", "abrt", "bus", "ill", "fpe", "int", "term", "xfsz")]


def main() -> None:
    begun, options = time.monotonic(), _options()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the watcher ends this process
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    logging.disable()
    faulthandler.enable()
    faulthandler.register(signal.SIGUSR1, all_threads=False)
    warnings.simplefilter("ignore")
    target = _instrumented(options.target) if options.seconds else load(options.target)
    judge = Judge(target, options.scratch)
    look = _looker(judge, options)
    known = [] if options.replay else [case.data for case in cases_of(target.name)]
    for path in options.replay or findings.kept(options.findings, target.name):
        known.append(path.read_bytes())
    for data in known:
        look(data)
    if options.seconds:
        _guided(target, look, options, max(SHORTEST, options.seconds - (time.monotonic() - begun)))
    else:
        _drawn(target, look, options)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    parser.add_argument("target")
    parser.add_argument("--scratch", type=Path, required=True)
    parser.add_argument("--findings", type=Path, required=True)
    parser.add_argument("--corpus", type=Path)
    parser.add_argument("--seconds", type=float, default=0.0)
    parser.add_argument("--count", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--replay", type=Path, nargs="*", default=[])
    return parser.parse_args()


def _instrumented(name: str) -> Target:
    import atheris

    with atheris.instrument_imports(include=COVERED):
        return load(name)


def _looker(judge: Judge, options: argparse.Namespace) -> Callable[[bytes], None]:
    slot, found = Slot(options.scratch / "slot"), (options.scratch / "found").open("a")
    deadly = set((options.scratch / "deadly").read_text().split()) if (options.scratch / "deadly").exists() else set()

    def look(data: bytes) -> None:
        if len(data) > INPUT or (deadly and findings.digest(data) in deadly):
            return
        slot.begin(data)
        try:
            finding = judge.look(data)
        except Growth as growth:
            print(growth, file=sys.stderr, flush=True)
            os._exit(GREW)
        slot.end()
        if finding:
            path = findings.keep(options.findings, options.target, finding, data)
            print(path.name, finding.place, finding.summary, sep="\t", file=found, flush=True)

    return look


def _drawn(target: Target, look: Callable[[bytes], None], options: argparse.Namespace) -> None:
    rng, seeds = Random(f"{target.name} {options.seed}"), target.seeds()
    end = time.process_time() + DRAWN
    for _ in range(options.count):
        if time.process_time() > end:
            return
        data = rng.choice(seeds)
        for _ in range(rng.choice((1, 1, 2, 4))):
            data = target.mutate(data, rng.choice(seeds), rng)
        look(data)


def _guided(target: Target, look: Callable[[bytes], None], options: argparse.Namespace, seconds: float) -> None:
    import atheris

    seeds = list(target.seeds())
    folder = options.scratch / "seeds"
    folder.mkdir(exist_ok=True)
    for data in seeds:
        (folder / findings.digest(data)).write_bytes(data)

    def mutate(data: bytes, room: int, seed: int) -> bytes:
        rng = Random(seed)
        if rng.random() < OWN_SHARE and len(changed := target.mutate(data, rng.choice(seeds), rng)) <= room:
            return changed
        return bytes(atheris.Mutate(data, room))

    corpus = [options.corpus, folder]
    longest = min(INPUT, 4 * max(map(len, seeds)) + 4096)
    arguments = [f"-max_total_time={round(seconds)}", f"-seed={options.seed or 1}", f"-max_len={longest}"]
    arguments += [
        *QUIET,
        "-timeout=1000000",
        f"-artifact_prefix={options.scratch}/",
        "-rss_limit_mb=0",
        "-len_control=0",
        "-reload=0",
        *map(str, corpus),
    ]
    atheris.Setup([sys.argv[0], *arguments], look, custom_mutator=mutate)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
