"""Training over the graph in lockstep against the same training in process."""

import statistics
import time
from dataclasses import replace

import torch
from rled_agent.cli.presets import PANDA_BIASED
from rled_agent.nodes.graph_env import GraphEnv
from rled_agent.training.environments import make_environment
from rled_agent.training.expertise import no_expertise
from rled_agent.training.metrics import Interval
from rled_agent.training.trainer import Trainer
from rled_msgs_py.processes import Children, program

ROUNDS, STEPS, LEARNING_AFTER = 7, 150, 200


def training(env):
    """A run with the Panda's networks, a gradient step for each step of the environment, once it learns."""
    behaviour = replace(PANDA_BIASED.behaviour, phi=0.0)
    schedule = replace(PANDA_BIASED.schedule, train_after=LEARNING_AFTER, train_every=1, gradient_steps=1)
    config = replace(PANDA_BIASED, behaviour=behaviour, schedule=schedule)
    trainer = Trainer(env, env, config, no_expertise(env, config))
    for _ in range(LEARNING_AFTER + 20):
        trainer.advance()
    return trainer


def rate(trainer):
    started = time.perf_counter()
    for _ in range(STEPS):
        trainer.advance()
    trainer.interval = Interval()
    return STEPS / (time.perf_counter() - started)


def test_training_over_the_graph_keeps_three_quarters_of_its_pace(figure):
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    with Children() as children:
        children.start([*program("rled_sim", "sim_node"), "--robot", "panda"])
        inside, over = make_environment(PANDA_BIASED, None), GraphEnv(timeout=60.0)
        runs = {"in_process": training(inside), "over_graph": training(over)}
        rates = {name: [] for name in runs}
        for _ in range(ROUNDS):
            for name, trainer in runs.items():
                rates[name].append(rate(trainer))
        inside.close()
        over.close()
    for name, values in rates.items():
        figure(f"training_steps_per_s_{name}", statistics.median(values))
    share = statistics.median(b / a for a, b in zip(rates["in_process"], rates["over_graph"], strict=True))
    figure("training_graph_vs_process", share)
    assert share >= 0.75
