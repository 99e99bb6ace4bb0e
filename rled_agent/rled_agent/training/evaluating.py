"""What a policy comes to in whole episodes, the same ones every time, of each seed of a population."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch
from rled_sim.vector.reach import ReachBatch
from torch import Tensor

from rled_agent.exploration.strategy import PolicyFunction
from rled_agent.nn.policy import Policy
from rled_agent.nn.scaling import Affine, Scaling
from rled_agent.training.environment_batch import EnvironmentBatch, ReachEnvironments
from rled_agent.training.rollout import EpisodeResult, mean_result

EVALUATION_SEED = 1_000_000


class Units(NamedTuple):
    """Between physical units and those that networks see.

    Attributes:
        normalised: an observation, (..., o), as networks see it.
        physical: an action, (..., n), of one in [−1, 1].
    """

    normalised: Affine
    physical: Affine


def units_of(scaling: Scaling, device: torch.device) -> Units:
    """The maps of a scaling."""
    observation = 1.0 / scaling.observation_scale, -scaling.observation_center / scaling.observation_scale
    return Units(Affine([observation], device), Affine([(scaling.action_scale, scaling.action_center)], device))


class Evaluator:
    """Runs the same episodes for all seeds.

    Args:
        env: P environments, or P times as many as there are episodes, the episodes of a seed one after the other.
        episodes: of each seed.
        units: of the policies.
        seeds: P.
    """

    def __init__(self, env: EnvironmentBatch, episodes: int, units: Units, seeds: int) -> None:
        self._env, self._units, self._seeds = env, units, seeds
        self._at_once = env.size // seeds
        self._rounds = -(-episodes // self._at_once)

    def __call__(self, act: PolicyFunction) -> list[dict[str, float]]:
        """Mean result of a policy without noise, of each seed."""

        def acting(observation: Tensor) -> Tensor:
            rows = self._units.normalised(observation.view(self._seeds, self._at_once, -1))
            return torch.nan_to_num(self._units.physical(act(rows)).flatten(0, 1))  # of a seed that has diverged

        results: list[list[EpisodeResult]] = [[] for _ in range(self._seeds)]
        for k in range(self._rounds):
            first = EVALUATION_SEED + k * self._at_once
            seeds = list(range(first, first + self._at_once)) * self._seeds
            ended = iter(run_episodes(self._env, acting, seeds))
            for each in results:
                each += [next(ended) for _ in range(self._at_once)]
        return [mean_result(each) for each in results]


def evaluate_policy(policy: Policy, batch: ReachBatch, seed: int) -> dict[str, float]:
    """Mean result of one episode in each environment of a batch, seeded one after the other from ``seed``."""

    def act(observation: Tensor) -> Tensor:
        return torch.from_numpy(policy.act(observation.numpy()))

    env = ReachEnvironments(batch, torch.device("cpu"))
    return mean_result(run_episodes(env, act, range(seed, seed + batch.num_envs)))


@torch.no_grad()
def run_episodes(env: EnvironmentBatch, act: Callable[[Tensor], Tensor], seeds: Sequence[int]) -> list[EpisodeResult]:
    """One episode in each environment, all at once.

    Args:
        env: environments.
        act: actions, (N, n), of observations, (N, o), both physical.
        seeds: of each episode.
    """
    env.seed(seeds)
    everywhere = torch.ones(env.size, dtype=torch.bool)
    observation, under_way = env.begin(everywhere), everywhere
    totals = torch.zeros(env.size, len(EpisodeResult._fields), dtype=torch.float64)
    while under_way.any():
        step = env.step(act(observation))
        observation = step.observation
        told = torch.stack(
            [each.cpu().double() for each in (step.reward, step.targets_reached, step.violations)], dim=1
        )
        after = torch.cat((totals[:, :1] + told[:, :1], totals[:, 1:2] + 1.0, told[:, 1:]), dim=1)
        totals = torch.where(under_way[:, None], after, totals)
        under_way = under_way & ~(step.terminated | step.truncated).cpu()
    return [EpisodeResult(total[0], int(total[1]), total[2], total[3]) for total in totals.tolist()]
