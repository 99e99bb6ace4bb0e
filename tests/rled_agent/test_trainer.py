import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from rled_agent.exploration.behaviour import MonteCarloGate
from rled_agent.learners.td3 import LearnerConfig
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.scaling import scaling_of_bounds
from rled_agent.nn.tensor_file import TensorFileError
from rled_agent.training.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from rled_agent.training.config import BehaviourConfig, Schedule, TrainConfig
from rled_agent.training.environments import make_environment
from rled_agent.training.expertise import Expertise, no_expertise, read_expertise
from rled_agent.training.trainer import DivergenceError, Trainer
from rled_msgs_py.bags import Bag
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.records import Actor
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

TINY = Architecture(hidden=(12, 10))
SCHEDULE = Schedule(
    steps=400, train_after=40, train_every=20, gradient_steps=10, batch_size=16, capacity=150, evaluation_episodes=2
)
LEARNER = LearnerConfig(actor=TINY, critic=TINY)
DROPPING = replace(LEARNER, actor=replace(TINY, dropout=0.2))
BIASED = TrainConfig(env="rled/PlanarReach-v0", behaviour=BehaviourConfig(phi=0.4), schedule=SCHEDULE, learner=DROPPING)
GATED = replace(BIASED, behaviour=BehaviourConfig(name="gate", measure="iqr", threshold=0.03, passes=8))
PLAIN = replace(BIASED, behaviour=BehaviourConfig(phi=0.0), learner=LEARNER)
SHARED = replace(
    GATED,
    schedule=replace(SCHEDULE, expert_share=0.25),
    learner=replace(DROPPING, cloning_weight=1.0, rate_decay=100.0, target_dropout=True),
)
JUMP_START = replace(PLAIN, behaviour=BehaviourConfig(name="jump_start", guide_steps=9, guide_stages=3))
PROPOSAL = replace(
    PLAIN,
    behaviour=BehaviourConfig(name="proposal"),
    schedule=replace(SCHEDULE, preload=30),
    learner=replace(LEARNER, expert_bootstrap=True),
)
CONFIGS = {
    "jump_start": JUMP_START,
    "proposal": PROPOSAL,
    "biased": BIASED,
    "gated": GATED,
    "plain": PLAIN,
    "shared": SHARED,
}


@pytest.fixture(scope="module")
def expert(make_policy, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("expert") / "expert.safetensors"
    make_policy().save(path)
    return path


@pytest.fixture
def make(planar_bag: Path, expert: Path) -> Iterator[Callable[[TrainConfig], Trainer]]:
    opened: list[gymnasium.Env] = []

    def trainer(config: TrainConfig) -> Trainer:
        opened.extend(make_environment(config, None) for _ in range(2))
        return Trainer(*opened[-2:], config, read_expertise(opened[-1], Bag(planar_bag), expert, config))

    yield trainer
    for env in opened:
        env.close()


def run(trainer: Trainer, steps: int) -> Trainer:
    for _ in range(steps):
        trainer.advance()
    return trainer


def assert_same(one: Checkpoint, other: Checkpoint) -> None:
    assert one.state == other.state
    assert one.tensors.keys() == other.tensors.keys()
    for name, tensor in one.tensors.items():
        assert torch.equal(tensor, other.tensors[name]), name


@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS)
def test_same_seed_gives_the_same_state(make, config):
    one, same = (run(make(config), 150).checkpoint() for _ in range(2))
    assert_same(one, same)
    other = run(make(replace(config, seed=1)), 150).checkpoint()
    assert not torch.equal(other.tensors["actor.weights.0"], one.tensors["actor.weights.0"])


@pytest.mark.parametrize("cut", [130, 200])
@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS)
def test_a_run_continues_from_a_checkpoint_bit_for_bit(make, config, cut, tmp_path):
    """The replay of 150 rows has wrapped around at step 200; at 130 an episode of 100 steps is under way."""
    whole = run(make(config), 330).checkpoint()
    write_checkpoint(tmp_path / "c.safetensors", run(make(config), cut).checkpoint())
    resumed = make(config)
    resumed.restore(read_checkpoint(tmp_path / "c.safetensors"))
    assert resumed.step == cut
    assert_same(run(resumed, 330 - cut).checkpoint(), whole)


def test_a_checkpoint_is_taken_where_an_episode_has_just_begun(make, tmp_path):
    still = replace(PLAIN, behaviour=BehaviourConfig(phi=0.0, noise=0.0), learner=replace(LEARNER, actor_rate=0.0))
    trainer = make(still)
    # it stands still, so the episode is cut after 100 steps
    trainer.learner.actor.load_vector(0.0 * trainer.learner.actor.vector())
    run(trainer, 100)
    assert len(trainer.interval.episodes) == 1
    write_checkpoint(tmp_path / "c.safetensors", trainer.checkpoint())
    resumed = make(still)
    resumed.restore(read_checkpoint(tmp_path / "c.safetensors"))
    assert_same(run(resumed, 30).checkpoint(), run(trainer, 30).checkpoint())


