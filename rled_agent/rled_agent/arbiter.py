"""The one place that decides who moves the robot: emergency stop, person, limits, uncertainty, agent. No ROS in it."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.records import Actor, GateCode, Level
from rled_sim.motion_guard import Guard

Vector = NDArray[np.float64]
Source = Callable[[], Vector]


@dataclass(frozen=True)
class ArbiterSettings:
    """When who acts. With zeros for ``hysteresis``, ``dwell`` and ``blend`` this is Eq. 4.40.

    Attributes:
        threshold: ξ; the expert acts where u_t >= ξ.
        hysteresis: the agent acts again where u_t < ξ (1 − hysteresis).
        dwell: steps that the expert acts for at least.
        blend: steps over which control passes between a person and a policy.
        human_timeout: a person lets go when no command came for so long (s).
        state_timeout: age from which a state is not acted on (s); 0: any state is, as lockstep needs it.
        query_timeout: how long a person is asked before the expert stands in (s); 0: nobody is asked.
    """

    threshold: float
    hysteresis: float = 0.0
    dwell: int = 0
    blend: int = 5
    human_timeout: float = 0.3
    state_timeout: float = 0.0
    query_timeout: float = 0.0


class Proposal(NamedTuple):
    """What a policy would do.

    Attributes:
        actor: AGENT, or EXPERT where the expert is the policy.
        delta: Δq (rad), shape (n,).
        uncertainty: u_t, NaN where the policy has none.
        measure: name of u_t, ``none`` where nothing is compared with ξ.
        drawn: whether the expert was drawn to drive the whole episode (Eq. 4.11).
    """

    actor: Actor
    delta: Vector
    uncertainty: float = math.nan
    measure: str = "none"
    drawn: bool = False


class Situation(NamedTuple):
    """All that a decision depends on.

    Attributes:
        now: steady time (s).
        age: of the state (s).
        q: joint angles (rad), shape (n,).
        proposal: of the policy.
        expert: Δq (rad) of the expert, None when there is no other than the policy.
    """

    now: float
    age: float
    q: Vector
    proposal: Proposal
    expert: Source | None


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
        self._by_person = self._standing_in = False
        self._stood_in = self._blending = 0

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
        refused = self._guard.judge(situation.q, self._before, situation.proposal.delta)
        if refused is not None:
            return self._stand_in(situation, GateCode.LIMIT, str(refused))
        if situation.proposal.measure == "none":
            return self._follow(situation)
        unsure, reason = self._compare(situation.proposal)
        if not unsure:
            self._asked_since = -math.inf
            return self._act(situation, Actor.AGENT, situation.proposal.delta, GateCode.SURE, reason)
        if self._is_asking(situation.now):
            left = self._asked_since + self.settings.query_timeout - situation.now
            return self._leave(f"{reason}; a person is asked, for {left:.1f} s more", GateCode.ASKING)
        return self._stand_in(situation, GateCode.UNSURE, reason)

    def _follow(self, situation: Situation) -> Outcome:
        actor, drawn = situation.proposal.actor, situation.proposal.drawn
        code = GateCode.DRAWN if drawn else GateCode.UNGATED
        reason = f"the {actor.value} {'was drawn for this episode' if drawn else 'is the policy'}"
        return self._act(situation, actor, situation.proposal.delta, code, reason)

    def _compare(self, proposal: Proposal) -> tuple[bool, str]:
        """Eq. 4.40, with hysteresis and dwell; a NaN is unsure."""
        threshold, u = self.settings.threshold, proposal.uncertainty
        if self._standing_in:
            threshold *= 1.0 - self.settings.hysteresis
        unsure = not u < threshold
        reason = f"{proposal.measure} {u:.3g} {'>=' if unsure else '<'} threshold {threshold:.3g}"
        if not unsure and self._standing_in and self._stood_in < self.settings.dwell:
            unsure, reason = True, f"{reason}, for {self._stood_in} of {self.settings.dwell} steps"
        self._standing_in, self._stood_in = unsure, self._stood_in + 1 if unsure else 0
        return unsure, reason

    def _is_asking(self, now: float) -> bool:
        if not self.settings.query_timeout:
            return False
        if self._asked_since == -math.inf:
            self._asked_since = now
        return now - self._asked_since < self.settings.query_timeout

    def _stand_in(self, situation: Situation, code: GateCode, reason: str) -> Outcome:
        if situation.expert is None:
            return self._hold(code, reason)
        return self._act(situation, Actor.EXPERT, situation.expert(), code, reason)

    def _act(self, situation: Situation, actor: Actor, delta: Vector, code: GateCode, reason: str) -> Outcome:
        before, is_judged = self._before, actor is situation.proposal.actor and not self._blending
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
