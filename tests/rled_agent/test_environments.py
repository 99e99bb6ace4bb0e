import gymnasium
import numpy as np
import pytest
from rled_agent.methods.td3 import TD3
from rled_agent.training.config import TrainConfig
from rled_agent.training.environments import (
    bounds,
    check_spaces,
    environment_of,
    is_repeatable,
    make_environment,
    require_robot_of,
    task_of,
)
from rled_agent.training.rollout import roll_out
from rled_msgs_py.errors import RledError
from rled_sim.robots import ROBOTS


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
        ("Pendulum-v1", "sparse", "env 'Pendulum-v1' takes no reward; accepted: reward own, no bag"),
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
