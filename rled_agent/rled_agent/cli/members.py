"""Several runs by one command: a seed after the other, and numbers that are swept."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from rled_msgs_py.errors import ContractError, RledError

from rled_agent.per_seed import changed
from rled_agent.training.config import TrainConfig
from rled_agent.training.run_directory import RunDirectory

MAX_MEMBERS = 4096
ACCEPTED_SEEDS = f"numbers and ranges, as 0-7 or 0,2,5, {MAX_MEMBERS:,} at most"
DIGITS = 19
"""Of a seed."""


class Member(NamedTuple):
    """One run of a population.

    Attributes:
        config: its settings.
        directory: its folder.
    """

    config: TrainConfig
    directory: RunDirectory

    def path(self, template: Path) -> Path:
        """A file that may be another for each seed: ``{seed}`` in its name is the seed."""
        return Path(str(template).replace("{seed}", str(self.config.seed)))


def members_of(config: TrainConfig, seeds: str, sweeps: Sequence[str], output: Path) -> list[Member]:
    """The runs that a command asks for.

    Args:
        config: settings of all of them.
        seeds: as ``0-7``; empty for the settings' own.
        sweeps: ``name=value,value``, each of a number of the method; every combination is made.
        output: folder; of the run, or, with seeds or sweeps, of theirs: ``phi-0.1/seed-0``.

    Raises:
        RledError: seeds or sweeps that are none, or that ask for too many runs.
    """
    swept = [_sweep(config, each) for each in sweeps]
    names = [each[0][0] for each in swept]
    if twice := [name for name in names if names.count(name) > 1]:
        raise RledError(f"{twice[0]} is swept twice", "each number once, with all of its values")
    if not seeds and not swept:
        return [Member(config, RunDirectory(output))]
    chosen = _seeds(seeds) if seeds else [config.seed]
    members = []
    for combination in itertools.product(*swept):
        settings, folder = config.method, output
        for name, text, value in combination:
            settings, folder = changed(settings, name, value), folder / f"{name}-{text}"
        for seed in chosen:
            run = replace(config, method=settings, seed=seed)
            members.append(Member(run, RunDirectory(folder / f"seed-{seed}")))
    if len(members) > MAX_MEMBERS:
        raise RledError(f"{len(members):,} runs", f"{MAX_MEMBERS:,} at most", "give fewer seeds or values")
    return members


def _seeds(text: str) -> list[int]:
    found: list[int] = []
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        ends = (first, last if dash else first)
        numbers = range(0)
        if all(each.isdecimal() and len(each) <= DIGITS for each in ends):
            numbers = range(int(ends[0]), int(ends[1]) + 1)
        if not 0 < numbers.stop - numbers.start <= MAX_MEMBERS:
            raise RledError(f"seeds are '{text[:80]}'", ACCEPTED_SEEDS)
        found += numbers
    if len(set(found)) < len(found):
        raise RledError(f"seeds are '{text[:80]}'", "each once")
    return found


def _sweep(config: TrainConfig, text: str) -> list[tuple[str, str, float]]:
    """Name, value as written and value of each step of a sweep."""
    name, equals, values = text.partition("=")
    found = [(name, part.strip(), _value(config, name, part.strip())) for part in values.split(",") if equals]
    if not found or len({value for *_, value in found}) < len(found):
        raise RledError(f"sweep is '{text[:80]}'", "a number of the method and its values, as phi=0,0.1,0.3")
    return found


def _value(config: TrainConfig, name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise RledError(f"sweep {name[:80]} has '{text[:40]}'", "numbers") from None
    try:
        replace(config, method=changed(config.method, name, value))
    except ContractError as error:
        raise RledError(f"--sweep {name[:80]}={text[:40]}: {error.what}", error.accepted) from None
    return value