def test_evaluations_change_nothing(make):
    watched, alone = make(BIASED), make(BIASED)
    for _ in range(6):
        run(watched, 20).evaluate()
    assert_same(watched.checkpoint(), run(alone, 120).checkpoint())


@pytest.mark.parametrize(
    "change",
    [
        {"learner": replace(DROPPING, actor=replace(TINY, hidden=(12, 11), dropout=0.2))},
        {"learner": replace(DROPPING, critics=1)},
        {"schedule": replace(SCHEDULE, capacity=100)},
    ],
)
def test_a_checkpoint_of_other_networks_or_of_more_transitions_is_refused(make, change):
    checkpoint = run(make(BIASED), 130).checkpoint()
    with pytest.raises(TensorFileError):
        make(replace(BIASED, **change)).restore(checkpoint)


def test_a_checkpoint_of_another_environment_is_refused(make):
    checkpoint = run(make(PLAIN), 10).checkpoint()
    pendulum = replace(PLAIN, env="Pendulum-v1", reward="own")
    env = make_environment(pendulum, None)
    with pytest.raises(TensorFileError):
        Trainer(env, env, pendulum, no_expertise(env, pendulum)).restore(checkpoint)


def test_more_steps_than_before_are_no_other_settings(make, tmp_path):
    write_checkpoint(tmp_path / "c.safetensors", run(make(BIASED), 10).checkpoint())
    longer = make(replace(BIASED, schedule=replace(SCHEDULE, steps=500)))
    longer.restore(read_checkpoint(tmp_path / "c.safetensors"))
    assert longer.step == 10


