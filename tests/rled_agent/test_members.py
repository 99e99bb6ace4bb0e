"""Seeds and sweeps of a command: which runs they ask for, where these lie, and what is refused."""

from dataclasses import replace
from pathlib import Path

import pytest
from rled_agent.cli.members import MAX_MEMBERS, Member, members_of
from rled_agent.methods.biased_exploration import BiasedExploration
from rled_agent.methods.mc_rled import MCRLED
from rled_agent.training.config import TrainConfig
from rled_msgs_py.errors import RledError

CONFIG = TrainConfig(BiasedExploration(), seed=7)
OUT = Path("out")


def runs(seeds: str = "", *sweeps: str, config: TrainConfig = CONFIG) -> list[Member]:
    return members_of(config, seeds, sweeps, OUT)


def test_without_seeds_and_sweeps_it_is_one_run_in_the_folder_itself():
    (member,) = runs()
    assert (member.config, member.directory.path) == (CONFIG, OUT)


@pytest.mark.parametrize(
    ("text", "seeds"),
    [
        ("3", [3]),
        ("0-3", [0, 1, 2, 3]),
        ("0,2,5", [0, 2, 5]),
        ("5, 1-2,9 ", [5, 1, 2, 9]),
        ("4-4", [4]),
        (f"0-{MAX_MEMBERS - 1}", [*range(MAX_MEMBERS)]),
        (str(2**63 - 1), [2**63 - 1]),
    ],
)
def test_seeds_are_numbers_and_ranges_in_their_order(text, seeds):
    found = runs(text)
    assert [each.config for each in found] == [replace(CONFIG, seed=seed) for seed in seeds]
    assert [each.directory.path for each in found] == [OUT / f"seed-{seed}" for seed in seeds]


def test_a_sweep_is_a_run_for_each_value_and_seed_in_a_folder_that_says_so():
    found = runs("0-1", "phi=0, 0.50,1e-1")
    assert [(each.config.method.phi, each.config.seed) for each in found] == [
        (phi, seed) for phi in (0.0, 0.5, 0.1) for seed in (0, 1)
    ]
    assert [str(each.directory.path) for each in found] == [
        f"out/phi-{phi}/seed-{seed}" for phi in ("0", "0.50", "1e-1") for seed in (0, 1)
    ]
    assert {replace(each.config, method=CONFIG.method, seed=7) for each in found} == {CONFIG}


def test_a_sweep_without_seeds_has_the_seed_of_the_settings():
    assert [str(each.directory.path) for each in runs("", "noise=0.1,0.2")] == [
        "out/noise-0.1/seed-7", "out/noise-0.2/seed-7"
    ]  # fmt: skip


def test_several_sweeps_are_all_combinations():
    found = runs("3", "learner.gamma=0.9,0.95", "cloning.weight=0,1,2")
    assert [str(each.directory.path) for each in found] == [
        f"out/learner.gamma-{gamma}/cloning.weight-{weight}/seed-3" for gamma in (0.9, 0.95) for weight in (0, 1, 2)
    ]
    settings = [(each.config.method.learner.gamma, each.config.method.cloning.weight) for each in found]
    assert settings == [(gamma, weight) for gamma in (0.9, 0.95) for weight in (0.0, 1.0, 2.0)]


def test_a_path_may_be_another_for_each_seed():
    paths = [each.path(Path("experts/{seed}/expert-{seed}.safetensors")) for each in runs("2,11")]
    assert paths == [Path("experts/2/expert-2.safetensors"), Path("experts/11/expert-11.safetensors")]
    assert runs("2")[0].path(Path("expert")) == Path("expert")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x", "seeds are 'x'; accepted: numbers and ranges, as 0-7 or 0,2,5"),
        ("0-", "seeds are '0-'; accepted: numbers and ranges"),
        ("-3", "seeds are '-3'; accepted: numbers and ranges"),
        ("1.5", "seeds are '1.5'; accepted: numbers and ranges"),
        ("0,,1", "seeds are '0,,1'; accepted: numbers and ranges"),
        (",", "seeds are ','; accepted: numbers and ranges"),
        ("0-1-2", "seeds are '0-1-2'; accepted: numbers and ranges"),
        ("²", "seeds are '²'; accepted: numbers and ranges"),
        ("7-3", "seeds are '7-3'; accepted: numbers and ranges"),
        ("1,2,1", "seeds are '1,2,1'; accepted: each once"),
        ("0-3,2", "seeds are '0-3,2'; accepted: each once"),
        (f"0-{MAX_MEMBERS}", "4,096 at most"),
        ("0-99999999999999999999999", "4,096 at most"),
        ("9" * 5000, "seeds are '9999"),
        (str(2**63), "seed 9223372036854775808; accepted: a whole number"),
    ],
)
def test_seeds_that_are_none_are_refused(text, said):
    with pytest.raises(RledError) as caught:
        runs(text)
    assert said in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    ("sweeps", "said"),
    [
        (["phi"], "sweep is 'phi'; accepted: a number of the method and its values, as phi=0,0.1,0.3"),
        (["phi=0,0"], "sweep is 'phi=0,0'; accepted: a number of the method"),
        (["phi=0.1,0.10"], "sweep is 'phi=0.1,0.10'; accepted: a number of the method"),
        (["phi="], "sweep phi has ''; accepted: numbers"),
        (["phi=0,much"], "sweep phi has 'much'; accepted: numbers"),
        (["phi=0,1.5"], "--sweep phi=1.5: phi is 1.5; accepted: 0 to 1"),
        (["phi=nan"], "--sweep phi=nan: phi nan; accepted: a finite number"),
        (["learner.gamma=2"], "--sweep learner.gamma=2: learner.gamma is 2.0; accepted: 0 to 1"),
        (["psi=0"], "--sweep psi=0: no number 'psi' to sweep; accepted: phi, noise, cloning.weight, learner.gamma"),
        (["passes=3"], "no number 'passes' to sweep"),
        (["seed=3"], "no number 'seed' to sweep"),
        (["learner=3"], "no number 'learner' to sweep"),
        (["learner.actor.dropout=0.1"], "no number 'learner.actor.dropout' to sweep"),
        (["=3"], "no number '' to sweep"),
        (["../phi=0"], "no number '../phi' to sweep"),
        (["phi=0,1", "noise=0", "phi=0.5"], "phi is swept twice; accepted: each number once"),
        (["phi=" + ",".join(f"0.{k:04d}1" for k in range(MAX_MEMBERS + 1))], "4,097 runs; accepted: 4,096 at most"),
        (["x" * 10_000 + "=1"], "no number 'xxx"),
    ],
)
def test_sweeps_that_are_none_are_refused(sweeps, said):
    with pytest.raises(RledError) as caught:
        runs("", *sweeps)
    assert said in str(caught.value)
    assert len(str(caught.value)) < 700


def test_the_numbers_that_may_be_swept_are_those_of_the_method():
    gated = TrainConfig(MCRLED())
    assert [each.config.method.threshold for each in runs("", "threshold=0.1,2", config=gated)] == [0.1, 2.0]
    with pytest.raises(RledError, match=r"no number 'phi' to sweep; accepted: threshold, noise, cloning\.weight, l"):
        runs("", "phi=0.1", config=gated)
