"""N kinematic robots at the reach task, each in an episode of its own, stepped together."""

from collections.abc import Sequence
from typing import NamedTuple

from numpy.typing import ArrayLike
from rled_msgs_py.errors import RledError
from rled_msgs_py.task import Reward, TaskDescription

from rled_sim.draws import offset
from rled_sim.robots import robot_named
from rled_sim.starts import start_points
from rled_sim.tasks import reach_task
from rled_sim.vector.arrays import Array, Arrays
from rled_sim.vector.draws import Draws


class BatchStep(NamedTuple):
    """What one step gives.

    Attributes:
        observation: the states that the transitions led to, shape (N, o), float32.
        reward: of the transitions, shape (N,).
        terminated: the last target of the episode is reached, shape (N,).
        truncated: the episode is cut, shape (N,).
        targets_reached: in the episode so far, shape (N,).
        violations: risky states of the episode so far, shape (N,).
        risky: the state is risky, shape (N,).
    """

    observation: Array
    reward: Array
    terminated: Array
    truncated: Array
    targets_reached: Array
    violations: Array
    risky: Array


class Episodes(NamedTuple):
    """How far the episodes have come.

    Attributes:
        joints: joint angles (rad), shape (N, n).
        position: end effector (m), shape (N, 3).
        target: point to reach (m), shape (N, 3).
        steps: transitions so far, shape (N,).
        targets_reached: targets reached, shape (N,).
        violations: risky states so far, the first included, shape (N,).
        risky: the present state is risky, shape (N,).
    """

    joints: Array
    position: Array
    target: Array
    steps: Array
    targets_reached: Array
    violations: Array
    risky: Array


