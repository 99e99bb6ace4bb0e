"""The loop: what is stored, learned from, measured and kept, and how it goes on."""

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from rled_agent.data.opening import open_demonstrations
from rled_agent.exploration.uncertainty_gate import UncertaintyGate
from rled_agent.methods import all_methods
from rled_agent.methods.biased_exploration import BiasedExploration
from rled_agent.methods.method import Method, Problem
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.policy import load_policy
from rled_agent.nn.scaling import scaling_of_bounds
from rled_agent.nn.tensor_file import TensorFileError
from rled_agent.replay.transitions import Source
from rled_agent.training.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from rled_agent.training.config import TrainConfig
from rled_agent.training.environment_batch import OneByOne
from rled_agent.training.environments import make_environment
from rled_agent.training.evaluating import EVALUATION_SEED
from rled_agent.training.rollout import mean_result, roll_out
from rled_agent.training.run import Inputs, Population, composed
from rled_agent.training.trainer import DivergenceError, Environments, Trainer

from .small_runs import (
    BIASED,
    DROPPING,
    GATED,
    LEARNER,
    METHODS,
    PLAIN,
    SCHEDULE,
    SHARING,
    STILL,
    NStepPrioritised,
    assert_same,
    planar,
    run,
)

CPU = torch.device("cpu")


def test_every_method_is_looked_at():
    assert set(all_methods()) <= set(METHODS)
    assert {type(method) for method in METHODS.values()} >= set(all_methods().values())


@pytest.fixture(scope="module")
def inputs(make_policy, planar_bag: Path, tmp_path_factory) -> Inputs:
    path = tmp_path_factory.mktemp("expert") / "expert.safetensors"
    make_policy().save(path)
    return Inputs(open_demonstrations(planar_bag, "points"), (load_policy(path),))


@pytest.fixture
def compose(inputs: Inputs) -> Iterator[Callable[..., Population]]:
    with ExitStack() as stack:
        yield lambda config, given=inputs: stack.enter_context(composed([config], given))


@pytest.fixture
def make(compose: Callable[..., Population]) -> Callable[[TrainConfig], Trainer]:
    return lambda config: compose(config).trainer


def checkpoint_of(trainer: Trainer) -> Checkpoint:
    (checkpoint,) = trainer.checkpoints()
    return checkpoint


def stood_still(trainer: Trainer, steps: int) -> Trainer:
    """A run whose actor keeps the robot where it is, so that its episodes are cut after 100 steps."""
    trainer.learning.learner.actor.load_vector(0.0 * trainer.learning.learner.actor.vector())
    return run(trainer, steps)


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_same_seed_gives_the_same_state(make, method):
    one, same = (checkpoint_of(run(make(planar(method)), 150)) for _ in range(2))
    assert_same(one, same)
    other = checkpoint_of(run(make(planar(method, seed=1)), 150))
    assert not torch.equal(other.tensors["learner.actor.weights.0"], one.tensors["learner.actor.weights.0"])


@pytest.mark.parametrize("cut", [20, 130, 200])
@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_a_run_continues_from_a_checkpoint_bit_for_bit(make, method, cut, tmp_path):
    """At 20 nothing was learned yet; the replay of 150 has wrapped around at 200; at 130 an episode is under way."""
    whole = checkpoint_of(run(make(planar(method)), 330))
    write_checkpoint(tmp_path / "c.safetensors", checkpoint_of(run(make(planar(method)), cut)))
    resumed = make(planar(method))
    assert resumed.restore([read_checkpoint(tmp_path / "c.safetensors")])
    assert resumed.step == cut
    assert_same(checkpoint_of(run(resumed, 330 - cut)), whole)


def test_a_checkpoint_is_taken_where_an_episode_has_just_begun(make, tmp_path):
    trainer = stood_still(make(STILL), 100)
    assert [len(each) for each in trainer.metrics.episodes()] == [1]
    write_checkpoint(tmp_path / "c.safetensors", checkpoint_of(trainer))
    resumed = make(STILL)
    resumed.restore([read_checkpoint(tmp_path / "c.safetensors")])
    assert_same(checkpoint_of(run(resumed, 30)), checkpoint_of(run(trainer, 30)))


