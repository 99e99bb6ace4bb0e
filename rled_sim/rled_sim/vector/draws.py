"""Uniform random numbers for N environments, each from a generator of its own, drawn ahead."""

from collections.abc import Sequence

import numpy as np
from rled_msgs_py.errors import RledError

from rled_sim.vector.arrays import Array, Arrays
from rled_sim.vector.stateful import Stateful

AHEAD = 512
"""Uniforms of each environment that calls may take before the pool is looked after, which waits for the device."""
MAX_SEED = 2**63 - 1


class Draws(Stateful):
    """A pool of uniforms on the device, shape (N, K), and how many of each row are taken.

    An environment's generator is the one that Gymnasium makes of its seed. It has one word for each uniform, so seed
    and count of draws are all its state.
    """

    STATE = ("seeds", "taken")

    def __init__(self, arrays: Arrays, num_envs: int, most: int, stream: Sequence[int] = ()) -> None:
        """Make a pool; without seeds, somewhere.

        Args:
            arrays: where it lies.
            num_envs: N.
            most: uniforms that one call takes of a row at most.
            stream: tells the generators from others of the same seeds.
        """
        self._arrays, self._stream = arrays, tuple(stream)
        self._kept = max(AHEAD, most)
        self._calls_ahead, self._calls = self._kept // most, 0
        self._uniforms = np.empty((num_envs, 2 * self._kept))
        self._generators = [np.random.Generator(np.random.PCG64(0))] * num_envs
        self._seeds, self._before = np.zeros((2, num_envs), np.int64)
        self._rows = arrays.array(np.arange(num_envs)[:, None] * self._uniforms.shape[1], "int64")  # (N, 1)
        self._columns = arrays.array(np.arange(most), "int64")
        self._taken = arrays.full((num_envs,), 0, "int64")
        entropy = np.random.SeedSequence().generate_state(num_envs, np.uint64) >> np.uint64(1)
        self.seed(entropy.tolist())

    def seed(self, seeds: Sequence[int | None]) -> None:
        """Begin the draws anew, where a seed is given.

        Raises:
            RledError: another number of seeds, or some that are none.
        """
        if len(seeds) != len(self._generators):
            raise RledError(f"{len(seeds)} seeds", f"{len(self._generators)}, one for each environment")
        _require_seeds(seeds)
        self._upload({row: (int(seed), 0) for row, seed in enumerate(seeds) if seed is not None})

    def state(self) -> dict[str, Array]:
        """Each environment's seed, and how many uniforms it has taken, shape (N,)."""
        array = self._arrays.array
        return {"seeds": array(self._seeds.copy(), "int64"), "taken": array(self._before, "int64") + self._taken}

    def load(self, state: dict[str, Array]) -> None:
        """Go on from a ``state``.

        Raises:
            RledError: seeds that are none.
        """
        seeds, taken = (self._arrays.host(state[name]).tolist() for name in self.STATE)
        _require_seeds(seeds)
        self._upload(dict(enumerate(zip(seeds, taken, strict=True))))

    def reserve(self) -> None:
        """A call begins: have as many uniforms as it may take."""
        if self._calls == self._calls_ahead:
            self._top_up()
        self._calls += 1

    def take(self, which: Array, count: int) -> Array:
        """The next uniforms, shape (N, count); where ``which`` does not hold they stay, and mean nothing."""
        places = self._rows + self._taken[:, None] + self._columns[:count]
        self._taken = self._taken + which * count
        return self._pool.take(places)

    def _upload(self, begun: dict[int, tuple[int, int]]) -> None:
        """Begin rows at a seed and a count of draws; the others go on."""
        taken = self._arrays.host(self._taken).copy()
        for row, (seed, before) in begun.items():
            bits = np.random.PCG64(np.random.SeedSequence([seed, *self._stream]))
            self._generators[row] = np.random.Generator(bits.advance(before))
            self._generators[row].random(out=self._uniforms[row])
            self._seeds[row], self._before[row], taken[row] = seed, before, 0
        self._taken = self._arrays.array(taken, "int64")
        self._top_up()

    def _top_up(self) -> None:
        """Draw more for each row that has less than half of its uniforms left."""
        taken = self._arrays.host(self._taken).copy()
        for row in np.flatnonzero(taken > self._kept).tolist():
            count, uniforms = int(taken[row]), self._uniforms[row]
            uniforms[:-count] = uniforms[count:].copy()
            self._generators[row].random(out=uniforms[-count:])
            self._before[row] += count
            taken[row] = 0
        self._taken, self._pool = self._arrays.array(taken, "int64"), self._arrays.array(self._uniforms)
        self._calls = 0


def _require_seeds(seeds: Sequence[int | None]) -> None:
    for seed in seeds:
        if seed is not None and not (isinstance(seed, int | np.integer) and 0 <= seed <= MAX_SEED):
            raise RledError(f"seed {seed}", f"whole numbers from 0 to {MAX_SEED}, or None")
