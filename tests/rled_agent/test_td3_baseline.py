"""TD3 against that of Stable-Baselines3: given the same draws, both training loops make the same transitions.

Two differences are left out here. Stable-Baselines3 adds exploration noise to the random first actions, too, and its
batches may hold the newest transition already.
"""

import gymnasium
import numpy as np
import pytest
import torch
from rled_agent.methods.method import Problem
from rled_agent.methods.td3 import TD3
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.scaling import scaling_of_bounds
from rled_agent.training.config import Schedule
from rled_agent.training.environment_batch import OneByOne
from rled_agent.training.environments import bounds
from rled_agent.training.trainer import Environments, Trainer

STEPS, RANDOM, BATCH, LIMIT = 200, 100, 64, 7  # then rounding has grown from 1e-7 to 1e-5
COLUMNS = ("observation", "action", "reward", "discount", "next observation")


class Slope(gymnasium.Env):
    """A point on a line that rolls off: beyond 1 m the episode is terminated, after some steps it is cut."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (2,))
    action_space = gymnasium.spaces.Box(-3.0, 3.0, (1,))

    def __init__(self) -> None:
        self.seeds: list[int] = []

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.seeds.append(seed)
        self.state, self.count = self.np_random.uniform(-0.5, 0.5, 2), 0
        return self.state.astype(np.float32), {}

    def step(self, action):
        x, v = self.state
        v += 0.1 * float(action[0]) + 0.2 * x
        self.state, self.count = np.array([x + 0.3 * v, v]), self.count + 1
        reward = 1.0 - x**2 - 0.1 * float(action[0]) ** 2
        return self.state.astype(np.float32), reward, bool(abs(x) > 1.0), self.count == LIMIT, {}


class Shared(Draws):
    """The same numbers for both: of random actions, exploration noise and target noise, each in its own order."""

    def __init__(self) -> None:
        super().__init__([0])
        self.actions, self.noise = np.random.default_rng(0).spawn(2)

    def uniform(self, *shape):
        if shape != (1,):  # of weights
            return super().uniform(*shape)
        return torch.from_numpy(self.actions.uniform(0.0, 1.0, (1, 1)).astype(np.float32))

    def normal(self, *shape):
        if shape != (1,):  # of targets, whose seed ``places`` has set
            return torch.empty(1, *shape).normal_()
        return torch.from_numpy(self.noise.normal(0.0, 1.0, (1, 1)).astype(np.float32))


def places(update: int) -> np.ndarray:
    """Of an update's batch in the replay, among as many transitions as ours holds then; seeds its target noise, too."""
    torch.manual_seed(update)
    return np.random.default_rng(update).integers(0, RANDOM + update, BATCH)


def linear_layers(network: torch.nn.Module) -> list[torch.nn.Linear]:
    return [each for each in network.modules() if isinstance(each, torch.nn.Linear)]


@torch.no_grad()
def give(ours: Perceptron, theirs: list[torch.nn.Module]) -> None:
    """Our weights to the networks of Stable-Baselines3, one for each member."""
    for member, network in enumerate(theirs):
        for layer, weight, bias in zip(linear_layers(network), ours.weights, ours.biases, strict=True):
            layer.weight.copy_(weight[member].T)
            layer.bias.copy_(bias[member, 0])


def our_trainer() -> Trainer:
    """With first weights of their own, and all that is drawn later from ``Shared`` and ``places``."""
    method, env = TD3(random_steps=RANDOM), Slope()
    problem = Problem(2, 1, STEPS, Shared())
    learning = method.learning(problem)
    learner, replay = learning.learner, learning.replay
    replay.sample = lambda size: replay.at(torch.from_numpy(places(learner.updates))[None])
    scaling = scaling_of_bounds(bounds(env.observation_space), bounds(env.action_space))
    schedule = Schedule(steps=STEPS, train_after=RANDOM, batch_size=BATCH)
    strategy = method.strategy(problem, learner)
    training, evaluation = (OneByOne([each], torch.device("cpu")) for each in (env, Slope()))
    return Trainer(Environments(training, evaluation, scaling), learning, strategy, schedule, has_expert=False)


def their_model(seeds: list[int]):
    """With no noise on random actions, as ours, and episodes of the seeds given."""
    baselines = pytest.importorskip("stable_baselines3")
    coming, draws = iter(seeds), Shared()

    class Seeded(gymnasium.Wrapper):
        def reset(self, **options):
            return self.env.reset(seed=next(coming))

    class Noise:
        def __call__(self):
            return 0.1 * draws.normal(1)[0].numpy() if model.num_timesteps >= RANDOM else np.zeros(1)

        def reset(self):
            pass

    settings = {"learning_rate": 1e-3, "learning_starts": RANDOM, "batch_size": BATCH, "device": "cpu"}
    model = baselines.TD3("MlpPolicy", Seeded(Slope()), policy_kwargs={"net_arch": [400, 300]}, **settings)
    model.action_noise = Noise()
    model.action_space.sample = lambda: 3.0 * (2.0 * draws.uniform(1)[0].numpy() - 1.0)
    buffer = model.replay_buffer
    buffer.sample = lambda size, env=None: buffer._get_samples(places(model._n_updates - 1))
    return model


def test_transitions_are_those_of_stable_baselines3_on_the_same_draws():
    trainer = our_trainer()
    first = {name: each.frozen() for name, each in trainer.learning.learner.networks().items()}
    for _ in range(STEPS):
        trainer.advance()
    model = their_model([*trainer.env._envs[0].seeds, 0])
    give(first["actor"], [model.actor])
    give(first["target_actor"], [model.actor_target])
    give(first["critic"], model.critic.q_networks)
    give(first["target_critic"], model.critic_target.q_networks)
    model.learn(STEPS)

    held = model.replay_buffer
    is_terminated = held.dones * (1.0 - held.timeouts)
    theirs = (
        held.observations[:STEPS, 0],
        held.actions[:STEPS, 0],
        held.rewards[:STEPS],
        0.99 * (1.0 - is_terminated[:STEPS]),
        held.next_observations[:STEPS, 0],
    )
    ours = trainer.learning.replay.at(torch.arange(STEPS)[None])
    for name, own, other in zip(COLUMNS, ours, theirs, strict=False):
        np.testing.assert_allclose(own[0].numpy(), other, rtol=0.0, atol=1e-4, err_msg=name)
    assert is_terminated.any()
    assert held.timeouts.any()
    assert trainer.learning.learner.updates == model._n_updates == STEPS - RANDOM
