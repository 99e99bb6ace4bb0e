"""The environments of Gymnasium, and what they take for an action."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.errors import RledError
from rled_msgs_py.task_limits import Limits, Zone
from rled_sim.action import action_array
from rled_sim.robots import ROBOTS

import rled_sim  # noqa: F401

NAMES = ("rled/PandaReach-v0", "rled/PlanarReach-v0")


@pytest.fixture
def make(request):
    opened = []

    def opener(name, **options):
        opened.append(gymnasium.make(name, **options))
        return opened[-1]

    yield opener
    for env in opened:
        env.close()


def drive(env, seed, steps):
    """Observations, rewards and ends of random actions, of several episodes."""
    observation, info = env.reset(seed=seed)
    rng, track = np.random.default_rng(seed), [(observation.tobytes(), info)]
    for _ in range(steps):
        action = rng.uniform(-1, 1, env.action_space.shape).astype(np.float32) * env.action_space.high
        observation, *rest = env.step(action)
        track.append((observation.tobytes(), *rest))
        if rest[1] or rest[2]:
            track.append(env.reset()[0].tobytes())
    return track


@pytest.mark.filterwarnings("ignore:.*render_mode 'human' shows nothing")
@pytest.mark.parametrize("name", NAMES)
def test_env_checker_passes(make, name, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    check_env(make(name).unwrapped)


@pytest.mark.parametrize("options", [{}, {"transition": "motors"}, {"reward": "sparse"}])
@pytest.mark.parametrize("name", NAMES)
def test_same_seed_gives_the_same_trajectory_bit_for_bit(make, name, options):
    tracks = [drive(make(name, max_steps=30, **options), 7, 200) for _ in range(2)]
    assert tracks[0] == tracks[1]


def test_other_seed_gives_another_trajectory(make):
    env = make(NAMES[0])
    assert env.reset(seed=1)[0].tobytes() != env.reset(seed=2)[0].tobytes()


def test_reset_without_a_seed_goes_on_with_the_draws(make):
    env = make(NAMES[0])
    seeded = [env.reset(seed=1)[0].tobytes(), env.reset()[0].tobytes()]
    assert seeded[0] != seeded[1]
    assert [env.reset(seed=1)[0].tobytes(), env.reset()[0].tobytes()] == seeded


@pytest.mark.parametrize("name", NAMES)
def test_observation_equals_the_description_of_the_task(make, name):
    env = make(name)
    observation, _ = env.reset(seed=0)
    inside, task = env.unwrapped.simulation, env.unwrapped.task
    for _ in range(50):
        q, position, target = (
            np.array(each) for each in (inside.plant.q, inside.plant.position, inside.episode.target)
        )
        assert observation.tobytes() == task.observe(q, position, target).astype(np.float32).tobytes()
        assert env.observation_space.contains(observation)
        observation, *_ = env.step(env.action_space.sample())


def test_state_is_the_displacement_to_the_target_and_the_joints(make):
    observation, _ = make(NAMES[0]).reset(seed=0)
    np.testing.assert_array_equal(observation[3:], np.float32(ROBOTS["panda"].home))
    tip = ROBOTS["panda"].chain.position(ROBOTS["panda"].home)
    assert observation[0] == pytest.approx(0.5 - tip[0], abs=1e-6)


def test_sizes_and_limits_of_both_tasks(make):
    panda, planar = (make(name) for name in NAMES)
    assert (panda.observation_space.shape, panda.action_space.shape) == ((10,), (7,))
    assert (planar.observation_space.shape, planar.action_space.shape) == ((4,), (2,))
    assert panda.action_space.high[0] == np.float32(0.04)
    assert planar.action_space.high[0] == np.float32(0.1)
    assert panda.unwrapped.task.max_steps == 999
    assert planar.unwrapped.task.max_steps == 100


def test_actions_are_clipped_to_the_largest_displacement(make):
    env = make(NAMES[0])
    env.reset(seed=0)
    observation, *_ = env.step(np.full(7, 1.0, np.float32))
    np.testing.assert_allclose(observation[3:], np.array(ROBOTS["panda"].home) + 0.04, atol=1e-6)


@pytest.mark.parametrize("action", [np.full(7, np.nan), np.r_[np.inf, np.zeros(6)], np.zeros(6)])
def test_bad_actions_are_refused(make, action):
    env = make(NAMES[0])
    env.reset(seed=0)
    with pytest.raises(RledError, match="7 finite numbers"):
        env.unwrapped.step(action)


def test_episodes_start_at_the_given_joints(make):
    starts = np.random.default_rng(0).uniform(-0.2, 0.2, (5, 7)) + ROBOTS["panda"].home
    env = make(NAMES[0], start_joints=starts)
    seen = {env.reset(seed=seed)[0][3:].tobytes() for seed in range(60)}
    assert seen == {row.astype(np.float32).tobytes() for row in starts}


@pytest.mark.parametrize(
    ("starts", "what"),
    [
        (np.zeros((3, 6)), r"shape \(3, 6\)"),
        (np.zeros((0, 7)), r"shape \(0, 7\)"),
        (np.ones((1, 7)), "panda_joint4 is"),
    ],
)
def test_start_joints_that_do_not_fit_are_refused(starts, what):
    with pytest.raises(RledError, match=what):
        gymnasium.make(NAMES[0], start_joints=starts)


def test_info_counts_targets_and_violations(make):
    env = make(NAMES[1])
    _, info = env.reset(seed=0)
    assert info == {"targets_reached": 0, "violations": 0, "risky": False}
    for _ in range(20):
        _, reward, _, _, info = env.step(np.array([0.0, -0.1], np.float32))
    # the arm is straight: the tip is 1 m from the base
    assert info["risky"]
    assert info["violations"] > 5
    assert reward < -1.0


def test_episode_of_the_planar_arm_is_cut_after_100_steps(make):
    env = make(NAMES[1])
    env.reset(seed=1)
    ends = [env.step(np.zeros(2, np.float32))[2:4] for _ in range(100)]
    assert ends == [(False, False)] * 99 + [(False, True)]


def test_motors_report_contacts(make):
    env = make(NAMES[0], transition="motors")
    _, info = env.reset(seed=0)
    assert info["contacts"] == []
    for _ in range(80):
        *_, info = env.step(np.array([0, 0.04, 0, 0, 0, 0, 0], np.float32))
    assert "floor" in {contact.other for contact in info["contacts"]}


def test_picture_is_rendered(make):
    env = make(NAMES[0], render_mode="rgb_array")
    env.reset(seed=0)
    assert env.render().shape == (480, 640, 3)


@pytest.mark.filterwarnings("ignore:.*not in the possible render_modes")
@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"robot": "ur5"}, "unknown robot 'ur5'; accepted: panda, planar"),
        ({"render_mode": "ascii"}, "render_mode 'ascii'"),
        ({"transition": "motor"}, "transition 'motor'; accepted: kinematic, motors"),
        ({"faults": {"control_delay": 1}}, "faults {'control_delay': 1}; accepted: rled_sim.faults.Faults"),
        ({"reward": "shaped"}, "reward 'shaped'"),
    ],
)
def test_unknown_options_are_refused(options, what):
    with pytest.raises(RledError, match=what):
        gymnasium.make(NAMES[0], **options)


def test_a_limit_makes_the_robot_stay_and_the_step_count(make):
    zone = Zone("sphere", (0.5, 0.0, 0.1), (0.05,))
    env = make(NAMES[1], limits=Limits(keep_out=(zone,), joint_lower=(-0.95, 0.5), joint_upper=(0.0, 2.0)))
    before, info = env.reset(seed=0)
    assert "refused" not in info
    after, _, _, _, info = env.step(np.array([-0.06, 0.0], np.float32))  # from -0.9 rad
    assert info["refused"] == "joint_range"
    np.testing.assert_array_equal(after, before)
    after, _, _, _, info = env.step(np.array([-0.04, 0.0], np.float32))
    assert "refused" not in info
    assert not np.array_equal(after, before)
    assert env.unwrapped.simulation.episode.steps == 2


def test_limits_off_change_no_bit_and_wide_ones_neither(make):
    wide = Limits(joint_lower=(-9.0,) * 7, joint_upper=(9.0,) * 7, velocity=(9.0,) * 7, acceleration=(1e6,) * 7)
    for name, transition in ((NAMES[0], "kinematic"), (NAMES[0], "motors")):
        tracks = [
            drive(make(name, max_steps=30, transition=transition, **each), 7, 60) for each in ({}, {"limits": wide})
        ]
        assert tracks[0] == tracks[1]


def test_limits_of_another_number_of_joints_are_refused(make):
    with pytest.raises(RledError, match="velocity has 7 values; accepted: 2"):
        make(NAMES[1], limits=Limits(velocity=(1.0,) * 7))


@pytest.mark.parametrize("transition", ["kinematic", "motors"])
def test_the_robot_is_not_sent_into_the_floor_where_collisions_are_limited(make, transition):
    env = make(NAMES[0], limits=Limits(collisions=True), transition=transition, targets_per_episode=0)
    env.reset(seed=0)
    refused = []
    for _ in range(80):
        *_, info = env.step(np.array([0, 0.04, 0, 0, 0, 0, 0], np.float32))
        world = env.unwrapped.simulation.plant
        assert world.touches(np.array(world.set_point)) == {}  # physics may carry the motors a little further
        refused.append(info.get("refused"))
    assert refused[0] is None
    assert refused[-1] == "contact"


# What an environment takes for an action.


NUMBERS = st.floats(allow_nan=False, allow_infinity=False, width=32)
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary() | st.complex_numbers(),
    lambda part: st.lists(part, max_size=4) | st.dictionaries(st.text(), part, max_size=2),
    max_leaves=9,
)


@given(st.lists(NUMBERS, min_size=2, max_size=2))
def test_whatever_numpy_makes_an_array_of_is_taken_number_by_number(numbers):
    for made in (list, tuple, np.array, lambda each: np.array(each, np.float32)):
        assert action_array(made(numbers), 2).tolist() == numbers
    assert action_array([3, -4], 2).tolist() == [3.0, -4.0]


@given(ANYTHING)
def test_everything_else_is_one_clear_error(action):
    said = None
    try:
        taken = action_array(action, 3)
    except RledError as error:
        said = str(error)
    if said is None:
        assert taken.shape == (3,)
        assert np.isfinite(taken).all()
    else:
        assert said.startswith("action ")
        assert said.endswith("accepted: 3 finite numbers (rad)")
        assert "\n" not in said
        assert len(said) < 200


@pytest.mark.parametrize(
    "action",
    [
        [None] * 2, ["1", "2"], [True, False], [1j, 2j], [10**400, 0], [[1], [1, 2]], [[1.0, 2.0]], [1.0], 1.0,
        np.zeros((2, 1)), np.array([np.nan, 0.0]), np.array([np.inf, 0.0]), np.array(["a", "b"]), b"12", object(),
    ],
)  # fmt: skip
def test_what_is_no_displacement_is_refused(action):
    with pytest.raises(RledError, match=r"accepted: 2 finite numbers"):
        action_array(action, 2)
