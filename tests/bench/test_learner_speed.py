"""Gradient steps per second against Stable-Baselines3, a plain eager TD3, and the matrix products alone."""

import copy
import itertools
import statistics
import time
from functools import partial

import gymnasium
import numpy as np
import pytest
import torch
from rled_agent.learners.td3 import TD3Config, TD3Learner
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.replay.transitions import Transitions
from rled_agent.replay.uniform import UniformReplay
from rled_agent.uncertainty.uncertainty import MonteCarloDropout
from torch import nn

from .conftest import wanted

OBSERVATION, ACTION, BATCH, HIDDEN = 10, 7, 100, (400, 300)
ROUNDS, STEPS = 9, 100


@pytest.fixture(autouse=True)
def _one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    yield
    torch.set_num_threads(threads)


def rates(contenders, steps=STEPS, rounds=ROUNDS):
    """Calls per second of each contender, alternating, as lists over the rounds."""
    seen = {name: [] for name in contenders}
    for call in contenders.values():
        for _ in range(20):
            call()
    for _ in range(rounds):
        for name, call in contenders.items():
            started = time.perf_counter()
            for _ in range(steps):
                call()
            seen[name].append(steps / (time.perf_counter() - started))
    return seen


def ratio(seen, over, under):
    """Median of the ratios within each round, so that a slow moment of the machine hits both."""
    return statistics.median(a / b for a, b in zip(seen[over], seen[under], strict=True))


def filled(replay):
    replay.rows.normal_(generator=torch.Generator().manual_seed(0))
    replay.rows[..., OBSERVATION + ACTION + 1] = 0.99
    replay.added = 10_000
    return replay


def ours():
    draws = Draws([0])
    learner = TD3Learner(OBSERVATION, ACTION, TD3Config(), draws)
    replay = filled(UniformReplay(OBSERVATION, ACTION, 10_000, draws))
    return lambda: learner.update(replay.sample(BATCH))


def eager():
    """TD3 as a textbook has it: autograd, torch.optim, one module a network."""
    torch.manual_seed(0)

    def perceptron(inputs, outputs, *end):
        return nn.Sequential(
            nn.Linear(inputs, 400), nn.ReLU(), nn.Linear(400, 300), nn.ReLU(), nn.Linear(300, outputs), *end
        )

    actor = perceptron(OBSERVATION, ACTION, nn.Tanh())
    critics = nn.ModuleList(perceptron(OBSERVATION + ACTION, 1) for _ in range(2))
    target_actor, target_critics = copy.deepcopy(actor), copy.deepcopy(critics)
    adam = partial(torch.optim.Adam, fused=True)  # as the learner has it
    actor_adam, critic_adam = adam(actor.parameters()), adam(critics.parameters())
    replay, count = filled(UniformReplay(OBSERVATION, ACTION, 10_000, Draws([0]))), 0

    def update():
        nonlocal count
        batch = Transitions(*(each[0] for each in replay.sample(BATCH)))
        with torch.no_grad():
            noise = (torch.randn_like(batch.action) * 0.2).clamp(-0.5, 0.5)
            action = (target_actor(batch.next_observation) + noise).clamp(-1, 1)
            after = torch.cat((batch.next_observation, action), 1)
            value = torch.min(target_critics[0](after), target_critics[1](after))
            target = batch.reward + batch.discount * value
        here = torch.cat((batch.observation, batch.action), 1)
        loss = sum(nn.functional.mse_loss(critic(here), target) for critic in critics)
        critic_adam.zero_grad()
        loss.backward()
        critic_adam.step()
        count += 1
        if count % 2 == 0:
            actor_loss = -critics[0](torch.cat((batch.observation, actor(batch.observation)), 1)).mean()
            actor_adam.zero_grad()
            actor_loss.backward()
            actor_adam.step()
            with torch.no_grad():
                for old, new in ((target_actor, actor), (target_critics, critics)):
                    for a, b in zip(old.parameters(), new.parameters(), strict=True):
                        a.lerp_(b, 5e-3)

    return update


