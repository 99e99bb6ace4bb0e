"""Parameters of the agent node."""

from dataclasses import dataclass, replace

from rled_msgs_py.errors import ContractError
from rled_msgs_py.params import param

from rled_agent.deploy.arbiter import ArbiterSettings
from rled_agent.deploy.learner_client import PRIORITIES
from rled_agent.deploy.piloting import StrategySettings
from rled_agent.nn.policy import GateSettings
from rled_agent.uncertainty.measures import MEASURES
from rled_agent.uncertainty.uncertainty import STD

TRAINED = "trained"
AS_TRAINED = {"threshold": -1.0, "measure": TRAINED, "passes": 0}
"""What stands for the value that the policy was trained with, by parameter."""


@dataclass(frozen=True)
class AgentParams:
    """Parameters of the agent node; those of the gate and Φ may be set while it runs.

    What the gate compares comes with the policy unless it is given.
    """

    expert: str = param("out/expert/expert.safetensors", "weights of train_expert, or their folder", read_only=True)
    agent: str = param("", "policy that train_agent wrote; empty: the expert drives alone", read_only=True)
    threshold: float = param(
        -1.0, "ξ: at this uncertainty or more the expert acts; -1: as the policy was trained", low=-1.0, high=1e9
    )
    measure: str = param(
        TRAINED, f"uncertainty that is compared with the threshold; {TRAINED}: as the policy was",
        choices=(TRAINED, *MEASURES, STD),
    )  # fmt: skip
    passes: int = param(0, "N, stochastic passes of the actor; 0: as the policy was trained", low=0, high=10_000)
    hysteresis: float = param(0.0, "the agent acts again below ξ (1 - hysteresis); 0: the thesis", low=0.0, high=1.0)
    dwell: int = param(0, "steps that the expert acts for at least; 0: the thesis", low=0, high=100_000)
    phi: float = param(0.0, "Φ, probability that the expert drives an episode", low=0.0, high=1.0)
    blend: int = param(5, "steps over which control passes between a person and the policy", low=0, high=1000)
    human_timeout: float = param(0.3, "a person lets go when no command came for so long (s)", low=0.01, high=10.0)
    state_timeout: float = param(
        0.0, "age from which a state is not acted on (s); 0: any age, as lockstep needs it", low=0.0, high=60.0
    )
    query_timeout: float = param(
        0.0, "where unsure, hold and ask a person for so long (s) before the expert acts; 0: do not ask",
        low=0.0, high=3600.0,
    )  # fmt: skip
    noise: float = param(0.0, "std of exploration noise, in halves of the action range", low=0.0, high=10.0,
                         read_only=True)  # fmt: skip
    seed: int = param(0, "seed of dropped units, noise and episodes", low=0, high=2**31 - 1, read_only=True)
    learning_state: str = param("out/agent_node/learning.safetensors", "where ~/learn keeps its state", read_only=True)
    learning_priority: str = param(
        "idle", "idle: learn on processors that nothing else wants; low: also on a machine that is busy all the time",
        choices=PRIORITIES, read_only=True,
    )  # fmt: skip
    learn: bool = param(False, "learn from the start; ~/learn switches it", read_only=True)
    enabled: bool = param(True, "answer states; ~/enable switches it", read_only=True)

    def __post_init__(self) -> None:
        if -1.0 < self.threshold < 0.0:
            raise ContractError(f"threshold is {self.threshold}", "0 or more, or -1")
        if self.passes == 1:
            raise ContractError("passes is 1", "2 or more, or 0")

    def in_force(self, trained: GateSettings | None) -> "AgentParams":
        """The same with what the policy was trained with in place of what is not given."""
        known = trained or GateSettings()
        missing = {name: getattr(known, name) for name in self.not_given}
        return replace(self, **missing)

    @property
    def not_given(self) -> list[str]:
        """Names of what comes with the policy."""
        return [name for name, value in AS_TRAINED.items() if getattr(self, name) == value]

    def gate(self, trained: GateSettings | None) -> GateSettings:
        """What is compared, of what the policy was trained to be asked for."""
        estimator = (trained or GateSettings()).estimator
        return GateSettings(self.measure, self.threshold, self.passes, estimator)

    def strategy(self, trained: GateSettings | None) -> StrategySettings:
        """Who acts when."""
        return StrategySettings(self.gate(trained), self.hysteresis, self.dwell, self.noise, self.phi)

    def gate_said(self, trained: GateSettings | None) -> str:
        """What the gate compares, and where that comes from, for people."""
        chosen = ", ".join(name for name in AS_TRAINED if name not in self.not_given)
        source = "as the policy was trained" if trained is not None else "the policy says nothing of a gate"
        given = f"{chosen} given; else " if chosen else ""
        return f"the gate: {self.in_force(trained).gate(trained)} ({given}{source})"

    def safety(self) -> ArbiterSettings:
        """What the arbiter needs of them."""
        return ArbiterSettings(self.blend, self.human_timeout, self.state_timeout, self.query_timeout)
