"""The state of one robot out of joint samples that name only some of its joints, from publishers of their own."""

from collections import deque

import numpy as np

from rled_msgs_py.records import JointSample

MAX_AGE = 100_000_000
"""Age at which the newest value of a joint is too old to stand beside a newer one of another publisher (ns)."""
KEPT = 100
"""Values kept of a joint: as many as there may be ticks that are not complete."""

Value = tuple[int, float, float]
"""Stamp (ns), angle (rad), rate (rad/s) of a joint."""


class JointMerger:
    """Puts a robot together from the newest values of its joints.

    Values of one stamp belong together. Where a joint has none at a stamp, its value is waited for, unless the joint's
    publisher has stamps of its own: then the newest one stands in, if it is not too old.

    Args:
        names: the robot's joints.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names
        self._values: dict[str, deque[Value]] = {name: deque(maxlen=KEPT) for name in names}
        self._keeps_step = dict.fromkeys(names, True)

    def add(self, sample: JointSample) -> None:
        """Take a sample; joints that are not the robot's are passed over."""
        for name, position, velocity in zip(sample.names, sample.position, sample.velocity, strict=True):
            if name in self._values:
                self._values[name].append((sample.stamp, float(position), float(velocity)))

    def clear(self) -> None:
        """Forget all values: the simulation begins anew."""
        for values in self._values.values():
            values.clear()

    def at(self, stamp: int) -> JointSample | None:
        """The robot at a stamp (ns); None as long as a joint is waited for, or is not known there."""
        found = {name: self._value(name, stamp) for name in self._names}
        if any(value is None for value in found.values()):
            return None
        values = [value for value in found.values() if value is not None]
        for name, value in zip(self._names, values, strict=True):
            self._keeps_step[name] = value[0] == stamp
        position, velocity = (np.array([value[side] for value in values]) for side in (1, 2))
        return JointSample(stamp, self._names, position, velocity) if np.isfinite(position).all() else None

    def _value(self, name: str, stamp: int) -> Value | None:
        values = self._values[name]
        if not values or (values[-1][0] < stamp and self._keeps_step[name]):  # its publisher may say it yet
            return None
        before = next((value for value in reversed(values) if value[0] <= stamp), None)
        if before is not None and (before[0] == stamp or stamp - before[0] <= MAX_AGE):
            return before
        return values[-1] if 0 <= values[-1][0] - stamp <= MAX_AGE else None
