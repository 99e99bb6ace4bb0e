"""What is in transit in N environments, in rings over the steps that a delay can last."""

import numpy as np

from rled_sim.vector.arrays import Array, Arrays
from rled_sim.vector.stateful import Stateful

NEVER = 2**62
"""When nothing arrives."""


class Delay(Stateful):
    """Messages of which the newest that arrives counts, and what it has overtaken is lost.

    A message sent at step t of its environment lies in slot t modulo the number of slots, so that it has arrived, or
    is overtaken, before another takes its place.

    Attributes:
        now: steps so far, shape (N,).
        due: step at which the message of a slot arrives, shape (N, slots).
        messages: shape (N, slots, size).
    """

    STATE = ("now", "due", "messages")

    def __init__(self, arrays: Arrays, num_envs: int, longest: int, size: int) -> None:
        """Have nothing in transit.

        Args:
            arrays: where messages lie.
            num_envs: N.
            longest: delay of a message at most (steps).
            size: numbers of a message.
        """
        self._arrays, self._slots = arrays, longest + 1
        self._rows, self._all_slots = (arrays.array(np.arange(count), "int64") for count in (num_envs, self._slots))
        self.now = arrays.full((num_envs,), 0, "int64")
        self.due = arrays.full((num_envs, self._slots), NEVER, "int64")
        self.messages = arrays.full((num_envs, self._slots, size), 0.0)

    def clear(self, which: Array) -> None:
        """Lose all that is in transit where ``which`` holds."""
        self.due = self._arrays.chosen(which, NEVER, self.due)

    def send(self, which: Array, message: Array, steps: Array) -> None:
        """Send a message, shape (N, size), that arrives so many steps from now, where ``which`` holds."""
        slot = self.now % self._slots
        self.due[self._rows, slot] = self._arrays.chosen(which, self.now + steps, NEVER)
        self.messages[self._rows, slot] = message

    def newest(self, which: Array) -> tuple[Array, Array]:
        """One step of time where ``which`` holds: whether a message arrives, (N,), and it, (N, size)."""
        age = (self.now[:, None] - self._all_slots) % self._slots
        arrived = (self.due <= self.now[:, None]) & which[:, None]
        youngest = self._arrays.xp.amin(
            self._arrays.chosen(arrived, age, self._slots), -1
        )  # all slots where none arrives
        message = self.messages[self._rows, (self.now - youngest) % self._slots]
        self.due = self._arrays.chosen(age >= youngest[:, None], NEVER, self.due)
        self.now = self.now + which
        return youngest < self._slots, message


class DelayedRewards(Stateful):
    """Rewards that are paid when they are due, all that are due together, and all when an episode ends.

    Attributes:
        now: steps so far, shape (N,).
        owed: the sum that is due at a step, in slot step modulo the number of slots, shape (N, slots).
    """

    STATE = ("now", "owed")

    def __init__(self, arrays: Arrays, num_envs: int, longest: int) -> None:
        """Owe nothing.

        Args:
            arrays: where rewards lie.
            num_envs: N.
            longest: delay of a reward at most (steps).
        """
        self._arrays, self._slots = arrays, longest + 1
        self._rows, self._all_slots = (arrays.array(np.arange(count), "int64") for count in (num_envs, self._slots))
        self.now = arrays.full((num_envs,), 0, "int64")
        self.owed = arrays.full((num_envs, self._slots), 0.0)

    def clear(self, which: Array) -> None:
        """Owe nothing where ``which`` holds."""
        self.owed = self._arrays.chosen(which, 0.0, self.owed)

    def pay(self, which: Array, reward: Array, steps: Array, over: Array) -> Array:
        """One step of time where ``which`` holds: what is paid, shape (N,).

        Args:
            which: the environments that step, shape (N,).
            reward: to be paid so many steps from now, shape (N,).
            steps: shape (N,).
            over: all is paid at once, shape (N,).
        """
        chosen = self._arrays.chosen
        self.owed[self._rows, (self.now + steps) % self._slots] += chosen(which, reward, 0.0)
        due = (over[:, None] | (self._all_slots == (self.now % self._slots)[:, None])) & which[:, None]
        paid = chosen(due, self.owed, 0.0).cumsum(-1)[:, -1]  # unlike a sum, in the same order for every N
        self.owed = chosen(due, 0.0, self.owed)
        self.now = self.now + which
        return paid
