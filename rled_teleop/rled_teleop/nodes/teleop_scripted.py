"""Node: the scripted operator of the thesis, driving the robot over topics."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.duration import Duration
from rclpy.node import Node
from rled_msgs_py.errors import ContractError
from rled_msgs_py.messages import encode
from rled_msgs_py.params import param
from rled_msgs_py.records import Text
from rled_msgs_py.ros.callbacks import ends_node, every
from rled_msgs_py.ros.command_output import CommandOutput
from rled_msgs_py.ros.node import advertise, declare, run_node, subscribe, subscribe_ticks
from rled_msgs_py.ros.waiting import report_waiting, waiting_for
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import STATE_NAMES, Tick
from rled_msgs_py.topics import (
    JOINT_DELTA,
    MARKED_EE_POSE,
    MARKED_JOINT_STATES,
    ROBOT_DESCRIPTION,
    TASK_DESCRIPTION,
)
from rled_sim.kinematics import Chain
from rled_sim.robots import robot_named
from rled_sim.tasks import reach_task

from rled_teleop.operators.imperfection import Hand, Imperfection
from rled_teleop.operators.scripted import ScriptedOperator, require_reachable, spread
from rled_teleop.progress import Progress

DELIVERY_TIMEOUT = Duration(seconds=2)
"""How long the last messages are given to reach their subscribers."""


@dataclass(frozen=True)
class ScriptedParams:
    """Parameters of the scripted operator."""

    points: int = param(
        0, "points of the target curve to mark (ζᵃ), evenly spread; 0: all of them", low=0, high=100_000
    )
    trajectories: int = param(50, "targets to reach after that (ζᵇ)", low=0, high=1_000_000)
    seed: int = param(0, "seed of the imperfections", low=0, high=2**31 - 1)
    tremor: float = param(0.0, "std of noise on each joint displacement, as a share of Δq_max", low=0.0, high=1.0)
    pause_probability: float = param(0.0, "chance at each step that a pause begins", low=0.0, high=0.9)
    pause_steps: float = param(10.0, "mean length of a pause (steps)", low=1.0, high=10_000.0)
    overshoot: float = param(0.0, "how far a motion goes past its goal, as a share of its length", low=0.0, high=1.0)
    joint_tolerance: float = param(1e-6, "joint error at which a point counts as arrived at (rad)", low=1e-9, high=0.1)
    wait_for_subscribers: int = param(1, "subscribers of joint_delta to wait for before the start", low=1, high=100)


class TeleopScripted(Node):
    """Answers each tick with the displacement that the scripted operator makes, and marks points of ζᵃ."""

    def __init__(self, **options: Any) -> None:
        super().__init__("teleop_scripted", **options)
        self._params = declare(self, ScriptedParams)
        self._tick: Tick | None = None
        self._task: TaskDescription | None = None
        self._chain: Chain | None = None
        self._operator: ScriptedOperator | None = None
        self._urdf = ""
        self._bars: tuple[Progress, ...] = ()
        self._delta = CommandOutput(self)
        self._marked_joints = advertise(self, MARKED_JOINT_STATES)
        self._marked_pose = advertise(self, MARKED_EE_POSE)
        subscribe(self, TASK_DESCRIPTION, self._on_task)
        subscribe(self, ROBOT_DESCRIPTION, self._on_robot)
        subscribe_ticks(self, self._on_tick)
        every(self, 0.05, self._answer)  # subscribers come late
        report_waiting(self, self._awaited)

    def _on_task(self, text: Text) -> None:
        self._task = TaskDescription.from_json(text.data)

    def _on_robot(self, text: Text) -> None:
        self._urdf = text.data

    def _on_tick(self, tick: Tick) -> None:
        self._tick = tick
        self._delta.withdraw()
        self._answer()

    def _awaited(self) -> str:
        if self._task is None or not self._urdf:
            return waiting_for(self, "sim_node", f"{TASK_DESCRIPTION.name} and {ROBOT_DESCRIPTION.name}")
        if self._operator is None and not self._is_listened_to():
            there, wanted = self._delta.publisher.get_subscription_count(), self._params.wait_for_subscribers
            what = f"{wanted} subscribers of {JOINT_DELTA.name} ({there} there)"
            return waiting_for(self, "record_demos" if there else "sim_node", what)
        return waiting_for(self, "sim_node", ", ".join(STATE_NAMES)) if self._operator is None else ""

    def _answer(self) -> None:
        if self._tick is None or not self._ready():
            return
        assert self._operator is not None
        tick, self._tick = self._tick, None
        try:
            answer = self._operator.answer(tick)
        except ContractError as error:
            self.get_logger().warning(f"a tick is not answered: {error}", throttle_duration_sec=1.0)
            return
        if answer.mark:
            self._marked_joints.publish(encode(MARKED_JOINT_STATES, tick.joints))
            self._marked_pose.publish(encode(MARKED_EE_POSE, tick.ee))
        if answer.delta is not None:
            self._delta.publish(answer.delta)
        self._report(self._operator)

    def _ready(self) -> bool:
        """Whether an operator is there; make it when robot, task and subscribers are."""
        if self._operator is None and self._task is not None and self._urdf and self._is_listened_to():
            with ends_node():
                self._operator = scripted_operator(self._task, self._urdf, self._params)
            totals = self._operator.points, self._params.trajectories
            self._bars = tuple(map(Progress, ("points marked", "targets reached"), totals))
        return self._operator is not None

    def _is_listened_to(self) -> bool:
        return bool(self._delta.publisher.get_subscription_count() >= self._params.wait_for_subscribers)

    def _report(self, operator: ScriptedOperator) -> None:
        for bar, done in zip(self._bars, (operator.points_marked, operator.targets_reached), strict=True):
            bar.show(done)
        if operator.finished:
            self._end()

    def _end(self) -> None:
        for publisher in (self._marked_joints, self._marked_pose, self._delta.publisher):
            publisher.wait_for_all_acked(DELIVERY_TIMEOUT)
        for bar in self._bars:
            bar.close()
        self.context.try_shutdown()


def scripted_operator(task: TaskDescription, urdf: str, params: ScriptedParams) -> ScriptedOperator:
    """The operator for a robot and task.

    Raises:
        RledError: a robot without a task of its own, or too many or too few points.
    """
    targets = reach_task(robot_named(task.robot)).targets  # (k, 3)
    curve = spread(targets, params.points or len(targets))
    if params.trajectories:
        require_reachable(task, curve, targets)
    imperfection = Imperfection(params.tremor, params.pause_probability, params.pause_steps, params.overshoot)
    hand = Hand(imperfection, task, np.random.default_rng(params.seed))
    chain = Chain.from_urdf(urdf, task.tip_link, task.joint_names)
    return ScriptedOperator(task, chain, curve, params.trajectories, hand, params.joint_tolerance)


def main() -> None:
    """Run the node."""
    run_node(TeleopScripted, ScriptedParams, "teleop_scripted", "Mark points along the target curve, then join them.")


if __name__ == "__main__":
    main()
