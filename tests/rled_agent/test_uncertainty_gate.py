"""The gate: decisions worked out by hand."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_agent.exploration.agent import Noise
from rled_agent.exploration.strategy import Choice
from rled_agent.exploration.uncertainty_gate import UncertaintyGate
from rled_agent.uncertainty.uncertainty import Estimate
from rled_msgs_py.records import Actor, GateCode

STATE = np.zeros(4, dtype=np.float32)
AGENT, EXPERT = (np.array(action, dtype=np.float32) for action in ([0.5, -0.5], [0.25, 0.75]))
SILENT = Noise(0.0, np.random.default_rng(0))


class Told:
    """Says the uncertainties that it is told to say, one after the other."""

    def __init__(self, *values: float, **measures: float) -> None:
        self.left, self.measures = list(values), measures

    def __call__(self, observation: np.ndarray) -> Estimate:
        return Estimate(AGENT, self.measures or {"qcd": self.left.pop(0)})


def gate(told: Told, measure: str = "qcd", noise: Noise = SILENT, **settings: float) -> UncertaintyGate:
    return UncertaintyGate(told, lambda _: EXPERT, noise, measure, **{"threshold": 0.5} | settings)


def choices(*uncertainties: float, **settings: float) -> list[Choice]:
    one = gate(Told(*uncertainties), **settings)
    return [one.act(STATE) for _ in uncertainties]


def actors(*uncertainties: float, **settings: float) -> str:
    """a where the agent acts, e where the expert does."""
    return "".join(choice.actor.value[0] for choice in choices(*uncertainties, **settings))


def test_the_expert_acts_from_the_threshold_on():
    assert actors(np.nextafter(0.5, 0), 0.5, math.inf, 0.0) == "aeea"
    assert actors(0.0, threshold=0.0) == "e"


def test_an_uncertainty_that_is_no_number_is_unsure():
    assert actors(math.nan, 0.1, math.nan) == "eae"


def test_the_mean_or_the_experts_action_is_given_with_its_reason():
    sure, unsure = choices(0.25, 0.75)
    np.testing.assert_array_equal(sure.action, AGENT)
    assert sure[1:] == (Actor.AGENT, GateCode.SURE, {"qcd": 0.25}, "qcd", 0.5, "")
    np.testing.assert_array_equal(unsure.action, EXPERT)
    assert unsure[1:] == (Actor.EXPERT, GateCode.UNSURE, {"qcd": 0.75}, "qcd", 0.5, "")


@pytest.mark.parametrize(("measure", "actor"), [("qcd", Actor.EXPERT), ("iqr", Actor.AGENT)])
def test_the_chosen_measure_is_compared_and_both_are_reported(measure, actor):
    choice = gate(Told(qcd=0.9, iqr=0.1), measure).act(STATE)
    assert choice.actor is actor
    assert choice.uncertainty == {"qcd": 0.9, "iqr": 0.1}
    assert choice.compared == choice.uncertainty[measure]


def test_it_explores_around_the_mean():
    same = np.random.default_rng(4).normal(0.0, 0.1, 2)
    choice = gate(Told(0.1), noise=Noise(0.1, np.random.default_rng(4))).act(STATE)
    np.testing.assert_allclose(choice.action, AGENT + same, rtol=1e-6)


def test_hysteresis_asks_for_more_certainty_before_the_agent_returns():
    assert actors(0.4, 0.5, 0.4, 0.25, 0.24, 0.4, hysteresis=0.5) == "aeeeaa"
    thresholds = [choice.threshold for choice in choices(0.4, 0.5, 0.4, 0.24, 0.4, hysteresis=0.5)]
    assert thresholds == [0.5, 0.5, 0.25, 0.25, 0.5]


def test_the_expert_dwells():
    assert actors(0.6, 0.1, 0.1, 0.1, 0.1, dwell=3) == "eeeaa"
    notes = [choice.note for choice in choices(0.6, 0.1, 0.1, 0.1, dwell=3)]
    assert notes == ["", "for 1 of 3 steps", "for 2 of 3 steps", ""]
    assert actors(0.6, 0.1, 0.6, 0.1, 0.1, dwell=3) == "eeeaa"  # counted since the expert began


@given(st.lists(st.floats(0.0, 1.0), max_size=30))
def test_with_neither_it_is_the_equation(uncertainties):
    assert actors(*uncertainties) == "".join("a" if u < 0.5 else "e" for u in uncertainties)


def test_it_goes_on_from_its_state():
    settings = {"hysteresis": 0.5, "dwell": 3}
    one, other = gate(Told(0.6, 0.1), **settings), gate(Told(0.1, 0.4, 0.1), **settings)
    for _ in range(2):
        one.act(STATE)
    other.load_state_dict(json.loads(json.dumps(one.state_dict())))
    assert [other.act(STATE).actor for _ in range(3)] == [Actor.EXPERT, Actor.EXPERT, Actor.AGENT]