class ReachBatch:
    """N environments, each with the numbers that ``ReachEnv`` with its seed has by itself.

    The robot is displaced as Eq. 4.28 says; its tip is that of the kinematics, 1e-7 m from PyBullet's. With a device,
    ``step`` and ``begin`` wait for it once in ``draws.CALLS_AHEAD`` calls; between these nothing is read back.

    Attributes:
        task: what is asked of the robots.
        num_envs: N.
        episodes: how far they have come.
    """

    def __init__(
        self,
        robot: str,
        num_envs: int,
        *,
        reward: Reward | None = None,
        start_joints: ArrayLike | None = None,
        targets_per_episode: int | None = None,
        max_steps: int | None = None,
        target_spread: float = 0.0,
        device: str | None = None,
    ) -> None:
        """Make a batch; ``begin`` comes first.

        Args:
            robot: name of the robots.
            num_envs: N, 1 at least.
            reward: ``dense`` or ``sparse``; the task's own when None.
            start_joints: joint angles that episodes start at (rad), shape (k, n); the robot's home when None.
            targets_per_episode: targets that end an episode, 0 never; the task's own when None.
            max_steps: steps that cut an episode, 0 never; the task's own when None.
            target_spread: how far beside the curve a target lies at most, along each axis of the task (m).
            device: of torch's tensors, such as ``cpu`` or ``cuda``; numpy when None.

        Raises:
            RledError: settings that do not fit, or no such device.
        """
        if num_envs < 1:
            raise RledError(f"num_envs is {num_envs}", "1 or more")
        chosen = robot_named(robot)
        self._task = reach_task(
            chosen,
            reward=reward,
            targets_per_episode=targets_per_episode,
            max_steps=max_steps,
            target_spread=target_spread,
        )
        self.task: TaskDescription = self._task.description
        self.num_envs, self._chain = num_envs, chosen.chain
        starts = [list(chosen.home)] if start_joints is None else start_points(start_joints, self.task)
        self._arrays = Arrays(device)
        self._starts, self._targets, self._lower, self._upper = map(
            self._arrays.array, (starts, self._task.targets, chosen.lower, chosen.upper)
        )
        self._all = self._arrays.full((num_envs,), True, "bool")
        self._draws = Draws(self._arrays, num_envs, 1 + 2 * self._task.target_draws)
        self.episodes, self._begun = self._no_episodes(), False

    def _no_episodes(self) -> Episodes:
        nothing, zero = float("nan"), self._arrays.full((self.num_envs,), 0, "int64")
        joints, point = (self._arrays.full((self.num_envs, size), nothing) for size in (self.task.action_size, 3))
        return Episodes(joints, point, point, zero, zero, zero, zero < 0)

    def seed(self, seeds: Sequence[int | None]) -> None:
        """Begin each environment's draws anew, as ``ReachEnv.reset(seed=)`` does; where None is given, they go on.

        Raises:
            RledError: another number of seeds, or some that are none.
        """
        self._draws.seed(seeds)

    def begin(self, which: Array | None = None) -> Array:
        """Begin episodes.

        Args:
            which: the environments that begin one, shape (N,); all when None. What never began is NaN.

        Returns:
            The observations of all environments, shape (N, o), float32.

        Raises:
            RledError: a mask of another shape.
        """
        self._draws.reserve()
        return self._begin(self._mask(which))

    def step(self, action: Array, over: Array | None = None) -> BatchStep:
        """Displace the joints.

        An episode that is over goes on as if it were not, but for the mask.

        Args:
            action: Δq (rad), shape (N, n), clipped to ±Δq_max; a NaN makes all of its environment NaN, until it begins.
            over: environments that begin an episode instead of a step, shape (N,): their reward is 0.

        Raises:
            RledError: no episode has begun, or an array of another shape.
        """
        if not self._begun:
            raise RledError("no episode has begun", "", "call begin first")
        self._draws.reserve()
        if over is None:
            return self._step(self._displacement(action), self._all)
        over = self._mask(over)
        step = self._step(self._displacement(action), ~over)
        return self._ended(step, over)

    def _displacement(self, action: Array) -> Array:
        delta = self._arrays.array(action)
        if delta.shape != self.episodes.joints.shape:
            raise RledError(f"actions of shape {tuple(delta.shape)}", f"({self.num_envs}, {self.task.action_size})")
        return delta

    def _mask(self, which: Array | None) -> Array:
        if which is None:
            return self._all
        mask = self._arrays.array(which, "bool")
        if mask.shape != (self.num_envs,):
            raise RledError(f"a mask of shape {tuple(mask.shape)}", f"({self.num_envs},)")
        return mask

    def _begin(self, which: Array) -> Array:
        uniforms = self._draws.take(which, 1 + self._task.target_draws)
        joints = self._starts[self._index(uniforms[:, 0], len(self._starts))]
        position = self._chain.position(joints)
        risky = self._task.risky(joints.T, position.T)
        zero = self._arrays.cast(risky, "int64") * 0
        begun = Episodes(joints, position, self._target(uniforms[:, 1:]), zero, zero, zero + risky, risky)
        self.episodes = Episodes(
            *(self._arrays.chosen(which, *each) for each in zip(begun, self.episodes, strict=True))
        )
        self._begun = True
        return self._observation()

    def _step(self, delta: Array, which: Array) -> BatchStep:
        """A step of all; where ``which`` does not hold it draws nothing, and an episode begins next."""
        before, task, largest = self.episodes, self.task, self.task.max_delta
        joints = before.joints + self._arrays.xp.clip(delta, -largest, largest)
        joints = self._arrays.xp.clip(joints, self._lower, self._upper)
        position = self._chain.position(joints)
        reward, reached, risky = self._task.judge(joints, position, before.target)
        steps, targets_reached = before.steps + 1, before.targets_reached + reached
        terminated = reached & (targets_reached == task.targets_per_episode)
        truncated = ~terminated & (steps == task.max_steps)
        target = self._next_target(before.target, reached & ~terminated, which)
        self.episodes = Episodes(joints, position, target, steps, targets_reached, before.violations + risky, risky)
        return BatchStep(self._observation(), reward, terminated, truncated, *self.episodes[4:])

    def _ended(self, step: BatchStep, over: Array) -> BatchStep:
        """A step as it is seen where episodes begin instead."""
        observation = self._begin(over)
        reward = self._arrays.chosen(over, 0.0, step.reward)
        return BatchStep(observation, reward, step.terminated & ~over, step.truncated & ~over, *self.episodes[4:])

    def _next_target(self, target: Array, replaced: Array, which: Array) -> Array:
        drawn = self._target(self._draws.take(replaced & which, self._task.target_draws))
        return self._arrays.chosen(replaced, drawn, target)

    def _target(self, uniforms: Array) -> Array:
        """``ReachTask.draw_target`` of uniforms, shape (N, target_draws)."""
        points = self._targets[self._index(uniforms[:, 0], len(self._targets))]
        if self._task.target_spread:
            for column, axis in enumerate(self.task.axes, 1):
                points[:, axis] += offset(uniforms[:, column], self._task.target_spread)
        return points

    def _index(self, uniforms: Array, count: int) -> Array:
        return self._arrays.cast(uniforms * count, "int64")

    def _observation(self) -> Array:
        now = self.episodes
        return self._arrays.cast(self.task.observe(now.joints, now.position, now.target), "float32")

    def state_dict(self) -> dict[str, Array]:
        """All that the next steps depend on, each with N as its leading dimension: a row is one environment's."""
        episodes = {name: self._arrays.copied(each) for name, each in self.episodes._asdict().items()}
        return episodes | self._draws.state()

    def load_state_dict(self, state: dict[str, Array]) -> None:
        """Go on from a ``state_dict``, of this batch or another, of numpy or torch.

        Raises:
            RledError: names or shapes of another batch.
        """
        mine = self.state_dict()
        if state.keys() != mine.keys():
            raise RledError(f"a state of {', '.join(state)}", ", ".join(mine))
        self.episodes = Episodes(
            *(self._arrays.copied(self._arrays.array(state[name], None)) for name in Episodes._fields)
        )
        self._draws.load(state)
        self._begun = True
