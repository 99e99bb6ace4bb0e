"""What an environment takes for an action."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.errors import RledError
from rled_sim.action import action_array

NUMBERS = st.floats(allow_nan=False, allow_infinity=False, width=32)
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary() | st.complex_numbers(),
    lambda part: st.lists(part, max_size=4) | st.dictionaries(st.text(), part, max_size=2),
    max_leaves=9,
)


@given(st.lists(NUMBERS, min_size=2, max_size=2))
def test_whatever_numpy_makes_an_array_of_is_taken_number_by_number(numbers):
    for made in (list, tuple, np.array, lambda each: np.array(each, np.float32)):
        assert action_array(made(numbers), 2).tolist() == numbers
    assert action_array([3, -4], 2).tolist() == [3.0, -4.0]


@given(ANYTHING)
def test_everything_else_is_one_clear_error(action):
    said = None
    try:
        taken = action_array(action, 3)
    except RledError as error:
        said = str(error)
    if said is None:
        assert taken.shape == (3,)
        assert np.isfinite(taken).all()
    else:
        assert said.startswith("action ")
        assert said.endswith("accepted: 3 finite numbers (rad)")
        assert "\n" not in said
        assert len(said) < 200


@pytest.mark.parametrize(
    "action",
    [
        [None] * 2, ["1", "2"], [True, False], [1j, 2j], [10**400, 0], [[1], [1, 2]], [[1.0, 2.0]], [1.0], 1.0,
        np.zeros((2, 1)), np.array([np.nan, 0.0]), np.array([np.inf, 0.0]), np.array(["a", "b"]), b"12", object(),
    ],
)  # fmt: skip
def test_what_is_no_displacement_is_refused(action):
    with pytest.raises(RledError, match=r"accepted: 2 finite numbers"):
        action_array(action, 2)
