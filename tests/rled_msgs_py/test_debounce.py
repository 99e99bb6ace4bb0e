"""What is said only when it has lasted."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.debounce import FIRST_REPORT_AFTER, REPORT_PERIOD, Debounce, WaitingReport


def told(signs: list[tuple[float, bool]], until: float) -> list[bool]:
    """What is told of signs, each with its time (s); a look every tenth of a second; changes have to last for 1 s."""
    said: list[bool] = []
    steady, waiting = Debounce(1.0, said.append), list(signs)
    for tenth in range(int(10 * until) + 1):
        while waiting and waiting[0][0] <= tenth / 10:
            when, sign = waiting.pop(0)
            steady.see(sign, when)
        steady.poll(tenth / 10)
    return said


def test_the_first_sign_is_told_at_once() -> None:
    assert told([(0.0, True)], 0.0) == [True]


def test_who_is_gone_for_two_milliseconds_was_not_gone() -> None:
    signs = [(0.0, True), *(each for k in range(6) for each in ((2.0 + k, False), (2.002 + k, True)))]
    assert told(signs, 20.0) == [True]


def test_who_is_back_for_a_moment_is_not_back() -> None:
    assert told([(0.0, True), (2.0, False), (5.0, True), (5.5, False)], 20.0) == [True, False]


def test_a_change_is_told_when_it_has_lasted() -> None:
    signs = [(0.0, True), (2.0, False)]
    assert told(signs, 2.9) == [True]
    assert told(signs, 3.1) == [True, False]
    assert told([*signs, (6.0, True)], 6.9) == [True, False]
    assert told([*signs, (6.0, True)], 7.1) == [True, False, True]


def test_nobody_is_gone_before_somebody_came() -> None:
    assert told([(0.0, False), (3.0, False)], 20.0) == []


@given(st.lists(st.tuples(st.integers(1, 40), st.booleans()), max_size=30))
def test_what_is_told_alternates_and_ends_with_what_is_true(steps: list[tuple[int, bool]]) -> None:
    now, signs = 0.0, list[tuple[float, bool]]()
    for tenths, sign in steps:
        now += tenths / 10
        signs.append((now, sign))
    said = told(signs, now + 5.0)
    assert all(one != other for one, other in pairwise(said))
    assert said[-1:] == ([signs[-1][1]] if any(sign for _, sign in signs) else [])


def said(awaited: list[str], look: float) -> list[tuple[float, str]]:
    """What is said when, of what is awaited at looks so far (s) apart."""
    waiting = WaitingReport()
    return [(k * look, text) for k, text in enumerate(awaited) if waiting.is_due(text, k * look)]


def test_a_wait_is_said_after_a_moment_and_again_now_and_then() -> None:
    assert (FIRST_REPORT_AFTER, REPORT_PERIOD) == (2.0, 10.0)
    assert said(["a"] * 100, 0.25) == [(2.0, "a"), (12.0, "a"), (22.0, "a")]


def test_nothing_is_said_of_what_comes_before() -> None:
    assert said(["a"] * 7 + [""] * 100, 0.25) == []


def test_what_is_awaited_next_is_said_too() -> None:
    assert said(["a"] * 10 + ["b"] * 10, 0.25) == [(2.0, "a"), (4.5, "b")]


def test_a_wait_that_begins_again_is_said_again() -> None:
    assert said(["a"] * 9 + [""] + ["a"] * 9, 0.25) == [(2.0, "a"), (4.5, "a")]