def test_evaluations_change_nothing(make):
    watched, alone = make(BIASED), make(BIASED)
    for _ in range(6):
        run(watched, 20).evaluate()
    assert_same(checkpoint_of(watched), checkpoint_of(run(alone, 120)))


OTHERS = {
    "actor": {"method": replace(BIASED.method, learner=replace(DROPPING, actor=Architecture((12, 11), dropout=0.2)))},
    "critics": {"method": replace(BIASED.method, learner=replace(DROPPING, critics=1))},
    "capacity": {"schedule": replace(SCHEDULE, capacity=100)},
    "strategy": {"method": METHODS["jsrl"]},
    "environment": {"method": PLAIN.method, "env": "Pendulum-v1", "reward": "own"},
}


@pytest.mark.parametrize("change", OTHERS.values(), ids=OTHERS)
def test_a_checkpoint_of_another_configuration_or_environment_is_refused(compose, inputs, change):
    checkpoint = checkpoint_of(run(compose(BIASED).trainer, 130))
    given = Inputs() if "env" in change else inputs
    with pytest.raises(TensorFileError, match=r"the checkpoint.*begin again without it"):
        compose(replace(BIASED, **change), given).trainer.restore([checkpoint])


def test_more_steps_than_before_are_no_other_settings(make, tmp_path):
    write_checkpoint(tmp_path / "c.safetensors", checkpoint_of(run(make(BIASED), 10)))
    longer = make(replace(BIASED, schedule=replace(SCHEDULE, steps=500)))
    longer.restore([read_checkpoint(tmp_path / "c.safetensors")])
    assert longer.step == 10


class Arm(gymnasium.Env):
    """Cannot be brought to where it was; counts what it is asked for."""

    is_repeatable = False
    observation_space = gymnasium.spaces.Box(-1, 1, (3,))
    action_space = gymnasium.spaces.Box(-1, 1, (2,))

    def __init__(self) -> None:
        self.resets = self.steps = 0

    def reset(self, *, seed=None, options=None):
        self.resets += 1
        return np.full(3, 0.1, np.float32), {}

    def step(self, action):
        self.steps += 1
        return np.full(3, 0.01 * self.steps, np.float32), -1.0, False, False, {}


def on_an_arm(method: Method = NStepPrioritised(learner=LEARNER)) -> tuple[Trainer, Arm]:  # noqa: B008
    arm, problem = Arm(), Problem(3, 2, 150, Draws([0]))
    scaling = scaling_of_bounds((np.full(3, -1.0), np.ones(3)), (np.full(2, -1.0), np.ones(2)))
    learning = method.learning(problem)
    strategy, env = method.strategy(problem, learning.learner), OneByOne([arm], CPU)
    return Trainer(Environments(env, env, scaling), learning, strategy, SCHEDULE, has_expert=False), arm


def test_where_an_episode_cannot_be_repeated_a_new_one_begins_and_no_action_is_made_again(tmp_path):
    begun, _ = on_an_arm()
    write_checkpoint(tmp_path / "c.safetensors", checkpoint_of(run(begun, 50)))
    resumed, arm = on_an_arm()
    resets = arm.resets
    assert not resumed.restore([read_checkpoint(tmp_path / "c.safetensors")])
    assert (arm.steps, arm.resets - resets) == (0, 1)
    assert resumed.step == 50
    for name, tensor in begun.learning.learner.state_dict().items():
        if torch.is_tensor(tensor):
            assert torch.equal(tensor, resumed.learning.learner.state_dict()[name]), name
    assert len(resumed.learning.replay) == len(begun.learning.replay) == 48  # two steps wait for those after them
    run(resumed, 10)
    assert arm.steps == 10
    assert len(resumed.learning.replay) == 58
    assert checkpoint_of(resumed).tensors["environment.actions"].shape == (1, 10, 2)
    rows = resumed.learning.replay._replay._replay.rows[0]
    assert rows[47:50, 6].tolist() == pytest.approx([0.99**3, 0.99**2, 0.99])  # what waited ends with its episode
    assert rows[50, :3].tolist() == pytest.approx([0.1] * 3)


