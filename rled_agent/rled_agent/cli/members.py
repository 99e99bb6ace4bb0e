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
ACCEPTED_SEEDS = "numbers and ranges, as 0-7 or 0,2,5"


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
        if not first.isdecimal() or (dash and not last.isdecimal()):
            raise RledError(f"seeds are '{text[:80]}'", ACCEPTED_SEEDS)
        numbers = range(int(first), int(last if dash else first) + 1)
        if not numbers or len(numbers) > MAX_MEMBERS:
            raise RledError(f"seeds are '{text[:80]}'", f"{ACCEPTED_SEEDS}, {MAX_MEMBERS:,} at most")
        found += numbers
    if len(set(found)) < len(found):
        raise RledError(f"seeds are '{text[:80]}'", "each once")
    return found


def _sweep(config: TrainConfig, text: str) -> list[tuple[str, str, float]]:
    """Name, value as written and value of each step of a sweep."""
    name, equals, values = text.partition("=")
    parts = [each.strip() for each in values.split(",")]
    if not equals or len(set(parts)) < len(parts):
        raise RledError(f"sweep is '{text[:80]}'", "a number of the method and its values, as phi=0,0.1,0.3")
    found = []
    for part in parts:
        try:
            value = float(part)
            changed(config.method, name, value)
        except ValueError:
            raise RledError(f"sweep {name[:80]} has '{part[:40]}'", "numbers") from None
        except ContractError as error:
            raise RledError(f"--sweep {text[:80]}: {error.what}", error.accepted) from None
        found.append((name, part, value))
    return found
