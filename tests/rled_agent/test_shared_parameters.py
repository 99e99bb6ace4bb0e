"""Weights that pass from one process to the other through memory."""

from collections.abc import Iterator

import numpy as np
import pytest
from rled_agent.deploy.shared_parameters import SharedParameters
from rled_msgs_py.errors import RledError


@pytest.fixture
def both() -> Iterator[tuple[SharedParameters, SharedParameters]]:
    owner = SharedParameters(5)
    joined = SharedParameters(5, owner.name)
    yield owner, joined
    joined.close()
    owner.close()


def test_weights_are_handed_over_once(both):
    taker, giver = both
    held = np.zeros(5, dtype=np.float32)
    assert not taker.take(held)
    giver.put(np.arange(5, dtype=np.float32))
    assert taker.take(held)
    assert held.tolist() == [0, 1, 2, 3, 4]
    assert not taker.take(held)
    giver.put(held + 1)
    giver.put(held + 2)
    assert taker.take(held)
    assert held.tolist() == [2, 3, 4, 5, 6]
    assert not taker.take(held)


def test_a_write_in_progress_is_not_taken(both):
    taker, giver = both
    held = np.zeros(5, dtype=np.float32)
    giver.put(held)
    giver._versions[0] += 1  # what put does first
    assert not taker.take(held)
    giver._versions[1] = giver._versions[0]
    assert taker.take(held)


def test_memory_that_is_too_small_is_refused(both):
    with pytest.raises(RledError, match="too small"):
        SharedParameters(5000, both[0].name)
