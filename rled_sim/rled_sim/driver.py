"""From commands to ticks: lockstep and real time, pause, emergency stop, episodes. No ROS in it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import DeltaCommand, PoseSample
from rled_msgs_py.tick import Tick

from rled_sim.commands import Code, Refused, displacement
from rled_sim.fault_channel import FaultChannel
from rled_sim.faults import NO_FAULTS, Faults
from rled_sim.simulation import Simulation
from rled_sim.ticks import tick_of

Mode = Literal["lockstep", "real_time"]


@dataclass(frozen=True)
class Rules:
    """How a driver behaves.

    Attributes:
        mode: ``lockstep`` waits at each tick for the command of its stamp; ``real_time`` is ticked by a timer.
        command_timeout: real time: largest age of the state that a command answers (ns of simulation time).
        auto_reset: begin the next episode as soon as one is over.
    """

    mode: Mode
    command_timeout: int
    auto_reset: bool


class Driver:
    """Takes commands, steps the simulation, gives out ticks.

    Every tick has a stamp of its own, one period after the last; the first is 0. In real time a command is carried out
    once, and where none is fresh the tick is a hold: a period without a displacement, which the task does not count. A
    command that a limit forbids is answered by a step without a displacement, in both modes.

    Attributes:
        rules: may be replaced while it runs.
        stamp: of the newest tick (ns).
        number: episodes begun before this one.
        paused: simulation time stands still.
        stopped: the emergency stop is on.
        channel: carries commands and ticks, with its faults.
    """

    def __init__(
        self,
        simulation: Simulation,
        rules: Rules,
        seed: int,
        on_tick: Callable[[Tick], None],
        on_accepted: Callable[[], None] = lambda: None,
        faults: Faults = NO_FAULTS,
    ) -> None:
        """Wire a driver; ``begin`` gives the first tick.

        Args:
            simulation: what is driven.
            rules: how.
            seed: of every random draw.
            on_tick: called with each tick.
            on_accepted: called when a command is taken, before it is carried out.
            faults: between commands and simulation, and between simulation and ticks.
        """
        self.rules = rules
        self.stamp, self.number = -simulation.task.description.period, -1
        self.paused = self.stopped = False
        self._simulation, self._on_tick, self._on_accepted = simulation, on_tick, on_accepted
        self._rng = np.random.default_rng(seed)
        self.channel = FaultChannel(faults, simulation.task.description, simulation.plant.robot.chain.position)
        self.channel.seed(seed)
        self._pending: list[float] | None = None
        self._answered = -1
        self._last: tuple[int, list[float]] | None = None
        self._zero = [0.0] * simulation.task.description.action_size

    def begin(self) -> None:
        """Begin the next episode."""
        self.number += 1
        self._answered, self._pending = self.stamp, None
        self._simulation.reset(self._rng)
        self.channel.begin()
        self._tick(0.0)

    def reset(self, seed: int | None = None) -> None:
        """Begin the next episode now; with a seed, the random draws begin anew.

        Raises:
            RledError: the emergency stop is on.
        """
        if self.stopped:
            raise RledError("the emergency stop is on", "", "release it first")
        if seed is not None:
            self._rng = np.random.default_rng(seed)
            self.channel.seed(seed)
        self.begin()

    def command(self, command: DeltaCommand) -> None:
        """Take a command; in lockstep this steps.

        The command taken last changes nothing when it comes again: it is retransmitted to each late listener.

        Raises:
            Refused: it is not taken; in lockstep the driver goes on waiting.
        """
        delta = displacement(command, self._simulation.task.description)
        if (command.stamp, delta) == self._last:
            return
        self._require_moving()
        self._require_fresh(command.stamp)
        self._last = command.stamp, delta
        self._answered, self._pending = command.stamp, delta
        self._on_accepted()
        if self.rules.mode == "lockstep" and not self.paused:
            self._advance()

    def retarget(self, request: PoseSample) -> None:
        """Move the target; the next tick shows it there.

        Raises:
            Refused: in lockstep, where it would be another run than the seed's, or the target may not lie there.
        """
        if self.rules.mode == "lockstep":
            raise Refused(Code.TARGET, "a target asked for in lockstep", "requests in real time")
        if self._simulation.episode.over:
            raise Refused(Code.EPISODE_OVER, "the episode is over", "requests after ~/reset")
        self._simulation.retarget(request)

    def timer(self) -> None:
        """A period of real time has passed."""
        if not self.paused:
            self._advance()

    def pause(self, on: bool) -> None:
        """Let simulation time stand still, or go on; a command taken meanwhile is carried out then."""
        self.paused = on
        if not on and self.rules.mode == "lockstep" and self._pending is not None:
            self._advance()

    def stop(self, on: bool) -> None:
        """Latch or release the emergency stop.

        While it is on, commands are refused and no episode begins; in real time the ticks go on as holds. Released,
        lockstep gives a hold as a new tick to answer, since nobody answers the old one twice.
        """
        released = self.stopped and not on
        self.stopped, self._pending, self._last = on, None, None
        if on:
            self._simulation.plant.halt()
            self.channel.halt()
        elif released and self.rules.mode == "lockstep":
            self._hold()

    def _advance(self) -> None:
        command, self._pending = self._pending, None
        delta = None if self._simulation.episode.over else self.channel.act(command)
        if delta is None and self.rules.mode == "real_time":
            self._hold()
            return
        outcome = self._simulation.step(delta or self._zero)  # in lockstep a step waits for each command, lost or not
        self._tick(outcome.reward)
        if self._simulation.episode.over and self.rules.auto_reset:
            self.begin()

    def _hold(self) -> None:
        self._simulation.hold()
        self._tick(0.0)

    def _tick(self, reward: float) -> None:
        self.stamp += self._simulation.task.description.period
        self._on_tick(self.channel.see(tick_of(self._simulation, self.stamp, self.number, reward)))

    def _require_moving(self) -> None:
        if self.stopped:
            raise Refused(Code.STOPPED, "the emergency stop is on", "commands after its release")
        if self._simulation.episode.over:
            raise Refused(Code.EPISODE_OVER, "the episode is over", "commands after ~/reset")

    def _require_fresh(self, stamp: int) -> None:
        lockstep = self.rules.mode == "lockstep"
        oldest = self.stamp if lockstep else max(self._answered + 1, self.stamp - self.rules.command_timeout)
        accepted = f"{oldest} to {self.stamp} ns" if oldest <= self.stamp else "one for the next state"
        if stamp < oldest:
            raise Refused(Code.STALE, f"a command for the state of {stamp} ns", accepted)
        if stamp > self.stamp:
            raise Refused(Code.FUTURE, f"a command for the state of {stamp} ns", accepted)
