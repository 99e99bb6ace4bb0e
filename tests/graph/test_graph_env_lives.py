"""An environment over the graph that is dropped, copied, closed, or given what is no action."""

import copy
import gc
import pickle

import numpy as np
import pytest
from rled_agent.nodes.graph_env import GraphEnv
from rled_msgs_py.errors import RledError
from rled_msgs_py.topics import JOINT_DELTA

WAIT_TIMEOUT = 60.0


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
