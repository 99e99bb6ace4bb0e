"""Runs that are made together: each has the numbers that it has alone, bit for bit."""

import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from threading import Event

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from rled_agent.data.opening import open_demonstrations
from rled_agent.methods.method import Method
from rled_agent.methods.td3 import TD3
from rled_agent.nn.tensor_file import TensorFileError
from rled_agent.per_seed import changed, numbers
from rled_agent.training.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from rled_agent.training.config import TrainConfig
from rled_agent.training.environment_batch import STREAM
from rled_agent.training.learning import train
from rled_agent.training.run import Inputs, composed
from rled_agent.training.run_directory import RunDirectory
from rled_agent.training.tables import read_rows
from rled_agent.training.trainer import DivergenceError, Trainer

from .small_runs import BIASED, LEARNER, METHODS, SCHEDULE, SHARING, NStepPrioritised, assert_same, planar, run

SEEDS = (5, 0, 3)


@pytest.fixture(scope="module")
def inputs(make_policy, planar_bag: Path) -> Inputs:
    return Inputs(open_demonstrations(planar_bag, "points"), (make_policy(),))


@pytest.fixture
def make(inputs: Inputs) -> Iterator[Callable[..., Trainer]]:
    """A trainer of the runs of some settings."""
    with ExitStack() as stack:

        def made(*configs: TrainConfig) -> Trainer:
            given = Inputs() if configs[0].reward == "own" else inputs
            return stack.enter_context(composed(configs, given)).trainer

        yield made


def of_seeds(config: TrainConfig, seeds: Sequence[int] = SEEDS) -> list[TrainConfig]:
    return [replace(config, seed=seed) for seed in seeds]


def assert_as_alone(make: Callable[..., Trainer], configs: Sequence[TrainConfig], steps: int) -> None:
    together = run(make(*configs), steps).checkpoints()
    for config, checkpoint in zip(configs, together, strict=True):
        assert_same(checkpoint, *run(make(config), steps).checkpoints())


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_a_seed_of_three_is_the_same_as_alone(make, method):
    """The replay of 150 has wrapped around, and episodes have ended at steps of their own."""
    assert_as_alone(make, of_seeds(planar(method)), 220)


class Walk(gymnasium.Env):
    """Moves by the action and by chance; the episode ends beyond ±1, or is cut after 30 steps."""

    observation_space = gymnasium.spaces.Box(-9, 9, (2,))
    action_space = gymnasium.spaces.Box(-1, 1, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x, self.count = self.np_random.uniform(-0.5, 0.5), 0
        return self.seen(), {}

    def step(self, action):
        self.x, self.count = self.x + 0.1 * float(action[0]) + self.np_random.normal(0.0, 0.2), self.count + 1
        return self.seen(), -abs(self.x), abs(self.x) > 1.0, self.count == 30, {}

    def seen(self) -> np.ndarray:
        return np.array([self.x, self.count / 30.0], np.float32)


@pytest.fixture(autouse=True)
def walk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(gymnasium.registry, "Walk-v0", EnvSpec("Walk-v0", entry_point=Walk))


@pytest.mark.parametrize("method", [TD3(random_steps=25, learner=LEARNER), NStepPrioritised(learner=LEARNER)])
@pytest.mark.parametrize("env", ["Pendulum-v1", "Walk-v0"])
def test_a_seed_in_environments_stepped_one_by_one_is_the_same_as_alone(make, env, method):
    assert_as_alone(make, of_seeds(planar(method, env=env, reward="own")), 220)


def test_what_is_measured_of_a_seed_is_the_same_as_alone(make):
    trainer = run(make(*of_seeds(planar(SHARING))), 150)
    rows, found = trainer.metrics.rows(has_expert=True), trainer.evaluate()
    assert len({row["critic_loss"] for row in rows}) == len({each["reward"] for each in found}) == 3
    for k, config in enumerate(of_seeds(planar(SHARING))):
        alone = run(make(config), 150)
        assert [rows[k]] == alone.metrics.rows(has_expert=True)
        assert [found[k]] == alone.evaluate()


def on_disk(folder: Path, checkpoints: Sequence[Checkpoint]) -> list[Checkpoint]:
    """What is read of what was written."""
    for k, each in enumerate(checkpoints):
        write_checkpoint(folder / f"{k}.safetensors", each)
    return [read_checkpoint(folder / f"{k}.safetensors") for k in range(len(checkpoints))]


ON = [planar(METHODS[key]) for key in ("jsrl", "n-step, prioritised", "mc_rled, sharing")]
ON += [planar(METHODS[key], env="Walk-v0", reward="own") for key in ("td3", "n-step, prioritised")]


@pytest.mark.parametrize("config", ON)
def test_a_population_goes_on_bit_for_bit_and_so_does_a_part_of_it_in_another_order(make, tmp_path, config):
    configs = of_seeds(config)
    whole = run(make(*configs), 300).checkpoints()
    kept = on_disk(tmp_path, run(make(*configs), 130).checkpoints())
    for part in ((0, 1, 2), (2, 0), (1,)):
        trainer = make(*(configs[k] for k in part))
        assert trainer.restore([kept[k] for k in part])
        assert trainer.step == 130
        for k, checkpoint in zip(part, run(trainer, 170).checkpoints(), strict=True):
            assert_same(checkpoint, whole[k])


def test_checkpoints_of_several_steps_do_not_go_on_together(make):
    early, late = (run(make(*of_seeds(BIASED)), steps).checkpoints() for steps in (30, 40))
    with pytest.raises(TensorFileError, match=r"the checkpoints differ in replay\.added; accepted: those of one step"):
        make(*of_seeds(BIASED)).restore([*early[:2], late[2]])


LEARNING = "mc_rled, sharing"
SWEPT = [(LEARNING, name) for name in numbers(METHODS[LEARNING])]
SWEPT += [(key, name) for key, method in METHODS.items() for name in numbers(method) if "learner." not in name]


def value_of(settings: object, name: str) -> float:
    for each in name.split("."):
        settings = getattr(settings, each)
    return float(settings)


def swept(method: Method, name: str) -> list[TrainConfig]:
    """Runs of one seed with the number as it is, a smaller one, and 0, which leaves things out."""
    value = value_of(method, name) or 0.3
    return [planar(changed(method, name, each), seed=2) for each in (value, 0.7 * value, 0.0)]


@pytest.mark.parametrize(("key", "name"), dict.fromkeys(SWEPT))
def test_each_value_of_a_sweep_is_the_same_as_alone(make, key, name):
    assert_as_alone(make, swept(METHODS[key], name), 100)


def test_seeds_and_two_sweeps_at_once_are_the_same_as_alone(make):
    runs = [
        planar(changed(changed(SHARING, "noise", noise), "learner.gamma", gamma), seed=seed)
        for noise in (0.0, 0.2)
        for gamma in (0.9, 0.99)
        for seed in (1, 4)
    ]
    assert_as_alone(make, runs, 100)


def test_a_sweep_goes_on_bit_for_bit(make, tmp_path):
    configs = swept(SHARING, "learner.actor_rate")
    whole = run(make(*configs), 160).checkpoints()
    resumed = make(*configs)
    assert resumed.restore(on_disk(tmp_path, run(make(*configs), 90).checkpoints()))
    for one, other in zip(run(resumed, 70).checkpoints(), whole, strict=True):
        assert_same(one, other)


class Breaking(Walk):
    """Pays a number that is none from the 60th step on where the first episode has a seed of these."""

    broken: frozenset[int] = frozenset()

    def reset(self, *, seed=None, options=None):
        if not hasattr(self, "count_all"):
            self.first, self.count_all = seed, 0
        return super().reset(seed=seed)

    def step(self, action):
        assert np.isfinite(action).all()
        observation, reward, *rest = super().step(action)
        self.count_all += 1
        return observation, math.nan if self.first in self.broken and self.count_all >= 60 else reward, *rest


def first_episode(seed: int) -> int:
    return int(np.random.SeedSequence([seed, STREAM, 0]).generate_state(1)[0] >> 1)


SHORT = replace(SCHEDULE, steps=160, log_every=20, evaluate_every=80, checkpoint_every=40)
BREAKING = planar(TD3(learner=LEARNER), env="Breaking-v0", reward="own", schedule=SHORT)


@pytest.fixture
def learn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[RunDirectory]]:
    """Learn with files, in a folder for each seed of a population."""
    monkeypatch.setitem(gymnasium.registry, "Breaking-v0", EnvSpec("Breaking-v0", entry_point=Breaking))

    def learned(name: str, *configs: TrainConfig) -> list[RunDirectory]:
        directories = [RunDirectory(tmp_path / name / str(each.seed)) for each in configs]
        with composed(configs, Inputs()) as population:
            train(population, directories, Event())
        return directories

    return learned


