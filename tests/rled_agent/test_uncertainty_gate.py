"""The gate of one seed: decisions worked out by hand."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from rled_agent.exploration.agent import Noise
from rled_agent.exploration.strategy import Choice
from rled_agent.exploration.uncertainty_gate import UncertaintyGate
from rled_agent.nn.draws import Draws
from rled_agent.uncertainty.uncertainty import Estimate
from rled_msgs_py.records import GateCode
from torch import Tensor

from .strategies import AGENT, EXPERT, STATE, actor, always, carry, noise


class Told:
    """Says the uncertainties that it is told to say, one after the other."""

    def __init__(self, *values: float, **measures: float) -> None:
        self.left, self.measures = list(values), measures

    def __call__(self, observation: Tensor) -> Estimate:
        told = self.measures or {"qcd": self.left.pop(0)}
        return Estimate(AGENT, {name: torch.tensor([value], dtype=torch.float64) for name, value in told.items()})


def gate(told: Told, measure: str = "qcd", exploring: Noise | None = None, **settings: float) -> UncertaintyGate:
    return UncertaintyGate(told, always(EXPERT), exploring or noise(), measure, **{"threshold": 0.5} | settings)


def choices(*uncertainties: float, **settings: float) -> list[Choice]:
    one = gate(Told(*uncertainties), **settings)
    return [one.act(STATE) for _ in uncertainties]


def actors(*uncertainties: float, **settings: float) -> str:
    """a where the agent acts, e where the expert does."""
    return "".join(map(actor, choices(*uncertainties, **settings)))


def test_the_expert_acts_from_the_threshold_on():
    assert actors(np.nextafter(0.5, 0), 0.5, math.inf, 0.0) == "aeea"
    assert actors(0.0, threshold=0.0) == "e"


def test_an_uncertainty_that_is_no_number_is_unsure():
    assert actors(math.nan, 0.1, math.nan) == "eae"


def test_the_mean_or_the_experts_action_is_given_with_its_reason():
    sure, unsure = choices(0.25, 0.75)
    for choice, action, who, code, u in (
        (sure, AGENT, "a", GateCode.SURE, 0.25),
        (unsure, EXPERT, "e", GateCode.UNSURE, 0.75),
    ):
        assert torch.equal(choice.action, action)
        assert (actor(choice), choice.code.item(), choice.uncertainty) == (who, code, {"qcd": torch.tensor([u])})
        assert choice[4:] == ("qcd", 0.5, 0)


@pytest.mark.parametrize(("measure", "who"), [("qcd", "e"), ("iqr", "a")])
def test_the_chosen_measure_is_compared_and_both_are_reported(measure, who):
    choice = gate(Told(qcd=0.9, iqr=0.1), measure).act(STATE)
    assert actor(choice) == who
    assert {name: each.item() for name, each in choice.uncertainty.items()} == {"qcd": 0.9, "iqr": 0.1}
    assert choice.measure == measure


def test_it_explores_around_the_mean_and_the_expert_does_not():
    one, same = gate(Told(0.1, 0.9, 0.1), exploring=noise(0.1, 4)), Draws([4])
    for acts in ("agent", "expert", "agent"):
        noisy = AGENT + 0.1 * same.normal(2)
        assert torch.equal(one.act(STATE).action, noisy if acts == "agent" else EXPERT)


def test_hysteresis_asks_for_more_certainty_before_the_agent_returns():
    assert actors(0.4, 0.5, 0.4, 0.25, 0.24, 0.4, hysteresis=0.5) == "aeeeaa"
    thresholds = [choice.threshold.item() for choice in choices(0.4, 0.5, 0.4, 0.24, 0.4, hysteresis=0.5)]
    assert thresholds == [0.5, 0.5, 0.25, 0.25, 0.5]


def test_with_hysteresis_the_threshold_is_the_same_number():
    """0.1 of 32 bits is more than 0.1."""
    assert actors(0.1, threshold=0.1) == actors(0.1, threshold=0.1, hysteresis=0.5) == "e"
    thresholds = [choice.threshold.item() for choice in choices(0.1, 0.06, threshold=0.1, hysteresis=0.5)]
    assert thresholds == [0.1, 0.05]


def test_the_expert_dwells():
    assert actors(0.6, 0.1, 0.1, 0.1, 0.1, dwell=3) == "eeeaa"
    assert [int(choice.held) for choice in choices(0.6, 0.1, 0.1, 0.1, dwell=3)] == [0, 1, 2, 0]
    assert actors(0.6, 0.1, 0.6, 0.1, 0.1, dwell=3) == "eeeaa"  # counted since the expert began
    assert [int(choice.held) for choice in choices(0.6, 0.1, 0.6, 0.1, dwell=3)] == [0, 1, 0, 0]


@given(st.lists(st.floats(0.0, 1.0), max_size=30))
def test_with_neither_it_is_the_equation(uncertainties):
    assert actors(*uncertainties) == "".join("a" if u < 0.5 else "e" for u in uncertainties)


def test_it_goes_on_from_its_state(tmp_path):
    settings = {"hysteresis": 0.5, "dwell": 3}
    one, other = gate(Told(0.6, 0.1), **settings), gate(Told(0.1, 0.4, 0.1), **settings)
    for _ in range(2):
        one.act(STATE)
    carry(one, other, tmp_path)
    assert "".join(actor(other.act(STATE)) for _ in range(3)) == "eea"
