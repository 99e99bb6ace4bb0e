"""The training loop: the same for an environment in this process and for one over the graph."""

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError

from rled_agent.behaviour import Behaviour, BiasedExploration, MonteCarloGate, Noise, Source, actor_source
from rled_agent.checkpoint import Checkpoint
from rled_agent.config import TrainConfig
from rled_agent.environments import Elsewhere, Environment
from rled_agent.expertise import Expertise
from rled_agent.interval import Interval
from rled_agent.learners.td3 import Learner
from rled_agent.learning_state import pack, restoring, unpack, whole_number
from rled_agent.peer_behaviour import JumpStart, Proposal
from rled_agent.replay import Batch, Replay
from rled_agent.rollout import EpisodeResult, mean_result, roll_out
from rled_agent.uncertainty import MonteCarlo

EVALUATION_SEED = 1_000_000
SEEDS = 2**31


class DivergenceError(RledError):
    """A loss that is no number."""


class Trainer:
    """One run: environment, learner, behaviour, replay and counters.

    Args:
        env: to learn in.
        evaluation_env: another one of the same kind, to be looked at in.
        config: settings.
        expertise: the expert and the scaling.
    """

    def __init__(
        self, env: Environment, evaluation_env: Environment, config: TrainConfig, expertise: Expertise
    ) -> None:
        self.config, self.env, self.evaluation_env, self.expertise = config, env, evaluation_env, expertise
        self.step = 0
        self.generator = np.random.default_rng(config.seed)
        torch_generator = torch.Generator().manual_seed(int(self.generator.integers(2**63)))
        sizes = len(expertise.scaling.observation_scale), len(expertise.scaling.action_scale)
        self.learner = Learner(*sizes, config.learner, torch_generator, expertise.source)
        self.replay = Replay(*sizes, config.schedule.capacity)
        if config.schedule.preload and expertise.rows is not None:
            self.replay.extend(expertise.rows.sample(config.schedule.preload, self.generator).numpy())
        self._act = actor_source(self.learner.actor)
        self.behaviour = self._make_behaviour()
        self.interval = Interval()
        self._begin_episode(int(self.generator.integers(SEEDS)))

    def _make_behaviour(self) -> Behaviour:
        settings, source = self.config.behaviour, self.expertise.source
        noise = Noise(settings.noise, self.generator)
        unsure = None
        if self.config.learner.actor.dropout:
            unsure = MonteCarlo(self.learner.actor, settings.passes, self.generator)
        if settings.name in ("jump_start", "proposal"):
            return self._make_peer(noise)
        if settings.name == "biased":
            return BiasedExploration(self._act, source, noise, settings.phi, self.generator, unsure)
        if unsure is None or source is None:
            lacks = "demonstrations" if source is None else "dropout in the actor"
            raise RledError(f"the Monte-Carlo gate lacks {lacks}", "", "give --bag and learner.actor.dropout > 0")
        return MonteCarloGate(unsure, source, noise, settings.threshold, settings.measure)

    def _make_peer(self, noise: Noise) -> Behaviour:
        settings, expert = self.config.behaviour, self.expertise.source
        if expert is None:
            raise RledError(f"behaviour {settings.name} lacks demonstrations", "", "give --bag and --expert")
        if settings.name == "proposal":
            return Proposal(self._act, expert, noise, self.learner.value)
        return JumpStart(
            self._act, expert, noise, settings.guide_steps, settings.guide_stages, settings.guide_tolerance
        )

    def _begin_episode(self, seed: int) -> None:
        self._episode_seed, self._episode_actions = seed, list[NDArray[np.float32]]()
        self._episode = EpisodeResult(0.0, 0, 0, 0)
        observation, _ = self.env.reset(seed=seed)
        self._observation = self.expertise.scaling.normalize_observation(observation)
        self.behaviour.begin()

    def advance(self) -> None:
        """One environment step, and while it is on its way the gradient steps that are due."""
        choice = self.behaviour.act(self._observation)
        if isinstance(self.env, Elsewhere):
            self.env.begin(self._physical(choice.action))
        schedule = self.config.schedule
        if self.step and self.step >= schedule.train_after and self.step % schedule.train_every == 0:
            self._learn(schedule.gradient_steps)
        reward, risky, terminated, truncated, observation = self._transition(choice.action)
        self.replay.add(self._observation, choice.action, reward, terminated, observation)
        self.interval.count(choice, reward, risky)
        self._observation = observation
        self.step += 1
        if terminated or truncated:
            self.interval.episodes.append(self._episode)
            self.behaviour.end(self._episode.reward)
            self._begin_episode(int(self.generator.integers(SEEDS)))

    def _physical(self, action: NDArray[np.float32]) -> NDArray[np.float32]:
        return self.expertise.scaling.denormalize_action(action).astype(np.float32)

    def _transition(self, action: NDArray[np.float32]) -> tuple[float, bool, bool, bool, NDArray[np.float32]]:
        scaling = self.expertise.scaling
        observation, reward, terminated, truncated, info = self.env.step(self._physical(action))
        self._episode_actions.append(action)
        before = self._episode
        self._episode = EpisodeResult(
            before.reward + float(reward),
            before.steps + 1,
            int(info.get("targets_reached", 0)),
            int(info.get("violations", 0)),
        )
        risky = bool(info.get("risky", False))
        return float(reward), risky, terminated, truncated, scaling.normalize_observation(observation)

    def _learn(self, gradient_steps: int) -> None:
        for _ in range(gradient_steps):
            self.interval.updates.append(self.learner.update(self._batch()))
        if gradient_steps and not math.isfinite(self.interval.updates[-1].critic_loss):
            raise DivergenceError(f"the critic's loss is no number at step {self.step}", "", "lower the learning rates")

    def _batch(self) -> Batch:
        size, share = self.config.schedule.batch_size, self.config.schedule.expert_share
        demonstrated = round(size * share) if self.expertise.rows else 0
        batch = self.replay.sample(size - demonstrated, self.learner.generator)
        if not demonstrated or self.expertise.rows is None:
            return batch
        rows = torch.cat((batch.rows, self.expertise.rows.sample(demonstrated, self.generator)))
        return Batch(rows, batch.observation_size, batch.action_size, demonstrated)

    def evaluate(self) -> dict[str, float]:
        """Mean result of the actor without noise or dropout, on the same episodes every time."""
        return self.evaluate_source(self._act)

    def evaluate_source(self, act: Source) -> dict[str, float]:
        """Mean result of any map of normalised observations to actions, on those episodes."""
        scaling = self.expertise.scaling

        def physical(observation: NDArray[Any]) -> NDArray[np.float32]:
            return scaling.denormalize_action(act(scaling.normalize_observation(observation))).astype(np.float32)

        results = roll_out(self.evaluation_env, physical, self.config.schedule.evaluation_episodes, EVALUATION_SEED)
        return mean_result(results)

    def checkpoint(self) -> Checkpoint:
        """All state, taken where an interval of metrics has just been closed."""
        tensors, state = pack(self.learner, self.replay)
        actions = np.array(self._episode_actions, dtype=np.float32)
        tensors["episode.actions"] = torch.from_numpy(actions.reshape(-1, self.replay.action_size))
        state |= {
            "step": self.step,
            "behaviour_generator": self.generator.bit_generator.state,
            "episode_seed": self._episode_seed,
            "behaviour": self.behaviour.state(),
        }
        return Checkpoint(tensors, state)

    def restore(self, checkpoint: Checkpoint) -> None:
        """Continue bit for bit: the episode is begun again with its seed and its actions.

        Raises:
            CheckpointError: of another configuration or environment, or not as ``checkpoint`` made it.
        """
        unpack(checkpoint, self.learner, self.replay)
        with restoring("the checkpoint"):
            tensors, state = checkpoint
            self._begin_episode(whole_number(state, "episode_seed"))
            for action in tensors["episode.actions"].numpy():
                *_, self._observation = self._transition(action)
            self.step = whole_number(state, "step")
            self.generator.bit_generator.state = state["behaviour_generator"]
            self.behaviour.restore(state["behaviour"])
