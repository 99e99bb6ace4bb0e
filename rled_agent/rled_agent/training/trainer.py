"""The training loop: the same for an environment in this process and for one over the graph."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import Actor, GateCode

from rled_agent.exploration.strategy import Choice, PolicyFunction, Strategy, network_function
from rled_agent.methods.method import Learning
from rled_agent.nn.scaling import Scaling
from rled_agent.replay.transitions import Source, Step
from rled_agent.training.checkpoint import Checkpoint
from rled_agent.training.config import Schedule
from rled_agent.training.environments import Asynchronous, Environment, is_repeatable
from rled_agent.training.learning_state import (
    learning_state,
    pack,
    part_of,
    restore_learning,
    restoring,
    whole_number,
)
from rled_agent.training.metrics import MetricsAccumulator
from rled_agent.training.rollout import EpisodeResult, mean_result, roll_out

EVALUATION_SEED = 1_000_000
SEEDS = 2**31


class DivergenceError(RledError):
    """A loss that is no number."""


class Environments(NamedTuple):
    """Where a run learns.

    Attributes:
        training: to act in.
        evaluation: another one of the same kind, to be looked at in.
        scaling: of observations and actions.
    """

    training: Environment
    evaluation: Environment
    scaling: Scaling


class Trainer:
    """One run: environment, what learns, who acts, and counters.

    Args:
        environments: where it learns.
        learning: learner, replay and batches.
        strategy: who acts.
        schedule: when to do what.
        generator: draws the seeds of episodes.
        has_expert: whether an expert might act.
    """

    def __init__(
        self,
        environments: Environments,
        learning: Learning,
        strategy: Strategy,
        schedule: Schedule,
        generator: np.random.Generator,
        has_expert: bool,
    ) -> None:
        self.env, self.evaluation_env, self.scaling = environments
        self.learning, self.strategy, self.schedule, self.generator = learning, strategy, schedule, generator
        self.has_expert = has_expert
        self.step = 0
        self.act = network_function(learning.learner.actor)
        self.metrics = MetricsAccumulator()
        self._begin_episode(int(generator.integers(SEEDS)))

    def _begin_episode(self, seed: int) -> None:
        self._episode_seed, self._episode_actions = seed, list[NDArray[np.float32]]()
        self._episode = EpisodeResult()
        observation, _ = self.env.reset(seed=seed)
        self._observation = self.scaling.normalize_observation(observation)
        self.strategy.begin()

    def advance(self) -> None:
        """One environment step, and while it is on its way the gradient steps that are due."""
        choice = self.strategy.act(self._observation)
        if isinstance(self.env, Asynchronous):
            self.env.begin(self._physical(choice.action))
        schedule = self.schedule
        if self.step and self.step >= schedule.train_after and self.step % schedule.train_every == 0:
            self._learn(schedule.gradient_steps)
        step, info = self._transition(choice)
        self.learning.replay.add(step)
        self.metrics.count(choice, step.reward, info)
        self._observation = step.next_observation
        self.step += 1
        if step.is_last:
            self.metrics.episodes.append(self._episode)
            self.strategy.end(self._episode.reward)
            self._begin_episode(int(self.generator.integers(SEEDS)))

    def _physical(self, action: NDArray[np.float32]) -> NDArray[np.float32]:
        return self.scaling.denormalize_action(action).astype(np.float32)

    def _transition(self, choice: Choice) -> tuple[Step, Mapping[str, Any]]:
        """Act, and count the step."""
        observation, reward, terminated, truncated, info = self.env.step(self._physical(choice.action))
        self._episode_actions.append(choice.action)
        self._episode = self._episode.after(float(reward), info)
        following = self.scaling.normalize_observation(observation)
        discount, source = self.learning.gamma * (1.0 - terminated), Source[choice.actor.name]
        is_last = bool(terminated or truncated)
        return Step(self._observation, choice.action, float(reward), discount, following, source, is_last), info

    def _learn(self, gradient_steps: int) -> None:
        for _ in range(gradient_steps):
            update = self.learning.update(self.schedule.batch_size)
            self.metrics.updates.append(update)
        if gradient_steps and not math.isfinite(float(update.td_error.sum())):
            raise DivergenceError(f"a loss is no number at step {self.step}", "", "lower the learning rates")

    def evaluate(self) -> dict[str, float]:
        """Mean result of the actor without noise or dropout, on the same episodes every time."""
        return self.evaluate_function(self.act)

    def evaluate_function(self, act: PolicyFunction) -> dict[str, float]:
        """Mean result of any policy, on those episodes."""
        scaling = self.scaling

        def physical(observation: NDArray[Any]) -> NDArray[np.float32]:
            return scaling.denormalize_action(act(scaling.normalize_observation(observation))).astype(np.float32)

        return mean_result(roll_out(self.evaluation_env, physical, self.schedule.evaluation_episodes, EVALUATION_SEED))

    def checkpoint(self) -> Checkpoint:
        """All state, taken where an interval of metrics has just been closed."""
        actions = np.array(self._episode_actions, dtype=np.float32)
        episode = {"actions": torch.from_numpy(actions), "seed": self._episode_seed}
        run = {
            "step": self.step,
            "generator": self.generator.bit_generator.state,
            "strategy": self.strategy.state_dict(),
        }
        return pack(**learning_state(self.learning), episode=episode, run=run)

    def restore(self, checkpoint: Checkpoint) -> bool:
        """Go on: bit for bit where the environment can be brought to where it was, else with a new episode.

        Returns:
            Whether the episode goes on where it was.

        Raises:
            TensorFileError: of another configuration or environment, or not as ``checkpoint`` made it.
        """
        with restoring("the checkpoint"):
            restore_learning(checkpoint, self.learning)
            run, episode = part_of(checkpoint, "run"), part_of(checkpoint, "episode")
            self.step = whole_number(run, "step")
            repeats = is_repeatable(self.env)
            if repeats:
                self._repeat(whole_number(episode, "seed"), episode["actions"].numpy())
            self.generator.bit_generator.state = run["generator"]
            self.strategy.load_state_dict(run["strategy"])
        if not repeats:
            self.learning.replay.cut()
            self._begin_episode(int(self.generator.integers(SEEDS)))
        return repeats

    def _repeat(self, seed: int, actions: NDArray[np.float32]) -> None:
        """Bring the environment to where an episode was: the seed and the actions again."""
        self._begin_episode(seed)
        for action in actions:
            before = Choice(action, Actor.AGENT, GateCode.UNGATED)
            self._observation = self._transition(before)[0].next_observation
