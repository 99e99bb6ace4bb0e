"""Command: a learner of Stable-Baselines3 on a task of this project, with metrics in the form of train_agent's."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import gymnasium
import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from rled_msgs_py.bags import Bag
from rled_msgs_py.errors import RledError, command_line
from rled_msgs_py.validation import Range, check_fields

from rled_agent.bounds import Amount, Count, Seed, Share
from rled_agent.data.closed_form import demonstration_points
from rled_agent.methods.td3 import TD3
from rled_agent.nn.scaling import Scaling, scaling_of_points
from rled_agent.training.config import TrainConfig
from rled_agent.training.digests import bag_digest
from rled_agent.training.environment_batch import Environment, task_of
from rled_agent.training.environments import make_environment, require_robot_of
from rled_agent.training.evaluating import EVALUATION_SEED
from rled_agent.training.progress import Progress
from rled_agent.training.rollout import mean_result, roll_out
from rled_agent.training.run_directory import RunDirectory


@dataclass(frozen=True)
class Options:
    """Train TD3 or SAC of Stable-Baselines3 without demonstrations; episodes start at the bag's marked points."""

    output: Path
    """folder of the run"""
    bag: Path
    """demonstrations whose marked points are where episodes start"""
    algorithm: Literal["td3", "sac"] = "td3"
    """learner of Stable-Baselines3, with its own settings where nothing else is said"""
    env: str = "rled/PandaReach-v0"
    """Gymnasium environment"""
    reward: Literal["dense", "sparse"] = "sparse"
    """reward function of section 4.1.3"""
    steps: Count = 200_000
    """environment steps, each with a gradient step"""
    train_after: Count = 1_000
    """steps before the first gradient step"""
    batch_size: Annotated[int, Range(1, 1_000_000)] = 100
    """transitions in a gradient step"""
    gamma: Share = 0.99
    """discount factor γ"""
    reward_scale: Amount = 1.0
    """what rewards are multiplied by before the learner sees them"""
    noise: Annotated[float, Range(0, 10)] = 0.1
    """td3: std of the exploration noise, in halves of the action range"""
    evaluate_every: Count = 5_000
    """steps between evaluations"""
    evaluation_episodes: Annotated[int, Range(1, 100_000)] = 20
    """episodes in an evaluation"""
    seed: Seed = 0
    """of everything that is drawn"""


class Scaled(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment whose observations, actions and rewards are scaled as train_agent's networks see them."""

    def __init__(self, env: Environment, scaling: Scaling, reward_scale: float = 1.0) -> None:
        super().__init__(env)
        self._scaling, self._reward_scale = scaling, reward_scale
        sizes = len(scaling.observation_scale), len(scaling.action_scale)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (sizes[0],), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (sizes[1],), np.float32)

    def reset(self, **options: Any) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """As of the environment."""
        observation, info = self.env.reset(**options)
        return self._scaling.normalize_observation(observation), info

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """As of the environment."""
        physical = self._scaling.denormalize_action(np.asarray(action)).astype(np.float32)
        observation, reward, terminated, truncated, info = self.env.step(physical)
        paid = self._reward_scale * float(reward)
        return self._scaling.normalize_observation(observation), paid, terminated, truncated, info


@command_line
def main() -> None:
    """Run the command."""
    options = tyro.cli(Options, prog="train_baseline")
    check_fields(options)
    directory = RunDirectory(options.output)
    directory.require_new()
    torch.set_num_threads(1)
    config = TrainConfig(TD3(), env=options.env, reward=options.reward, seed=options.seed)
    bag = Bag(options.bag)
    require_robot_of(bag.task, options.env, f"bag {bag.path}")
    points = demonstration_points(bag)
    env, evaluation_env = (make_environment(config, points.joints) for _ in range(2))
    task = task_of(env)
    if task is None:
        raise RledError(f"env '{options.env}' has no robot that a bag could be of", "an environment of rled")
    scaling = scaling_of_points(task, points.positions, points.joints)
    model = _make(options, Scaled(env, scaling, options.reward_scale))
    record = asdict(options) | {"bag_sha256": bag_digest(bag)}
    directory.create({"config": json.loads(json.dumps(record, default=str))})
    with Progress("step", options.steps) as progress:
        model.learn(options.steps, callback=_evaluation(options, Scaled(evaluation_env, scaling), directory, progress))


def _make(options: Options, env: Environment) -> Any:
    try:
        from stable_baselines3 import SAC, TD3
        from stable_baselines3.common.noise import NormalActionNoise
    except ImportError:
        raise RledError("stable-baselines3 is not installed", "", "pip install stable-baselines3") from None
    settings: dict[str, Any] = {
        "learning_rate": 1e-3,
        "gamma": options.gamma,
        "batch_size": options.batch_size,
        "learning_starts": options.train_after,
        "seed": options.seed,
        "policy_kwargs": {"net_arch": [400, 300]},
        "device": "cpu",
    }
    if options.algorithm == "sac":
        return SAC("MlpPolicy", env, **settings | {"learning_rate": 3e-4})
    size = env.action_space.shape[0]
    noise = NormalActionNoise(np.zeros(size), np.full(size, options.noise))
    return TD3("MlpPolicy", env, action_noise=noise, **settings)


def _evaluation(
    options: Options, env: Environment, directory: RunDirectory, progress: Progress
) -> Callable[[dict[str, Any], dict[str, Any]], bool]:
    """What Stable-Baselines3 calls after each step."""

    def after_step(local: dict[str, Any], _: dict[str, Any]) -> bool:
        model = local["self"]
        step = int(model.num_timesteps)
        progress.move(step)
        if step % options.evaluate_every == 0:

            def act(observation: NDArray[Any]) -> NDArray[np.float32]:
                action: NDArray[np.float32] = model.predict(observation, deterministic=True)[0]
                return action

            result = mean_result(roll_out(env, act, options.evaluation_episodes, EVALUATION_SEED))
            directory.append({"step": float(step), **{f"evaluation_{name}": each for name, each in result.items()}})
            progress.say(step, {"targets": result["targets_reached"]})
        return True

    return after_step


if __name__ == "__main__":
    main()
