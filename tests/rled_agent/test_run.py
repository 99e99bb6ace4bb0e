"""What a run is composed of, the environments it runs in, and what it cannot do without."""

from contextlib import ExitStack
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
import torch
from rled_agent.data.opening import open_demonstrations
from rled_agent.learners.td3 import TD3Config
from rled_agent.methods import all_methods
from rled_agent.methods.biased_exploration import BiasedExploration
from rled_agent.methods.mc_rled import MCRLED
from rled_agent.methods.td3 import TD3
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.policy import GateSettings, Origin, load_policy
from rled_agent.training.config import Schedule, TrainConfig
from rled_agent.training.environment_batch import (
    EnvironmentBatch,
    OneByOne,
    ReachEnvironments,
    is_repeatable,
    task_of,
)
from rled_agent.training.environments import (
    bounds,
    check_spaces,
    environment_of,
    make_batch,
    make_environment,
    require_robot_of,
)
from rled_agent.training.rollout import roll_out
from rled_agent.training.run import Inputs, composed
from rled_msgs_py.errors import RledError
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

TINY = Architecture(hidden=(8,))
LEARNER = TD3Config(actor=TINY, critic=TINY)
SCHEDULE = Schedule(capacity=100)
PLANAR = "rled/PlanarReach-v0"
GATE = MCRLED(measure="iqr", threshold=0.5, passes=7, learner=replace(LEARNER, actor=replace(TINY, dropout=0.1)))


@pytest.fixture
def inputs(planar_bag, make_policy) -> Inputs:
    return Inputs(open_demonstrations(planar_bag, "points"), (make_policy(),))


def refused(config: TrainConfig, given: Inputs) -> str:
    with pytest.raises(RledError) as caught, composed([config], given):
        pass
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("env", "reward", "what"),
    [
        ("rled/PandaReach-v0", "sparse", "the expert is for robot planar"),
        ("Pendulum-v1", "own", "no robot that a bag or an expert could be of"),
    ],
)
def test_an_expert_of_another_robot_is_refused_without_a_bag_too(planar_expert, env, reward, what):
    inputs = Inputs(None, (load_policy(planar_expert),))
    with pytest.raises(RledError, match=what), composed([TrainConfig(GATE, env=env, reward=reward)], inputs):
        pass


@pytest.mark.parametrize("name", all_methods())
def test_a_method_that_lacks_what_it_needs_is_refused_by_its_name(inputs, name):
    method = all_methods()[name]
    lacking = {
        "expert": inputs._replace(experts=()),
        "demonstrations": inputs._replace(demonstrations=None),
    }
    for need in method.needs:
        said = refused(TrainConfig(method(), env=PLANAR, schedule=SCHEDULE), lacking[need])
        assert said.startswith(f"{name} lacks {need}; accepted: --bag and --expert; record a bag with record_demos")
    if len(method.needs) == 2:
        assert f"{name} lacks {' and '.join(method.needs)}; " in refused(TrainConfig(method(), env=PLANAR), Inputs())
    if not method.needs:
        with composed([TrainConfig(method(learner=LEARNER), env=PLANAR, schedule=SCHEDULE)], Inputs()) as population:
            assert population.expert is None


@pytest.mark.parametrize("name", [name for name, method in all_methods().items() if not method.needs])
def test_a_method_that_does_not_serve_the_action_space_is_named(name):
    said = refused(TrainConfig(all_methods()[name](), env="CartPole-v1", reward="own"), Inputs())
    assert said == f"{name} cannot serve the action space Discrete(2); accepted: a Box of one dimension"


def test_a_gate_asks_for_an_actor_that_drops_units(inputs):
    said = refused(TrainConfig(replace(GATE, learner=LEARNER), env=PLANAR, schedule=SCHEDULE), inputs)
    assert said == "the actor drops no units; accepted: dropout above 0; give learner.actor.dropout"


def test_an_expert_or_a_bag_of_another_robot_is_refused(inputs, make_policy):
    other = make_policy(task=reach_task(ROBOTS["panda"]).description)
    method = BiasedExploration(learner=LEARNER)
    said = refused(TrainConfig(method, env="rled/PandaReach-v0"), inputs._replace(experts=(other,)))
    assert said.startswith(
        "the bag is of robot planar, env rled/PandaReach-v0 of panda; accepted: a bag of panda; or --env"
    )
    said = refused(TrainConfig(method, env=PLANAR), inputs._replace(experts=(other,)))
    assert said.startswith("the expert is for robot panda; accepted: planar")


def kept_batches(monkeypatch) -> list[EnvironmentBatch]:
    """The batches that a run makes, as they are made."""
    made: list[EnvironmentBatch] = []
    monkeypatch.setattr(
        "rled_agent.training.run.make_batch", lambda *given: (made.append(make_batch(*given)), made[-1])[1]
    )
    return made


