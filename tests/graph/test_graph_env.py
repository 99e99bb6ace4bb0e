"""A Gymnasium environment over the topics, against the same environment in process."""

from collections.abc import Callable, Iterator
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from rled_agent.data.closed_form import demonstration_points
from rled_agent.nodes.graph_env import GraphEnv
from rled_msgs_py.bags import Bag
from rled_msgs_py.errors import RledError
from rled_msgs_py.processes import Children, program
from rled_sim.kinematics import solve_position
from rled_sim.robots import ROBOTS

import rled_sim  # noqa: F401

WAIT_TIMEOUT = 60.0
NAMES = {"panda": "rled/PandaReach-v0", "planar": "rled/PlanarReach-v0"}
SIMULATION = [*program("rled_sim", "sim_node"), "--discovery-wait", "0.2"]


# These two stand first: afterwards a simulation runs.
def test_without_a_simulation_it_says_so() -> None:
    with pytest.raises(RledError, match=r"waited 0\.3 s for a simulation; is sim_node running"):
        GraphEnv(timeout=0.3)


def test_a_simulation_that_ends_is_noticed() -> None:
    with Children() as children:
        simulation = children.start([*SIMULATION, "--robot", "planar"])
        env = GraphEnv(timeout=WAIT_TIMEOUT)
        env.reset(seed=0)
        children.end(simulation)
        env._graph.timeout = 0.3
        with pytest.raises(RledError, match="for a tick"):
            env.step(np.zeros(2, np.float32))
        env.close()
        env.close()


@pytest.fixture(scope="module", params=NAMES)
def both(request, planar_bag: Path, ros_domain: int) -> Iterator[tuple[GraphEnv, gymnasium.Env]]:
    """One task over the graph and in process: the Panda with sparse reward, the planar robot from marked points."""
    options = {"max_steps": 40, "targets_per_episode": 2}
    given = ["--max-steps", "40", "--targets-per-episode", "2"]
    if request.param == "panda":
        options["reward"] = "sparse"
        given += ["--reward", "sparse"]
    else:
        options["start_joints"] = demonstration_points(Bag(planar_bag)).joints
        given += ["--start-points", str(planar_bag)]
    inside = gymnasium.make(NAMES[request.param], **options)
    with Children() as children:
        children.start([*SIMULATION, "--robot", request.param, *given])
        over = GraphEnv(timeout=WAIT_TIMEOUT)
        yield over, inside
        over.close()
        children.check()
    inside.close()


def episode(both: tuple[GraphEnv, gymnasium.Env], seed: int, act: Callable[[], np.ndarray]) -> tuple:
    """Drive both through an episode, which must not differ in a bit; returns its last transition."""
    seen, expected = (env.reset(seed=seed) for env in both)
    while True:
        assert seen[0].dtype == expected[0].dtype == np.float32
        assert seen[0].tobytes() == expected[0].tobytes()
        assert seen[1:] == expected[1:]
        if len(seen) == 5 and (seen[2] or seen[3]):
            return seen
        action = act()
        seen, expected = (env.step(action) for env in both)


def test_spaces_and_task_are_those_in_process(both) -> None:
    over, inside = both
    assert over.observation_space == inside.observation_space
    assert over.action_space == inside.action_space
    assert over.task == inside.unwrapped.task


def test_random_transitions_of_a_seed_are_those_in_process_bit_for_bit(both) -> None:
    rng, limit = np.random.default_rng(0), both[0].action_space.high

    def beyond_the_limits_too() -> np.ndarray:
        return (rng.uniform(-1.2, 1.2, limit.shape) * limit).astype(np.float32)

    for seed in (4, 11, 4, 2**40):
        last = episode(both, seed, beyond_the_limits_too)
        assert last[3]


def test_transitions_that_reach_targets_are_those_in_process_bit_for_bit(both) -> None:
    over, inside = both
    task, simulation = over.task, inside.unwrapped.simulation

    def towards_the_target() -> np.ndarray:
        q, target = np.array(simulation.plant.q), simulation.episode.target
        goal = solve_position(ROBOTS[task.robot].chain, target, q, task.joint_lower, task.joint_upper)
        farthest = max(np.abs(goal - q).max(), 1e-9)
        return (min(farthest, task.max_delta) * (goal - q) / farthest).astype(np.float32)

    ends = [episode(both, seed, towards_the_target) for seed in range(4)]
    assert sum(terminated for _, _, terminated, *_ in ends) >= 2
    assert sum(info["targets_reached"] for *_, info in ends) >= 5


def test_an_episode_may_be_begun_anew_in_its_middle(both) -> None:
    tracks = []
    for env in both:
        env.reset(seed=5)
        for _ in range(7):
            env.step(np.zeros(env.action_space.shape, np.float32))
        again = env.reset(seed=6)[0]
        tracks.append((again.tobytes(), env.step(env.action_space.high)[0].tobytes()))
    assert tracks[0] == tracks[1]


def test_env_checker_passes(both) -> None:
    check_env(both[0], skip_render_check=True, skip_close_check=True)
