"""Steps as rows of numbers and back."""

import numpy as np
import pytest
from rled_agent.deploy.step_pipe import Numbered, from_row, row_width, to_row
from rled_agent.replay.transitions import Source, Step


@pytest.mark.parametrize("source", Source)
def test_a_step_comes_back_from_its_row(source):
    parts = np.array([1, 2, 3], np.float32), np.array([4, 5], np.float32), np.array([6, 7, 8], np.float32)
    state, action, following = parts
    step = Step(state, action, -2.5, float(source % 2), following, source, source == Source.HUMAN)
    row = to_row(Numbered(step, 41))
    assert (row.dtype, len(row)) == (np.float32, row_width(3, 2))
    back, number = from_row(row, 3)
    assert number == 41
    assert back[2:4] == step[2:4]
    assert back[5:] == step[5:]
    for name in ("observation", "action", "next_observation"):
        np.testing.assert_array_equal(getattr(back, name), getattr(step, name))


def test_a_row_is_written_to_the_pipe_in_one_piece():
    """A pipe takes 4096 bytes whole or not at all: 508 of observation and action would still do."""
    assert 4 * row_width(10, 7) < 4096
    assert 4 * row_width(250, 250) < 4096