def test_environments_are_closed_after_the_run_and_when_it_is_refused(inputs, monkeypatch):
    made, closed, config = kept_batches(monkeypatch), [], TrainConfig(GATE, env=PLANAR, schedule=SCHEDULE)
    monkeypatch.setattr(ReachEnvironments, "close", lambda env: closed.append(env))
    with composed([config], inputs) as population:
        assert population.trainer.env in made
        assert not closed
    assert {*closed} >= {made[-1], made[-2]}
    closed.clear()
    refused(replace(config, method=replace(GATE, learner=LEARNER)), inputs)
    assert {*closed} >= {made[-1], made[-2]}


def test_environments_of_somebody_else_are_closed_too(monkeypatch):
    closed, close = [], gymnasium.Wrapper.close
    monkeypatch.setattr(gymnasium.Wrapper, "close", lambda env: (closed.append(env.unwrapped), close(env))[1])
    pendulum = TrainConfig(TD3(learner=LEARNER), env="Pendulum-v1", reward="own", schedule=SCHEDULE)
    with composed([pendulum, replace(pendulum, seed=1)], Inputs()) as population:
        acted_in = {each.unwrapped for each in population.trainer.env._envs}
        assert len(acted_in) == 2
        assert not acted_in & {*closed}
    assert acted_in < {*closed}
    assert len({*closed}) == 4  # two to act in, two to be looked at in


def test_another_environment_may_be_acted_in(inputs):
    made = []

    def make(task):
        made.append(gymnasium.make(PLANAR))
        assert task.robot == "planar"
        return made[-1]

    with composed([TrainConfig(GATE, env=PLANAR, schedule=SCHEDULE)], inputs, make) as population:
        assert isinstance(population.trainer.env, OneByOne)
        assert population.trainer.env._envs == made


def test_the_policy_says_how_it_was_made(inputs, tmp_path):
    with ExitStack() as stack:
        configs = [TrainConfig(method, env=PLANAR, schedule=SCHEDULE) for method in (GATE, TD3(learner=LEARNER))]
        gated, plain = (stack.enter_context(composed([config], inputs)).policy(0) for config in configs)
        assert gated.origin == Origin("mc_rled", GateSettings("iqr", 0.5, 7, "dropout"))
        assert plain.origin == Origin("td3", None)
        assert gated.critic is None
        gated.save(tmp_path / "policy")
        observations = np.random.default_rng(0).uniform(-1, 1, (5, 4))
        np.testing.assert_array_equal(load_policy(tmp_path / "policy").act(observations), gated.act(observations))
    pendulum = TrainConfig(TD3(learner=LEARNER), env="Pendulum-v1", reward="own", schedule=SCHEDULE)
    with composed([pendulum], Inputs()) as population:
        assert population.policy(0) is None


def test_each_policy_of_a_population_is_that_of_its_run(inputs):
    configs = [TrainConfig(replace(GATE, threshold=0.1 * k), env=PLANAR, schedule=SCHEDULE, seed=k) for k in range(3)]
    observations = np.random.default_rng(0).uniform(-1, 1, (5, 4))
    with composed(configs, inputs) as population:
        for k, config in enumerate(configs):
            with composed([config], inputs) as alone:
                policy, same = population.policy(k), alone.policy(0)
            assert policy.origin == same.origin == Origin("mc_rled", GateSettings("iqr", 0.1 * k, 7, "dropout"))
            np.testing.assert_array_equal(policy.act(observations), same.act(observations))


def test_what_differs_between_runs_besides_seeds_and_numbers_is_refused(inputs):
    configs = [TrainConfig(replace(GATE, passes=passes), env=PLANAR, schedule=SCHEDULE) for passes in (7, 8)]
    with pytest.raises(RledError, match="passes differs between seeds; accepted: one value"), composed(configs, inputs):
        pass


def test_episodes_start_where_the_demonstrations_do(inputs):
    with composed([TrainConfig(GATE, env=PLANAR, schedule=SCHEDULE)], inputs) as population:
        starts = {tuple(row) for row in inputs.demonstrations.starts.round(9).tolist()}
        env, begun = population.trainer.env, set()
        for seed in range(9):
            env.seed([seed])
            env.begin(torch.ones(1, dtype=torch.bool))
            (joints,) = env.states()[0]["joints"].numpy().round(9).tolist()
            begun.add(tuple(joints))
        assert begun <= starts
        assert len(begun) > 2


def make(name: str, reward: str = "own", starts: np.ndarray | None = None) -> gymnasium.Env:
    return make_environment(TrainConfig(TD3(), env=name, reward=reward), starts)


