"""What the simulation answers to a reset is read as it was said, and nothing else is."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.errors import ContractError
from rled_msgs_py.reset_answer import ResetAnswer

counts = st.integers(0, 2**63 - 1)


@given(counts, counts)
def test_an_answer_is_read_as_it_was_said(episode: int, stamp: int) -> None:
    answer = ResetAnswer.of(episode, stamp)
    assert ResetAnswer.from_json(answer.to_json()) == answer


def test_another_answer_is_refused() -> None:
    whole = json.loads(ResetAnswer.of(1, 5).to_json())
    texts = ["", "-1", "episode 1 begins at 5 ns", "{}", "[]", "x" * 10**6, "{" * 10**5]
    changed = [{"stamp": stamp} for stamp in (-5, 1e9, True, "5", None, 9**99)]
    changed += [{"episode": -1}, {"text": 5}, {"more": 1}]
    for text in [*texts, *(json.dumps(whole | each) for each in changed), json.dumps({"stamp": 5})]:
        with pytest.raises(ContractError) as error:
            ResetAnswer.from_json(text)
        assert len(str(error.value)) < 2000
