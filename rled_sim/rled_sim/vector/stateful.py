"""What remembers arrays between two steps."""

from typing import ClassVar

from rled_sim.vector.arrays import Array, Arrays


class Stateful:
    """Its arrays named in ``STATE``, each with the environment as leading dimension, are all that it remembers."""

    STATE: ClassVar[tuple[str, ...]]
    _arrays: Arrays

    def state(self) -> dict[str, Array]:
        """Copies of the arrays, by name."""
        return {name: self._arrays.copied(getattr(self, name)) for name in self.STATE}

    def load(self, state: dict[str, Array]) -> None:
        """Go on from a ``state``, which is kept."""
        for name in self.STATE:
            setattr(self, name, state[name])