def told(directory: RunDirectory) -> list[dict[str, float]]:
    """Its metrics but those that depend on the clock."""
    return [
        {name: value for name, value in row.items() if not name.endswith("_per_second") and not math.isnan(value)}
        for row in read_rows(directory.metrics_path, "step")
    ]


@pytest.mark.parametrize("broken", [[0], [5, 3], [3]])
def test_a_run_that_diverges_ends_alone(learn, monkeypatch, tmp_path, broken):
    configs = of_seeds(BREAKING)
    monkeypatch.setattr(Breaking, "broken", frozenset(map(first_episode, broken)))
    more = rf"; and of {len(broken) - 1} more of 3 runs" if len(broken) > 1 else ""
    with pytest.raises(DivergenceError, match=rf"no number at step \d+ in .*together/{broken[0]}{more}; ") as caught:
        learn("together", *configs)
    assert "the last good checkpoint is" in str(caught.value)
    for config in configs:
        directory = RunDirectory(tmp_path / "together" / str(config.seed))
        assert directory.diverged_path.exists() == (config.seed in broken)
        if config.seed in broken:
            assert json.loads(directory.diverged_path.read_text())["step"] in range(60, 161)
            assert directory.step() == 40
            assert [row["step"] for row in told(directory)][:2] == [20, 40]
            assert len(told(directory)) < 8
        else:
            (alone,) = learn("alone", config)
            assert_same(directory.load(), alone.load())
            assert told(directory) == told(alone)
            assert directory.step() == 160


def test_where_all_diverge_the_runs_end_at_once(learn, monkeypatch, tmp_path):
    monkeypatch.setattr(Breaking, "broken", frozenset(map(first_episode, SEEDS)))
    with pytest.raises(DivergenceError, match="more of 3 runs"):
        learn("together", *of_seeds(BREAKING))
    steps = [json.loads((tmp_path / f"together/{seed}/diverged.json").read_text())["step"] for seed in SEEDS]
    assert max(steps) <= 120


def test_the_numbers_of_every_method_may_be_swept():
    assert {name for _, name in SWEPT} == {
        *(f"learner.{name}" for name in ("gamma", "reward_scale", "actor_rate", "critic_rate", "rate_decay", "tau")),
        *("learner.target_noise", "learner.target_clip"),
        *("noise", "phi", "threshold", "cloning.weight", "guide_tolerance"),
    }
    assert SCHEDULE.capacity < 220  # what the tests above say
