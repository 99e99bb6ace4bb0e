"""The uncertainty gate: where the actor is unsure, the expert acts (Eq. 4.40)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.records import Actor, GateCode

from rled_agent.exploration.agent import Noise
from rled_agent.exploration.strategy import Choice, PolicyFunction, Strategy
from rled_agent.uncertainty.uncertainty import Uncertainty


@dataclass
class UncertaintyGate(Strategy):
    """Compares u_t with ξ; with zeros for ``hysteresis`` and ``dwell`` this is Eq. 4.40.

    Attributes:
        uncertainty: a_MC and u_t.
        expert: π̂ᵈ.
        noise: ε.
        measure: which u_t is compared.
        threshold: ξ; the expert acts where u_t ≥ ξ, and where u_t is NaN.
        hysteresis: the agent acts again where u_t < ξ (1 − hysteresis).
        dwell: steps that the expert acts for at least.
        standing_in: whether the expert acts.
        stood_in: steps that it has done so.
    """

    uncertainty: Uncertainty
    expert: PolicyFunction
    noise: Noise
    measure: str
    threshold: float
    hysteresis: float = 0.0
    dwell: int = 0
    standing_in: bool = False
    stood_in: int = 0

    def act(self, observation: NDArray[np.float32]) -> Choice:
        """Act by Eq. 4.40."""
        mean, uncertainty = self.uncertainty(observation)
        threshold = self.threshold * (1.0 - self.hysteresis) if self.standing_in else self.threshold
        sure, note = uncertainty[self.measure] < threshold, ""  # false for NaN: what is not known to be sure is unsure
        if sure and self.standing_in and self.stood_in < self.dwell:
            sure, note = False, f"for {self.stood_in} of {self.dwell} steps"
        self.standing_in, self.stood_in = not sure, 0 if sure else self.stood_in + 1
        if sure:
            action, actor, code = self.noise.added_to(mean), Actor.AGENT, GateCode.SURE
        else:
            action, actor, code = self.expert(observation), Actor.EXPERT, GateCode.UNSURE
        return Choice(action, actor, code, uncertainty, self.measure, threshold, note)

    def state_dict(self) -> dict[str, Any]:
        """Whether the expert stands in, and for how long."""
        return {"standing_in": self.standing_in, "stood_in": self.stood_in}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``."""
        self.standing_in, self.stood_in = state["standing_in"], state["stood_in"]
