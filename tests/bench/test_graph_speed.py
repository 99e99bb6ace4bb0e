"""Training over the graph in lockstep against the same training in process."""

import statistics
import time
from contextlib import ExitStack
from dataclasses import replace

import torch
from rled_agent.cli.presets import PANDA_BIASED
from rled_agent.methods.td3 import TD3
from rled_agent.nodes.graph_env import GraphEnv
from rled_agent.training.metrics import MetricsAccumulator
from rled_agent.training.run import Inputs, composed
from rled_msgs_py.processes import Children, program

from .conftest import wanted

ROUNDS, STEPS, LEARNING_AFTER = 7, 150, 200
SCHEDULE = replace(PANDA_BIASED.schedule, train_after=LEARNING_AFTER, train_every=1, gradient_steps=1)
CONFIG = replace(PANDA_BIASED, method=TD3(noise=0.5, learner=PANDA_BIASED.method.learner), schedule=SCHEDULE)
"""The Panda's networks, a gradient step for each step of the environment, once it learns."""


def begun(trainer):
    for _ in range(LEARNING_AFTER + 20):
        trainer.advance()
    return trainer


def rate(trainer):
    started = time.perf_counter()
    for _ in range(STEPS):
        trainer.advance()
    trainer.metrics = MetricsAccumulator()
    return STEPS / (time.perf_counter() - started)


def test_training_over_the_graph_keeps_three_quarters_of_its_pace(figure):
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    with Children() as children, ExitStack() as stack:
        children.start([*program("rled_sim", "sim_node"), "--robot", "panda"])
        inside = stack.enter_context(composed(CONFIG, Inputs()))
        over = stack.enter_context(composed(CONFIG, Inputs(), lambda _: GraphEnv(timeout=60.0)))
        runs = {"in_process": begun(inside.trainer), "over_graph": begun(over.trainer)}
        rates = {name: [] for name in runs}
        for _ in range(ROUNDS):
            for name, trainer in runs.items():
                rates[name].append(rate(trainer))
    for name, values in rates.items():
        figure(f"training_steps_per_s_{name}", statistics.median(values))
    share = statistics.median(b / a for a, b in zip(rates["in_process"], rates["over_graph"], strict=True))
    figure("training_graph_vs_process", share)
    wanted(share >= 0.75, "training_graph_vs_process of 0.75 or more")
