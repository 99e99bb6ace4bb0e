"""N kinematic robots at the reach task, each in an episode of its own, stepped together."""

from collections.abc import Sequence
from typing import NamedTuple

from numpy.typing import ArrayLike
from rled_msgs_py.errors import RledError
from rled_msgs_py.task import Reward, TaskDescription

from rled_sim.faults import NO_FAULTS, Faults, require_faults
from rled_sim.robots import robot_named
from rled_sim.tasks import reach_task
from rled_sim.vector.arrays import Array, Arrays
from rled_sim.vector.faults import BatchFaultChannel
from rled_sim.vector.simulation import BatchSimulation, Episodes
from rled_sim.vector.stateful import Stateful


class BatchStep(NamedTuple):
    """What one step gives.

    Attributes:
        observation: of the states that the transitions led to, shape (N, o), float32.
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


class ReachBatch:
    """N environments, each with the numbers that ``ReachEnv`` has by itself with its seed.

    The robots are displaced as Eq. 4.28 says; their tips are those of the kinematics, within 1e-7 m of PyBullet's. On a
    device one call in many waits for it, to draw ahead; all the others read nothing back.

    Attributes:
        task: what is asked of the robots.
        num_envs: N.
        episodes: how far they have come, and where robots and targets really are.
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
        faults: Faults = NO_FAULTS,
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
            faults: between whoever acts and the robots, as of ``FaultyReach``.
            device: of torch's tensors, such as ``cpu`` or ``cuda``; numpy when None.

        Raises:
            RledError: settings that do not fit, or no such device.
        """
        if num_envs < 1:
            raise RledError(f"num_envs is {num_envs}", "1 or more")
        require_faults(faults)
        chosen = robot_named(robot)
        task = reach_task(
            chosen,
            reward=reward,
            targets_per_episode=targets_per_episode,
            max_steps=max_steps,
            target_spread=target_spread,
        )
        self.task: TaskDescription = task.description
        self.num_envs, self._arrays = num_envs, Arrays(device)
        self._simulation = BatchSimulation(self._arrays, num_envs, chosen, task, start_joints)
        self._channel = (
            BatchFaultChannel(self._arrays, num_envs, faults, task.description, chosen.chain.position)
            if faults.any
            else None
        )
        self._all = self._arrays.full((num_envs,), True, "bool")
        self.episodes, self._begun = self._simulation.nothing(num_envs), False

    def seed(self, seeds: Sequence[int | None]) -> None:
        """Begin each environment's draws anew, as ``ReachEnv.reset(seed=)`` does; where None is given, they go on.

        Raises:
            RledError: another number of seeds, or some that are none.
        """
        self._simulation.draws.seed(seeds)
        if self._channel is not None:
            self._channel.draws.seed(seeds)

    def mask(self, which: Array) -> Array:
        """A mask of environments as these arrays have it.

        Raises:
            RledError: another shape than (N,).
        """
        mask = self._arrays.array(which, "bool")
        if mask.shape != (self.num_envs,):
            raise RledError(f"a mask of shape {tuple(mask.shape)}", f"({self.num_envs},)")
        return mask

    def begin(self, which: Array | None = None) -> Array:
        """Begin episodes.

        Args:
            which: the environments that begin one, shape (N,); all when None. What never began is NaN.

        Returns:
            The observations of all environments, shape (N, o), float32.

        Raises:
            RledError: a mask of another shape.
        """
        mask = self._all if which is None else self.mask(which)
        self._reserve()
        self._begun = True
        return self._begin(mask)

    def step(self, action: Array, over: Array | None = None) -> BatchStep:
        """Displace the joints.

        Episodes that are over go on as others do; whoever steps begins the next ones, with ``begin`` or the mask.

        Args:
            action: Δq (rad), shape (N, n), clipped to ±Δq_max; a NaN makes its environment NaN until that begins anew.
            over: environments that begin an episode instead of a step, shape (N,): their action counts nothing, their
                reward is 0. None do when None.

        Raises:
            RledError: no episode has begun, or an array of another shape.
        """
        if not self._begun:
            raise RledError("no episode has begun", "", "call begin first, or reset of a Gymnasium environment")
        delta = self._arrays.array(action)
        if delta.shape != self.episodes.joints.shape:
            raise RledError(f"actions of shape {tuple(delta.shape)}", f"({self.num_envs}, {self.task.action_size})")
        ended = None if over is None else self.mask(over)
        self._reserve()
        return self._step(delta, self._all) if ended is None else self._step_or_begin(delta, ended)

    def _reserve(self) -> None:
        self._simulation.draws.reserve()
        if self._channel is not None:
            self._channel.draws.reserve()

    def _begin(self, which: Array) -> Array:
        self.episodes = self._simulation.begun(self.episodes, which)
        if self._channel is None:
            return self._simulation.observation(self.episodes)
        return self._channel.begin(which, self.episodes)

    def _step(self, delta: Array, which: Array) -> BatchStep:
        """A step of all; where ``which`` does not hold it draws nothing and means nothing."""
        if self._channel is not None:
            delta = self._channel.act(which, self._arrays.xp.clip(delta, -self.task.max_delta, self.task.max_delta))
        self.episodes, outcomes = self._simulation.stepped(self.episodes, delta, which)
        reward, terminated, truncated = outcomes
        if self._channel is None:
            observation = self._simulation.observation(self.episodes)
        else:
            observation, reward = self._channel.see(which, self.episodes, reward, terminated | truncated)
        return BatchStep(observation, reward, terminated, truncated, *self.episodes[4:])

    def _step_or_begin(self, delta: Array, over: Array) -> BatchStep:
        step = self._step(delta, ~over)
        observation = self._begin(over)
        reward = self._arrays.chosen(over, 0.0, step.reward)
        return BatchStep(observation, reward, step.terminated & ~over, step.truncated & ~over, *self.episodes[4:])

    def state_dict(self) -> dict[str, Array]:
        """All that the next steps depend on, each with N as its leading dimension: a row is one environment's."""
        episodes = {name: self._arrays.copied(each) for name, each in self.episodes._asdict().items()}
        parts = {
            f"{part}.{name}": each for part, owner in self._parts().items() for name, each in owner.state().items()
        }
        return episodes | parts

    def load_state_dict(self, state: dict[str, Array]) -> None:
        """Go on from a ``state_dict`` of this batch or of another with its settings, of numpy or torch.

        Raises:
            RledError: names or shapes of another batch.
        """
        mine = self.state_dict()
        if state.keys() != mine.keys():
            raise RledError(f"a state of {', '.join(state)}", ", ".join(mine))
        given = {name: self._arrays.copy_like(each, state[name], name) for name, each in mine.items()}
        for part, owner in self._parts().items():
            owner.load({name: given[f"{part}.{name}"] for name in owner.STATE})
        self.episodes, self._begun = Episodes(*(given[name] for name in Episodes._fields)), True

    def _parts(self) -> dict[str, Stateful]:
        return {"draws": self._simulation.draws} | ({} if self._channel is None else self._channel.parts())
