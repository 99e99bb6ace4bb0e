"""Life and death of environments: dropped, copied, pickled, closed, forked, or never made."""

import copy
import gc
import os
import pickle
import weakref

import gymnasium
import numpy as np
import pytest
from rled_msgs_py.errors import RledError
from rled_msgs_py.task_limits import Limits
from rled_sim.bullet.world import World
from rled_sim.envs import ReachEnv
from rled_sim.faults import Faults
from rled_sim.robots import ROBOTS

import rled_sim  # noqa: F401

PANDA, PLANAR = "rled/PandaReach-v0", "rled/PlanarReach-v0"
OPTIONS = [
    {},
    {"transition": "motors"},
    {"limits": Limits(collisions=True)},
    {"faults": Faults(observation_delay=2, control_delay=1, sensor_noise=0.01, command_loss=0.2)},
]
WAYS = {"deepcopy": copy.deepcopy, "pickle": lambda env: pickle.loads(pickle.dumps(env))}


def drive(env, seed, steps=40):
    """What random actions come to, over the ends of episodes."""
    generator, track = np.random.default_rng(seed), []
    for _ in range(steps):
        high = env.action_space.high
        observation, *rest = env.step(generator.uniform(-high, high).astype(np.float32))
        track.append((observation.tobytes(), *rest))
        if rest[1] or rest[2]:
            track.append(env.reset()[0].tobytes())
    return track


def begun(name=PANDA, **options):
    env = gymnasium.make(name, max_steps=30, **options)
    env.reset(seed=3)
    drive(env, 0, 45)
    return env


def clients(monkeypatch):
    """Numbers of PyBullet's clients that are open, in a list that is kept up to date."""
    import pybullet

    opened, connect, disconnect = [], pybullet.connect, pybullet.disconnect
    monkeypatch.setattr(pybullet, "connect", lambda *given: opened.append(connect(*given)) or opened[-1])
    monkeypatch.setattr(pybullet, "disconnect", lambda client: opened.remove(client) or disconnect(client))
    return opened


@pytest.mark.parametrize("options", OPTIONS)
def test_an_environment_that_is_dropped_frees_its_client_at_once(monkeypatch, options):
    opened = clients(monkeypatch)
    gc.disable()
    try:
        for _ in range(5):
            env = gymnasium.make(PANDA, **options)
            env.reset(seed=0)
            env.step(np.zeros(7))
            del env
            assert opened == []
    finally:
        gc.enable()


def test_an_environment_that_is_closed_and_dropped_frees_its_client_once(monkeypatch):
    opened = clients(monkeypatch)
    env = gymnasium.make(PLANAR)
    env.close()
    env.close()
    assert opened == []
    del env
    gc.collect()
    assert opened == []


@pytest.mark.parametrize(
    "options",
    [{"start_joints": np.zeros((1, 3))}, {"start_joints": "home"}, {"faults": Faults(hidden="wrist")},
     {"limits": Limits(velocity=(1.0,) * 3)}, {"reward": "shaped"}, {"target_spread": -1.0}],
)  # fmt: skip
def test_an_environment_that_could_not_be_made_leaves_no_client(monkeypatch, options):
    opened = clients(monkeypatch)
    with pytest.raises((RledError, ValueError)):
        gymnasium.make(PANDA, **options)
    assert opened == []


def test_a_robot_that_could_not_be_loaded_leaves_no_client(monkeypatch):
    opened = clients(monkeypatch)
    broken = copy.copy(ROBOTS["planar"])
    object.__setattr__(broken, "tip_link", "no such link")
    with pytest.raises(KeyError):
        World(broken, "kinematic", 0.02)
    assert opened == []


@pytest.mark.parametrize("name", [PANDA, PLANAR])
@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("way", WAYS)
def test_a_copy_goes_on_as_the_original_would_and_neither_moves_the_other(name, options, way):
    original, twin = begun(name, **options), begun(name, **options)
    copied = WAYS[way](original)
    expected = drive(twin, 1)
    assert drive(copied, 1) == expected
    assert drive(original, 1) == expected
    original.close()
    assert len(drive(copied, 2, 5)) >= 5


def test_a_copy_of_an_environment_before_its_first_reset_begins_like_it():
    original = gymnasium.make(PLANAR)
    copied = copy.deepcopy(original)
    assert copied.reset(seed=5)[0].tobytes() == original.reset(seed=5)[0].tobytes()


def test_motors_that_press_on_the_floor_are_copied_within_rounding():
    original = gymnasium.make(PANDA, transition="motors", targets_per_episode=0)
    original.reset(seed=0)
    down = np.array([0, 0.04, 0, 0, 0, 0, 0])
    for _ in range(80):
        *_, info = original.step(down)
    assert info["contacts"]
    copied = copy.deepcopy(original)
    for _ in range(20):
        expected, *_ = original.step(down)
        np.testing.assert_allclose(copied.step(down)[0], expected, atol=1e-4)  # rad and m


def test_what_has_a_window_or_is_closed_is_not_copied():
    env = ReachEnv("planar")
    env.simulation.plant._gui = True  # there is no display here
    for way in WAYS.values():
        with pytest.raises(RledError, match="a world with a window is not copied"):
            way(env)
    env.close()
    env.simulation.plant._gui = False
    for way in WAYS.values():
        with pytest.raises(RledError, match="the environment is closed"):
            way(env)


@pytest.mark.parametrize("use", ["step", "reset", "render"])
def test_what_is_closed_says_so(use):
    env = ReachEnv("planar", render_mode="rgb_array")
    env.reset(seed=0)
    env.close()
    with pytest.raises(RledError, match="the environment is closed; accepted: an open one; make it again"):
        getattr(env, use)(*([np.zeros(2)] if use == "step" else []))


def test_a_step_before_the_first_reset_says_so():
    with pytest.raises(RledError, match="no episode has begun; call reset first"):
        ReachEnv("planar").step(np.zeros(2))


def test_an_option_of_reset_is_refused_by_its_name():
    with pytest.raises(RledError, match="reset options target; accepted: none"):
        ReachEnv("planar").reset(options={"target": (0, 0, 0)})


def test_a_forked_process_has_an_environment_of_its_own():
    env = ReachEnv("planar")
    env.reset(seed=0)
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        env.step(np.full(2, 0.1))
        os.write(writer, np.array(env.simulation.plant.q).tobytes())
        env.close()
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    moved = np.frombuffer(os.read(reader, 16))
    np.testing.assert_allclose(moved, np.array(ROBOTS["planar"].home) + 0.1, atol=1e-12)
    env.step(np.full(2, -0.1))
    np.testing.assert_allclose(env.simulation.plant.q, np.array(ROBOTS["planar"].home) - 0.1, atol=1e-12)


def test_nothing_holds_an_environment_that_nobody_holds():
    gc.disable()
    try:
        for options in OPTIONS:
            env = gymnasium.make(PLANAR, **options)
            env.reset(seed=0)
            world = weakref.ref(env.unwrapped.simulation.plant)
            del env
            assert world() is None
    finally:
        gc.enable()