def test_gradient_steps_come_in_bursts_once_enough_was_seen(make):
    trainer, counts = make(PLAIN), []
    for _ in range(100):
        trainer.advance()
        counts.append(trainer.learner.updates)
    # 40 steps seen, and after every 20th more, 10 while the next one is on its way
    assert counts == [10 * max(0, seen // 20 - 1) for seen in range(100)]


def test_transitions_are_stored_normalised_and_in_order(make):
    trainer = run(make(PLAIN), 60)
    assert len(trainer.replay) == 60
    rows, scaling = trainer.replay.rows[:60], trainer.expertise.scaling
    env = make_environment(PLAIN, None)
    observation, _ = env.reset(seed=trainer.checkpoint().state["episode_seed"])
    for row in rows:
        np.testing.assert_array_equal(row[:4], scaling.normalize_observation(observation))
        physical = scaling.denormalize_action(row[4:6]).astype(np.float32)
        observation, reward, terminated, truncated, _ = env.step(physical)
        assert row[6] == np.float32(reward)
        assert row[7] == terminated
        np.testing.assert_array_equal(row[8:], scaling.normalize_observation(observation))
        assert not truncated
    env.close()


def test_a_truncated_episode_is_stored_as_one_that_goes_on(make):
    still = replace(PLAIN, behaviour=BehaviourConfig(phi=0.0, noise=0.0), schedule=replace(SCHEDULE, train_after=1000))
    trainer = make(still)
    trainer.learner.actor.load_vector(0.0 * trainer.learner.actor.vector())
    run(trainer, 100)
    assert len(trainer.interval.episodes) == 1
    assert trainer.replay.rows[99, 7] == 0.0


def test_batches_hold_the_share_of_demonstrated_rows(make):
    trainer = run(make(SHARED), 60)
    seen = []
    update = trainer.learner.update
    trainer.learner.update = lambda batch: (seen.append(batch), update(batch))[1]
    run(trainer, 20)
    assert {(len(batch), batch.demonstrated) for batch in seen} == {(16, 4)}
    own = {row.tobytes() for row in trainer.replay.rows[: len(trainer.replay)]}
    for batch in seen:
        rows = [row.tobytes() in own for row in batch.rows.numpy()]
        assert rows == [True] * 12 + [False] * 4


def test_the_expert_acts_in_whole_episodes_and_in_the_share_phi(make):
    config = replace(BIASED, learner=LEARNER, schedule=replace(SCHEDULE, train_after=10_000, capacity=10_000))
    trainer, episodes, actors = make(config), [], []
    act = trainer.behaviour.act
    trainer.behaviour.act = lambda observation: (choice := act(observation), actors.append(choice.actor))[0]
    while len(episodes) < 60:
        before = len(trainer.interval.episodes)
        trainer.advance()
        if len(trainer.interval.episodes) > before:
            episodes.append(set(actors))
            actors.clear()
    assert all(len(each) == 1 for each in episodes)
    share = sum(each == {Actor.EXPERT} for each in episodes) / 60
    assert abs(share - 0.4) < 3 * math.sqrt(0.4 * 0.6 / 60)


@pytest.mark.parametrize(("threshold", "share"), [(0.0, 1.0), (1e6, 0.0)])
def test_the_gate_leaves_all_to_the_expert_or_to_the_agent(make, threshold, share):
    trainer = run(make(replace(GATED, behaviour=replace(GATED.behaviour, threshold=threshold))), 30)
    assert isinstance(trainer.behaviour, MonteCarloGate)
    row = trainer.interval.row()
    assert row["demonstrated_share"] == share
    assert row["iqr_mean"] > 0.0


@pytest.mark.parametrize("lacking", ["dropout", "demonstrations"])
def test_a_gate_without_dropout_or_demonstrations_is_refused(make, lacking, planar_bag, expert):
    config = replace(GATED, learner=LEARNER) if lacking == "dropout" else GATED
    env = make_environment(config, None)
    expertise = read_expertise(env, Bag(planar_bag), expert, config)
    if lacking == "demonstrations":
        expertise = expertise._replace(source=None)
    with pytest.raises(RledError, match=f"the Monte-Carlo gate lacks .*{lacking}"):
        Trainer(env, env, config, expertise)
    env.close()


def test_the_figures_of_an_interval_are_those_of_its_steps(make):
    trainer = run(make(replace(PLAIN, schedule=replace(SCHEDULE, train_after=10_000))), 150)
    rewards = trainer.replay.rows[:150, 6]
    row = trainer.interval.row()
    first = trainer.interval.episodes[0]
    assert row["episodes"] == len(trainer.interval.episodes) >= 1
    assert row["lowest_reward"] == pytest.approx(rewards.min())
    assert first.reward == pytest.approx(rewards[: first.steps].sum(), rel=1e-4)
    assert row["violations_per_1000"] == pytest.approx(1000 * np.mean(rewards < -1.0))
    assert row["demonstrated_share"] == 0.0
    assert math.isnan(row["critic_loss"])
    assert math.isnan(row["qcd_mean"])


class Numbers(gymnasium.Env):
    """Pays what it is told to from the 60th step on, and never ends."""

    observation_space = gymnasium.spaces.Box(-1, 1, (3,))
    action_space = gymnasium.spaces.Box(-1, 1, (2,))

    def __init__(self, paid: float) -> None:
        self.paid, self.steps = paid, 0

    def reset(self, *, seed=None, options=None):
        return np.zeros(3, np.float32), {}

    def step(self, action):
        self.steps += 1
        return np.zeros(3, np.float32), self.paid if self.steps >= 60 else 0.0, False, False, {}


@pytest.mark.parametrize("paid", [math.nan, math.inf])
def test_a_loss_that_is_no_number_stops_training_naming_the_step(paid):
    scaling = scaling_of_bounds((np.full(3, -1.0), np.ones(3)), (np.full(2, -1.0), np.ones(2)))
    trainer = Trainer(Numbers(paid), Numbers(0.0), PLAIN, Expertise(None, None, scaling))
    with pytest.raises(DivergenceError, match=r"no number at step (60|80|100)"):
        run(trainer, 200)
    assert trainer.step in (60, 80, 100)


def test_settings_that_need_an_expert_are_refused_without_one():
    env = make_environment(PLAIN, None)
    for config in (BIASED, GATED, replace(PLAIN, schedule=replace(SCHEDULE, expert_share=0.1))):
        with pytest.raises(RledError, match="these settings need an expert; accepted: --bag and --expert"):
            no_expertise(env, config)
    assert no_expertise(env, PLAIN).source is None
    env.close()


def test_an_expert_or_a_bag_of_another_robot_is_refused(make_policy, planar_bag, expert, tmp_path):
    panda, planar = (make_environment(TrainConfig(env=name), None) for name in ("rled/PandaReach-v0", BIASED.env))
    other = tmp_path / "panda.safetensors"
    make_policy(task=reach_task(ROBOTS["panda"]).description).save(other)
    with pytest.raises(ContractError, match="the bag is for robot planar; accepted: panda"):
        read_expertise(panda, Bag(planar_bag), other, BIASED)
    with pytest.raises(ContractError, match="the expert is for robot panda; accepted: planar"):
        read_expertise(planar, Bag(planar_bag), other, BIASED)
    foreign = make_environment(TrainConfig(env="Pendulum-v1", reward="own"), None)
    with pytest.raises(RledError, match="no robot that a bag could be of"):
        read_expertise(foreign, Bag(planar_bag), expert, replace(BIASED, env="Pendulum-v1"))
    for env in (panda, planar, foreign):
        env.close()


def test_the_evaluation_is_the_mean_of_whole_episodes_without_noise_or_dropout(make):
    trainer = make(BIASED)
    once, again = trainer.evaluate(), trainer.evaluate()
    assert once == again
    assert set(once) == {"reward", "steps", "targets_reached", "violations"}
    assert 0 < once["steps"] <= 100
