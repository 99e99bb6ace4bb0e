"""Bounds that many settings share, written beside the field: ``steps: Count``."""

from typing import Annotated

from rled_msgs_py.validation import Range

MANY = 10**12
Count = Annotated[int, Range(1, MANY)]
Amount = Annotated[float, Range(0, MANY)]
Share = Annotated[float, Range(0, 1)]
Seed = Annotated[int, Range(0, 2**63 - 1)]
MAX_TRANSITIONS = 10_000_000
"""Of a replay: more than a gigabyte on the Panda."""