def stable_baselines():
    sb3 = pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.logger import configure

    env = gymnasium.make("rled/PandaReach-v0")
    model = sb3.TD3("MlpPolicy", env, batch_size=BATCH, policy_kwargs={"net_arch": list(HIDDEN)}, device="cpu",
                    learning_starts=0, buffer_size=10_000, seed=0)  # fmt: skip
    model.set_logger(configure(None, []))
    model.learn(0)
    observation, _ = env.reset(seed=0)
    for _ in range(2_000):
        action = env.action_space.sample()
        following, reward, terminated, truncated, info = env.step(action)
        model.replay_buffer.add(observation[None], following[None], action[None], np.array([reward]),
                                np.array([terminated]), [info])  # fmt: skip
        observation = env.reset()[0] if terminated or truncated else following
    return lambda: model.train(gradient_steps=1, batch_size=BATCH)


def products():
    """Every matrix product of a TD3 update, on operands of its own networks, and nothing else."""
    generator = torch.Generator().manual_seed(0)

    def operands(inputs, outputs):
        sizes = (inputs, *HIDDEN, outputs)
        weights = [torch.randn(a, b, generator=generator) for a, b in itertools.pairwise(sizes)]
        rows = [torch.randn(BATCH, width, generator=generator) for width in sizes]
        return weights, [each.clone() for each in weights], rows, [each.clone() for each in rows]

    def forward(network):
        weights, _, rows, _ = network
        for k, weight in enumerate(weights):
            torch.mm(rows[k], weight, out=rows[k + 1])

    def backward(network, parameters=True, inputs_from=None):
        weights, gradients, rows, errors = network
        for k in range(len(weights) - 1, -1, -1):
            if parameters:
                torch.mm(rows[k].t(), errors[k + 1], out=gradients[k])
            if k > 0:
                torch.mm(errors[k + 1], weights[k].t(), out=errors[k])
        if inputs_from is not None:
            torch.mm(errors[1], weights[0][inputs_from:].t())

    critics, target_critics = ([operands(OBSERVATION + ACTION, 1) for _ in range(2)] for _ in range(2))
    actor, target_actor = operands(OBSERVATION, ACTION), operands(OBSERVATION, ACTION)
    count = 0

    @torch.inference_mode()
    def update():
        nonlocal count
        forward(target_actor)
        for each in (*target_critics, *critics):
            forward(each)
        for each in critics:
            backward(each)
        count += 1
        if count % 2 == 0:
            forward(actor)
            forward(critics[0])
            backward(critics[0], parameters=False, inputs_from=OBSERVATION)
            backward(actor)

    return update


def test_the_learner_outpaces_stable_baselines_and_nears_the_matrix_products(figure):
    seen = rates({"ours": ours(), "sb3": stable_baselines(), "eager": eager(), "bound": products()})
    for name, values in seen.items():
        figure(f"updates_per_s_{name}", statistics.median(values))
    for other in ("sb3", "eager", "bound"):
        figure(f"learner_vs_{other}", ratio(seen, "ours", other))
    wanted(ratio(seen, "ours", "sb3") >= 1.3, "learner_vs_sb3 of 1.3 or more")
    wanted(ratio(seen, "ours", "bound") >= 0.66, "learner_vs_bound of 0.66 or more")


def test_the_gate_costs_little_more_than_one_forward_pass(figure):
    draws = Draws([0])
    actor = Perceptron(OBSERVATION, ACTION, Architecture(HIDDEN, dropout=0.1), draws, squash=True)
    gate = MonteCarloDropout(actor, 30, draws)
    rows, row = torch.randn(30, OBSERVATION), torch.zeros(1, OBSERVATION)
    forward = torch.inference_mode()(lambda: actor(rows))
    seen = rates({"forward": forward, "gate": lambda: gate(row)}, steps=1_000)
    figure("gate_vs_forward", ratio(seen, "forward", "gate"))
    wanted(ratio(seen, "forward", "gate") <= 3.0, "gate_vs_forward of 3 at most")