@pytest.mark.parametrize(
    ("name", "reward", "what"),
    [
        ("CartPole-v1", "own", r"td3 cannot serve the action space Discrete\(2\); accepted: a Box of one dimension"),
        ("NoSuch-v0", "own", "env 'NoSuch-v0'.*accepted: an id that Gymnasium knows"),
        ("nosuchmodule:Env-v0", "own", "env 'nosuchmodule:Env-v0': No module named 'nosuchmodule'"),
        ("", "own", "env ''"),
        (":", "own", "env ':'"),
        ("a:b:c", "own", "env 'a:b:c'"),
        ("..x:y", "own", "env '..x:y'"),
        ("x" * 500, "own", "env 'xxx"),
        ("Hopper-v5", "sparse", "env 'Hopper-v5'"),
        ("Pendulum-v1", "sparse", "env 'Pendulum-v1' takes no reward; accepted: --reward own, without --bag"),
    ],
)
def test_environments_that_cannot_be_learned_in_are_refused(name, reward, what):
    with pytest.raises(RledError, match=what) as caught:
        make(name, reward)
    assert len(str(caught.value)) < 400


def test_start_joints_for_an_environment_without_joints_are_refused_in_few_words():
    with pytest.raises(RledError, match="takes no start_joints") as caught:
        make("Pendulum-v1", starts=np.zeros((2000, 7)))
    assert len(str(caught.value)) < 400


def test_observations_that_are_no_vector_are_refused():
    class Pictures(gymnasium.Env):
        action_space = gymnasium.spaces.Box(-1, 1, (2,))
        observation_space = gymnasium.spaces.Box(0, 1, (8, 8))

    with pytest.raises(RledError, match="ddpg cannot serve the observation space Box"):
        check_spaces(Pictures(), "ddpg")


@pytest.mark.parametrize("reward", ["dense", "sparse"])
def test_reward_and_starts_reach_the_environment(reward):
    starts = np.array([[-0.5, 1.0], [-0.4, 1.2]])
    env = make("rled/PlanarReach-v0", reward, starts)
    assert task_of(env).reward == reward
    begins = np.unique([env.reset(seed=seed)[0][:2] for seed in range(20)], axis=0)
    np.testing.assert_allclose(begins, np.unique(ROBOTS["planar"].chain.position(starts)[:, :2], axis=0), atol=1e-6)
    env.close()


def test_the_spread_of_targets_reaches_the_environment():
    wide, narrow = (make_environment(TrainConfig(TD3(), target_spread=spread), None) for spread in (0.1, 0.0))
    curve = narrow.unwrapped.simulation.task.targets
    for env, beside in ((wide, True), (narrow, False)):
        env.reset(seed=0)
        assert (np.array(env.unwrapped.simulation.episode.target) != curve).any(axis=1).all() == beside
        env.close()


def test_foreign_environments_have_no_task():
    env = make("Pendulum-v1")
    assert task_of(env) is None
    low, high = bounds(env.action_space)
    assert (low.tolist(), high.tolist()) == ([-2.0], [2.0])


@pytest.mark.parametrize(
    ("said", "found"), [({}, True), ({"is_repeatable": True}, True), ({"is_repeatable": False}, False)]
)
def test_an_environment_is_repeatable_unless_it_says_otherwise(said, found):
    env = gymnasium.wrappers.TimeLimit(type("Env", (Countdown,), said)(), 5)
    assert is_repeatable(env) is found


class Countdown(gymnasium.Env):
    """Pays 1 a step; lasts as many steps as its seed, and then is done if that is even, cut if odd."""

    observation_space = gymnasium.spaces.Box(-1, 1, (1,))
    action_space = gymnasium.spaces.Box(-1, 1, (1,))

    def reset(self, *, seed=None, options=None):
        self.left = self.begun = seed
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.left -= 1
        over, even = self.left == 0, self.begun % 2 == 0
        info = {"targets_reached": 10 * self.begun, "violations": self.left}
        return np.zeros(1, np.float32), 1.0, over and even, over and not even, info


def test_a_roll_out_is_whole_episodes_with_one_seed_each():
    results = roll_out(Countdown(), lambda observation: observation, 3, 4)
    assert [tuple(each) for each in results] == [(4.0, 4, 40, 0), (5.0, 5, 50, 0), (6.0, 6, 60, 0)]


def test_the_environment_of_a_robot_is_one_of_this_projects_whatever_it_is_called():
    assert environment_of("planar") == "rled/PlanarReach-v0"
    for robot in ("ur5", "os:path", "../evil:x", "x" * 10_000):
        with pytest.raises(RledError, match=r"has no environment; accepted: one of panda, planar") as caught:
            environment_of(robot)
        assert len(str(caught.value)) < 300


def test_demonstrations_of_another_robot_name_the_environment_that_fits(task):
    require_robot_of(task, "rled/PlanarReach-v0", "the bag")
    require_robot_of(task, "Pendulum-v1", "the bag")  # somebody else's environment says itself that it takes no bag
    with pytest.raises(RledError) as caught:
        require_robot_of(task, "rled/PandaReach-v0", "the bag")
    said = "the bag is of robot planar, env rled/PandaReach-v0 of panda; accepted: a bag of panda"
    assert str(caught.value) == f"{said}; or --env rled/PlanarReach-v0"
