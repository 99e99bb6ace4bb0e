"""The one place that decides who moves the robot: emergency stop, person, limits, strategy. No ROS in it."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.records import Actor, GateCode, Level
from rled_sim.motion_guard import Guard

from rled_agent.deploy.piloting import Proposal

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class ArbiterSettings:
    """What is safe.

    Attributes:
        blend: steps over which control passes between a person and a policy.
        human_timeout: a person lets go when no command came for so long (s).
        state_timeout: age from which a state is not acted on (s); 0: any state is, as lockstep needs it.
        query_timeout: how long a person is asked before the expert stands in (s); 0: nobody is asked.
    """

    blend: int = 5
    human_timeout: float = 0.3
    state_timeout: float = 0.0
    query_timeout: float = 0.0


class Situation(NamedTuple):
    """All that a decision depends on.

    Attributes:
        now: steady time (s).
        age: of the state (s).
        q: joint angles (rad), shape (n,).
        proposal: of the strategy.
    """

    now: float
    age: float
    q: Vector
    proposal: Proposal


class Outcome(NamedTuple):
    """One decision.

    Attributes:
        delta: Δq (rad), shape (n,); None where the state gets no answer, so that the robot stays where it is.
        actor: who moves the robot.
        level: OK when the policy acts, WARN when somebody stands in, ERROR when nobody may.
        code: why, for programs.
        reason: why, for people.
    """

    delta: Vector | None
    actor: Actor
    level: Level
    code: GateCode
    reason: str


class Arbiter:
    """A state machine over situations; the same calls give the same decisions.

    Args:
        settings: may be replaced while it runs.
        guard: the robot's limits.
        size: n, joints.
    """

    def __init__(self, settings: ArbiterSettings, guard: Guard, size: int) -> None:
        self.settings = settings
        self.stopped = False
        self._guard = guard
        self._before = np.zeros(size)
        self._person: Vector | None = None
        self._person_seen = self._asked_since = -math.inf
        self._by_person = False
        self._blending = 0

    def hear_person(self, delta: Vector, now: float) -> None:
        """A person's command, Δq (rad) of shape (n,); it answers one state."""
        self._person, self._person_seen = delta, now

    def decide(self, situation: Situation) -> Outcome | None:
        """Who moves the robot in this state; None to wait for the person who is in control."""
        if self.stopped:
            self._person = None
            return self._leave("the emergency stop is on", GateCode.STOPPED)
        if situation.now - self._person_seen <= self.settings.human_timeout:
            return self._obey()
        if self._by_person:  # the robot has stood still since the last command
            self._pass_control(False)
            self._before = np.zeros_like(self._before)
        if 0.0 < self.settings.state_timeout < situation.age:
            return self._leave(f"the state is {situation.age:.3f} s old", GateCode.STALE)
        return self._choose(situation)

    def _obey(self) -> Outcome | None:
        if self._person is None:
            return None
        delta, self._person = self._person, None
        self._asked_since = -math.inf
        self._pass_control(True)
        return Outcome(self._blended(delta), Actor.HUMAN, Level.WARN, GateCode.HUMAN, "a person drives")

    def _choose(self, situation: Situation) -> Outcome:
        proposal = situation.proposal
        if proposal.code is GateCode.UNSURE:
            if self._is_asking(situation.now):
                left = self._asked_since + self.settings.query_timeout - situation.now
                reason = f"{_reason(proposal)}; a person is asked, for {left:.1f} s more"
                return self._leave(reason, GateCode.ASKING)
        else:
            self._asked_since = -math.inf
            refused = self._guard.judge(situation.q, self._before, proposal.delta)
            if refused is not None:
                return self._stand_in(situation, str(refused))
        return self._act(situation, proposal.actor, proposal.delta, proposal.code, _reason(proposal))

    def _is_asking(self, now: float) -> bool:
        if not self.settings.query_timeout:
            return False
        if self._asked_since == -math.inf:
            self._asked_since = now
        return now - self._asked_since < self.settings.query_timeout

    def _stand_in(self, situation: Situation, reason: str) -> Outcome:
        if situation.proposal.expert is None:
            return self._hold(GateCode.LIMIT, reason)
        return self._act(situation, Actor.EXPERT, situation.proposal.expert(), GateCode.LIMIT, reason)

    def _act(self, situation: Situation, actor: Actor, delta: Vector, code: GateCode, reason: str) -> Outcome:
        before = self._before
        is_judged = code not in (GateCode.UNSURE, GateCode.LIMIT) and not self._blending
        delta = self._blended(delta)
        refused = None if is_judged else self._guard.judge(situation.q, before, delta)
        if refused is not None:
            return self._hold(GateCode.LIMIT, f"{actor.value}: {refused}")
        level = Level.OK if code in (GateCode.SURE, GateCode.UNGATED, GateCode.DRAWN) else Level.WARN
        return Outcome(delta, actor, level, code, reason)

    def _hold(self, code: GateCode, reason: str) -> Outcome:
        """Answer with no displacement: in lockstep, no answer would be waited for for ever."""
        self._before = np.zeros_like(self._before)
        return Outcome(self._before.copy(), Actor.HOLD, Level.ERROR, code, reason)

    def _leave(self, reason: str, code: GateCode) -> Outcome:
        self._before = np.zeros_like(self._before)
        return Outcome(None, Actor.HOLD, Level.ERROR, code, reason)

    def _pass_control(self, by_person: bool) -> None:
        if by_person != self._by_person:
            self._by_person, self._blending = by_person, self.settings.blend

    def _blended(self, delta: Vector) -> Vector:
        """On the way from the last displacement to this one, while control passes."""
        if self._blending:
            delta = self._before + (delta - self._before) / (self._blending + 1)
            self._blending -= 1
        self._before = delta
        return delta


def _reason(proposal: Proposal) -> str:
    """Why somebody acts, for people."""
    if proposal.measure == "none":
        drawn = proposal.code is GateCode.DRAWN
        return f"the {proposal.actor.value} {'was drawn for this episode' if drawn else 'is the policy'}"
    sign = "<" if proposal.uncertainty < proposal.threshold else ">="
    note = f", {proposal.note}" if proposal.note else ""
    return f"{proposal.measure} {proposal.uncertainty:.3g} {sign} threshold {proposal.threshold:.3g}{note}"