def test_gradient_steps_come_in_bursts_once_enough_was_seen(make):
    trainer, counts = make(PLAIN), []
    for _ in range(100):
        trainer.advance()
        counts.append(trainer.learning.learner.updates)
    # 40 steps seen, and after every 20th more, 10 while the next one is on its way
    assert counts == [10 * max(0, seen // 20 - 1) for seen in range(100)]


def test_transitions_are_stored_normalised_and_in_order(make, inputs):
    trainer = run(make(PLAIN), 140)
    assert len(trainer.learning.replay) == 140
    rows, scaling = trainer.learning.replay.rows[0, :140].numpy(), trainer.scaling
    env, ends = make_environment(PLAIN, inputs.demonstrations.starts), 0
    observation, _ = env.reset(seed=PLAIN.seed)
    for row in rows:
        np.testing.assert_allclose(row[:4], scaling.normalize_observation(observation), atol=1e-5)
        physical = scaling.denormalize_action(row[4:6]).astype(np.float32)
        observation, reward, terminated, truncated, _ = env.step(physical)
        assert row[6] == pytest.approx(reward, abs=1e-5)
        assert row[7] == np.float32(0.99 * (not terminated))
        np.testing.assert_allclose(row[8:12], scaling.normalize_observation(observation), atol=1e-5)
        assert row[12] == Source.AGENT
        if terminated or truncated:
            observation, ends = env.reset()[0], ends + 1
    assert ends
    env.close()


def test_a_truncated_episode_is_stored_as_one_that_goes_on(make):
    trainer = stood_still(make(replace(STILL, schedule=replace(SCHEDULE, train_after=1000))), 100)
    assert [len(each) for each in trainer.metrics.episodes()] == [1]
    assert trainer.learning.replay.rows[0, 99, 7] == np.float32(0.99)


def test_batches_hold_the_share_of_demonstrated_transitions(make):
    trainer = run(make(planar(SHARING)), 60)
    seen, learner = [], trainer.learning.learner
    update = learner.update
    learner.update = lambda batch: (seen.append(batch), update(batch))[1]
    run(trainer, 20)
    expected = 12 * [False] + 4 * [True]
    assert seen
    for batch in seen:
        assert (batch.source[0, :, 0] == Source.DEMONSTRATION).tolist() == expected
        assert batch.demonstrated[0, :, 0].bool().tolist() == expected


@pytest.mark.parametrize("name", ["preloading", "ibrl"])
def test_a_replay_begins_with_demonstrations(make, name):
    replay = make(planar(METHODS[name])).learning.replay
    assert (replay.rows[0, : len(replay), -1] == Source.DEMONSTRATION).all()
    assert len(replay) == 30


def test_the_expert_acts_in_whole_episodes_and_in_the_share_phi(make):
    schedule = replace(SCHEDULE, train_after=10_000, capacity=10_000)
    trainer = make(planar(BiasedExploration(phi=0.4, learner=LEARNER), schedule=schedule))
    ends, end = [], trainer.strategy.end
    trainer.strategy.end = lambda where, returns: (ends.extend([trainer.step + 1] * bool(where)), end(where, returns))
    while len(ends) < 60:
        trainer.advance()
    sources = trainer.learning.replay.rows[0, : trainer.step, -1].numpy()
    episodes = [set(part.tolist()) for part in np.split(sources, ends)[:-1]]
    assert all(each in ({Source.EXPERT}, {Source.AGENT}) for each in episodes)
    share = sum(each == {Source.EXPERT} for each in episodes) / 60
    assert abs(share - 0.4) < 3 * math.sqrt(0.4 * 0.6 / 60)


@pytest.mark.parametrize(("threshold", "share"), [(0.0, 1.0), (1e6, 0.0)])
def test_the_gate_leaves_all_to_the_expert_or_to_the_agent(make, threshold, share):
    trainer = run(make(planar(replace(GATED.method, threshold=threshold))), 30)
    assert isinstance(trainer.strategy, UncertaintyGate)
    (row,) = trainer.metrics.rows(has_expert=True)
    assert row["demonstrated_share"] == share
    assert row["iqr_mean"] > 0.0
    assert set(trainer.learning.replay.rows[0, :30, -1].tolist()) == {Source.EXPERT if share else Source.AGENT}


def test_the_metrics_of_a_row_are_those_of_its_steps(make):
    trainer = run(make(replace(PLAIN, schedule=replace(SCHEDULE, train_after=10_000))), 150)
    rewards = trainer.learning.replay.rows[0, :150, 6].numpy()
    (row,) = trainer.metrics.rows(has_expert=True)
    (episodes,) = trainer.metrics.episodes()
    first = episodes[0]
    assert row["episodes"] == len(episodes) >= 1
    assert row["lowest_reward"] == pytest.approx(rewards.min())
    assert first.reward == pytest.approx(rewards[: first.steps].sum(), rel=1e-4)
    assert row["violations_per_1000"] == pytest.approx(1000 * np.mean(rewards < -0.5))
    assert row["demonstrated_share"] == 0.0
    assert not {"critic_loss", "q", "qcd_mean"} & set(row)  # of what there is not, there is no column
    assert "demonstrated_share" not in trainer.metrics.rows(has_expert=False)[0]


def test_the_losses_of_a_row_are_means_over_its_gradient_steps(make):
    trainer = run(make(PLAIN), 81)
    updates = trainer.metrics.updates
    assert len(updates) == 30
    (row,) = trainer.metrics.rows(has_expert=False)
    for name in ("critic_loss", "q"):
        assert row[name] == pytest.approx(np.mean([float(each.metrics[name].mean()) for each in updates]))


class Numbers(gymnasium.Env):
    """Pays what it is told to from the 60th step on, and never ends."""

    observation_space = gymnasium.spaces.Box(-1, 1, (3,))
    action_space = gymnasium.spaces.Box(-1, 1, (2,))

    def __init__(self, paid: float = 0.0) -> None:
        self.paid, self.steps = paid, 0

    def reset(self, *, seed=None, options=None):
        return np.zeros(3, np.float32), {}

    def step(self, action):
        self.steps += 1
        return np.zeros(3, np.float32), self.paid if self.steps >= 60 else 0.0, False, False, {}


@pytest.mark.parametrize("paid", [math.nan, math.inf])
def test_a_loss_that_is_no_number_stops_training_naming_the_step(paid):
    trainer, _ = on_an_arm(PLAIN.method)
    trainer.env = OneByOne([Numbers(paid)], CPU)
    trainer.env.begin(torch.ones(1, dtype=torch.bool))
    with pytest.raises(DivergenceError, match=r"no number at step (60|80|100)"):
        run(trainer, 200)
    assert trainer.step in (60, 80, 100)


def test_the_evaluation_is_the_mean_of_whole_episodes_without_noise_or_dropout(make):
    trainer = make(BIASED)
    (once,), (again,) = trainer.evaluate(), trainer.evaluate()
    assert once == again
    assert set(once) == {"reward", "steps", "targets_reached", "violations"}
    assert 0 < once["steps"] <= 100


def test_the_evaluation_is_that_of_the_policy_in_one_environment(compose, inputs):
    population = compose(BIASED)
    run(population.trainer, 150)
    env = make_environment(BIASED, inputs.demonstrations.starts)
    alone = roll_out(env, population.policy(0).act, SCHEDULE.evaluation_episodes, EVALUATION_SEED)
    (found,) = population.trainer.evaluate()
    assert found == pytest.approx(mean_result(alone), rel=1e-4)
    env.close()


def test_who_acted_is_kept_with_the_transition(make):
    trainer = make(planar(replace(GATED.method, threshold=0.02, measure="iqr")))
    sources, act = [], trainer.strategy.act

    def watched(observation):
        choice = act(observation)
        sources.append(Source.EXPERT if choice.by_expert else Source.AGENT)
        return choice

    trainer.strategy.act = watched
    run(trainer, 100)
    assert {Source.AGENT, Source.EXPERT} == set(sources)
    assert trainer.learning.replay.rows[0, :100, -1].tolist() == sources
