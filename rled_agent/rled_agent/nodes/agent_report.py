"""What the agent node says of itself on ``/diagnostics``."""

from collections import Counter

from rled_msgs_py.records import GateCode, GateDecision, Health, Level
from rled_msgs_py.tick import Tick

from rled_agent.deploy.arbiter import Arbiter, Outcome
from rled_agent.deploy.learner_client import LearnerClient
from rled_agent.deploy.piloting import Proposal


class AgentReport:
    """Counts decisions, answers and refused messages, and puts them into words once in a while.

    Args:
        period: in which a state is to be answered (s).
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._decisions: Counter[GateCode] = Counter()
        self._refused: Counter[str] = Counter()
        self._slowest, self._missed = 0.0, 0
        self._alive: bool | None = None
        self._losses = 0

    def decided(self, code: GateCode) -> None:
        """Count a decision."""
        self._decisions[code] += 1

    def answered(self, seconds: float) -> None:
        """Count an answer of the policy, so long after its state came."""
        self._slowest = max(self._slowest, seconds)
        self._missed += seconds > self._period

    def refused(self, topic: str) -> None:
        """Count a message that nothing came of."""
        self._refused[topic] += 1

    def living(self, simulation: bool) -> None:
        """Note whether a simulation lives."""
        self._losses += not simulation
        self._alive = simulation

    def health(self, now: int, enabled: bool, arbiter: Arbiter | None, client: LearnerClient | None) -> Health:
        """The report since the last one; ``now`` is wall time (ns)."""
        values = {f"decisions_{code.name.lower()}": str(self._decisions[code]) for code in GateCode}
        values |= {f"refused {name}": str(count) for name, count in self._refused.items()}
        values |= {"slowest_answer_ms": f"{self._slowest * 1e3:.3f}", "deadlines_missed": str(self._missed)}
        values["simulation_lost"] = str(self._losses)
        self._slowest = 0.0
        level, message = Level.OK, "driving" if enabled else "disabled"
        if client is not None:
            values |= {name: str(getattr(client, name)) for name in ("offered", "dropped", "handovers")}
            if not client.running:
                level, message = Level.ERROR, "the learning process has ended; call ~/learn again"
        if arbiter is None:
            level, message = Level.WARN, "no task_description and robot_description yet"
        elif self._alive is False:
            level, message = Level.WARN, "the simulation is gone; waiting for it"
        elif arbiter.stopped:
            level, message = Level.ERROR, "emergency stop"
        return Health(now, level, "agent_node: policy", message, values)


def decision_of(tick: Tick, proposal: Proposal, outcome: Outcome) -> GateDecision:
    """What ``safety_gate`` says of one decision."""
    return GateDecision(
        tick.stamp,
        outcome.level,
        outcome.actor,
        outcome.reason,
        proposal.uncertainty,
        proposal.threshold,
        proposal.measure,
        episode=tick.status.episode,
        step=tick.status.step,
        code=outcome.code,
    )
