"""An environment over the topics: with limits and faults as the one in process, and its life and death."""

import copy
import gc
import pickle
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any

import gymnasium
import numpy as np
import pytest
from rled_agent.nodes.graph_env import GraphEnv
from rled_msgs_py.errors import RledError
from rled_msgs_py.processes import Children, program
from rled_msgs_py.topics import JOINT_DELTA
from rled_sim.faults import NO_FAULTS, Faults

import rled_sim  # noqa: F401

WAIT_TIMEOUT = 60.0
STEPS = 60
FAULTS = {
    "panda": Faults(
        observation_delay=1,
        observation_delay_spread=2,
        reward_delay=2,
        reward_delay_spread=3,
        sensor_noise=0.01,
        observation_loss=0.2,
        hidden="panda_joint2",
    ),
    "planar": Faults(control_delay=1, control_delay_spread=2, actuator_noise=0.2, command_loss=0.2, command_repeat=0.2),
    "lost": Faults(observation_loss=1.0, command_loss=0.9),
}
ZONES = "sphere 0.65 0 0.1 0.15; box 0 -0.5 0 2 0.1 1"
CASES = {
    "panda": ("rled/PandaReach-v0", ["--joint-margin", "0.4", "--workspace", "0.1 -0.3 0.2 0.7 0.3 0.8"]),
    "planar": ("rled/PlanarReach-v0", ["--velocity-share", "0.8", "--acceleration", "200", "--keep-out", ZONES]),
    "motors": ("rled/PandaReach-v0", ["--collisions", "--transition", "motors"]),
}


def drive(env: gymnasium.Env, seed: int) -> list:
    """An episode that goes straight on half of the time, as far as it may."""
    rng, largest = np.random.default_rng(seed), env.action_space.high
    seen = [env.reset(seed=seed)]
    while len(seen) == 1 or not (seen[-1][2] or seen[-1][3]):
        random = rng.uniform(-1.0, 1.0, largest.shape)
        action = largest * (np.sign(seed - 1.5) if rng.uniform() < 0.5 else random)
        seen.append(env.step(action.astype(np.float32)))
    return [(observation.tobytes(), *rest) for observation, *rest in seen]


@contextmanager
def both(name: str, arguments: list[str], **options: Any) -> Iterator[tuple[GraphEnv, gymnasium.Env]]:
    """A task over the graph and in process."""
    robot = "planar" if "Planar" in name else "panda"
    start = [*program("rled_sim", "sim_node"), "--discovery-wait", "0.2", "--robot", robot, "--max-steps", str(STEPS)]
    with Children() as children:
        children.start([*start, *arguments])
        over = GraphEnv(timeout=WAIT_TIMEOUT)
        inside = gymnasium.make(name, max_steps=STEPS, limits=over.task.limits, **options)
        assert over.task == inside.unwrapped.task
        yield over, inside
        over.close()
        inside.close()
        children.check()


@pytest.mark.parametrize("case", CASES)
def test_limited_transitions_are_those_in_process_bit_for_bit_and_nobody_waits(case: str) -> None:
    name, limits = CASES[case]
    codes: Counter[str] = Counter()
    with both(name, limits, transition="motors" if case == "motors" else "kinematic") as (over, inside):
        for seed in range(4):
            expected = drive(inside, seed)
            for each in expected:
                each[-1].pop("contacts", None)  # the graph has them on /diagnostics
            assert drive(over, seed) == expected
            codes.update(each[-1].get("refused", "none") for each in expected)
    assert codes["none"] > 20
    assert codes.total() - codes["none"] > 20
    assert len(codes) > (1 if case == "motors" else 2)


@pytest.mark.parametrize("case", FAULTS)
def test_faulty_transitions_are_those_in_process_bit_for_bit_and_nobody_waits(case: str) -> None:
    faults, name = FAULTS[case], CASES["panda" if case == "panda" else "planar"][0]
    given = {key: value for key, value in asdict(faults).items() if value != getattr(NO_FAULTS, key)}
    arguments = [word for key, value in given.items() for word in ("--" + key.replace("_", "-"), str(value))]
    with both(name, arguments, faults=faults) as (over, inside):
        for seed in (3, 8, 3):
            assert drive(over, seed) == drive(inside, seed)


def test_faults_and_limits_together_end_where_they_do_in_process() -> None:
    faults = Faults(actuator_noise=0.5, control_delay_spread=1, sensor_noise=0.02)
    arguments = ["--actuator-noise", "0.5", "--control-delay-spread", "1", "--sensor-noise", "0.02"]
    with both(CASES["planar"][0], [*arguments, *CASES["planar"][1]], faults=faults) as (over, inside):
        assert drive(over, 1) == drive(inside, 1)


# An environment over the graph that is dropped, copied, closed, or given what is no action.


@pytest.fixture
def env(children):
    env = GraphEnv(timeout=WAIT_TIMEOUT)
    yield env
    env.close()


def test_it_is_neither_copied_nor_pickled(env) -> None:
    for way in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(RledError, match="an environment over the graph is not copied or pickled"):
            way(env)


def test_actions_are_whatever_numpy_makes_an_array_of(env) -> None:
    with pytest.raises(RledError, match="no episode has begun; call reset first"):
        env.step([0.0, 0.0])
    env.reset(seed=0)
    before = env._tick.joints.ordered(env.task.joint_names).position
    for action in ([0.05, -0.05], (0.05, -0.05), np.array([0.05, -0.05], np.float32)):
        env.step(action)
    after = env._tick.joints.ordered(env.task.joint_names).position
    np.testing.assert_allclose(after - before, [0.15, -0.15], atol=1e-6)
    for action in (None, [0.0], [np.nan, 0.0], "ab", [None, None], np.zeros((2, 1))):
        with pytest.raises(RledError, match="accepted: 2 finite numbers"):
            env.step(action)
    env.step(np.zeros(2))


def test_a_seed_or_an_option_that_the_simulation_does_not_take_is_refused(env) -> None:
    with pytest.raises(RledError, match=r"seed 9223372036854775808; accepted: 0 to 9223372036854775807 over the graph"):
        env.reset(seed=2**63)
    with pytest.raises(RledError, match="reset options target; accepted: none"):
        env.reset(options={"target": 1})


def test_what_is_closed_says_so(env) -> None:
    env.reset(seed=0)
    env.close()
    env.close()
    for use in (env.reset, lambda: env.step(np.zeros(2))):
        with pytest.raises(RledError, match="the environment is closed; accepted: an open one; make it again"):
            use()


def test_one_that_is_dropped_leaves_the_graph_at_once(children, observer) -> None:
    gc.disable()
    try:
        env = GraphEnv(timeout=WAIT_TIMEOUT)
        env.reset(seed=0)
        context = env._graph._context
        observer.wait(lambda: observer.node.count_publishers(JOINT_DELTA.name) == 1, "the environment")
        del env
        assert not context.ok()
        observer.wait(lambda: observer.node.count_publishers(JOINT_DELTA.name) == 0, "its end")
    finally:
        gc.enable()
