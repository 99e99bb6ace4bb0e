"""The uncertainty gate: where the actor is unsure, the expert acts (Eq. 4.40)."""

from dataclasses import dataclass

import torch
from rled_msgs_py.records import GateCode
from torch import Tensor

from rled_agent.exploration.agent import Noise
from rled_agent.exploration.strategy import Choice, PolicyFunction, Strategy, is_anywhere
from rled_agent.per_seed import column
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
        standing_in: whether the expert acts, shape (P,).
        stood_in: steps that it has done so, counted where ``dwell`` asks for them, shape (P,).
    """

    uncertainty: Uncertainty
    expert: PolicyFunction
    noise: Noise
    measure: str
    threshold: float
    hysteresis: float = 0.0
    dwell: int = 0

    def __post_init__(self) -> None:
        seeds, device = self.noise.draws.population, self.noise.draws.device
        self.standing_in = torch.zeros(seeds, dtype=torch.bool, device=device)
        self.stood_in = torch.zeros(seeds, dtype=torch.int64, device=device)
        self._sure, self._unsure = (torch.tensor(int(each), device=device) for each in (GateCode.SURE, GateCode.UNSURE))
        self._enters = torch.as_tensor(self.threshold, dtype=torch.float64, device=device)
        self._leaves = self._enters * (1.0 - self.hysteresis)

    def act(self, observation: Tensor) -> Choice:
        """Act by Eq. 4.40."""
        mean, uncertainty = self.uncertainty(observation)
        threshold: Tensor | float = column(self.threshold, uncertainty[self.measure])
        if self.hysteresis:
            threshold = torch.where(self.standing_in, self._leaves, self._enters)
        sure = uncertainty[self.measure] < threshold  # false for NaN: what is not known to be sure is unsure
        held: Tensor | int = 0
        if self.dwell:
            held = torch.where(sure & self.standing_in & (self.stood_in < self.dwell), self.stood_in, 0)
            sure = sure & (held == 0)
            self.stood_in = torch.where(sure, 0, self.stood_in + 1)
        self.standing_in = ~sure
        action = self.noise.added_to(mean)
        if is_anywhere(self.standing_in):
            action = torch.where(sure[:, None], action, self.expert(observation))
        code = torch.where(sure, self._sure, self._unsure)
        return Choice(action, self.standing_in, code, uncertainty, self.measure, threshold, held)

    def state_dict(self) -> dict[str, Tensor]:
        """Whether the expert stands in, and for how long."""
        return {"standing_in": self.standing_in, "stood_in": self.stood_in}
