"""Batches of environments against the single ones, one step after another."""

import contextlib
import copy
import pickle
from dataclasses import fields, replace

import gymnasium
import numpy as np
import pytest
import torch
from rled_msgs_py.errors import RledError
from rled_msgs_py.task_limits import Limits
from rled_sim.faults import NO_FAULTS, Faults
from rled_sim.robots import ROBOTS
from rled_sim.vector.reach import BatchStep, ReachBatch
from torch.utils._python_dispatch import TorchDispatchMode

from rled_sim import ENVIRONMENTS

N = 10
EVERYTHING = Faults(
    observation_delay=1,
    observation_delay_spread=2,
    control_delay=1,
    control_delay_spread=3,
    reward_delay=2,
    reward_delay_spread=3,
    sensor_noise=0.01,
    actuator_noise=0.2,
    observation_loss=0.2,
    command_loss=0.2,
    command_repeat=0.2,
    hidden="target",
)
RICH = {"max_steps": 40, "target_spread": 0.01, "faults": EVERYTHING}
"""Settings with every kind of draw."""


@pytest.fixture(scope="module")
def singles():
    """Opens single environments, N alike, and closes those before: each has a world of its own in memory."""
    opened, held = {}, contextlib.ExitStack()

    def opener(robot, **options):
        key = (robot, repr(sorted(options.items())))
        if key not in opened:
            held.close()
            opened.clear()
            envs = [gymnasium.make(ENVIRONMENTS[robot], **options) for _ in range(N)]
            opened[key] = [held.enter_context(contextlib.closing(env)) for env in envs]
        return opened[key]

    with held:
        yield opener


def starts_of(robot, count=4):
    return np.random.default_rng(7).uniform(-0.05, 0.05, (count, len(ROBOTS[robot].home))) + ROBOTS[robot].home


def deltas(robot, num_envs, steps, seed=0):
    """Random displacements, some larger than they may be, that wander: (steps, N, n)."""
    size, largest = len(ROBOTS[robot].home), ROBOTS[robot].max_delta
    rng = np.random.default_rng(seed)
    drift = rng.uniform(-0.7, 0.7, (num_envs, size))
    return (largest * (drift + rng.uniform(-1.0, 1.0, (steps, num_envs, size)))).astype(np.float32)


def plain(step):
    return BatchStep(*(np.asarray(each) for each in step))


def one_by_one(envs, actions, seeds):
    """What N single environments give, an episode begun in the step after an end: first observations, then steps."""
    first = np.array([env.reset(seed=seed)[0] for env, seed in zip(envs, seeds, strict=True)])
    over, steps = [False] * len(envs), []
    for action in actions:
        rows = []
        for row, env in enumerate(envs):
            if over[row]:
                observation, info = env.reset()
                reward, terminated, truncated = 0.0, False, False
            else:
                observation, reward, terminated, truncated, info = env.step(action[row])
            rows.append((observation, reward, terminated, truncated, *(info[each] for each in BatchStep._fields[4:])))
            over[row] = terminated or truncated
        steps.append(BatchStep(*map(np.array, zip(*rows, strict=True))))
    return first, steps


def together(batch, actions, seeds):
    """The same of a batch."""
    batch.seed(seeds)
    first, over, steps = np.asarray(batch.begin()), None, []
    for action in actions:
        steps.append(plain(batch.step(action, over)))
        over = steps[-1].terminated | steps[-1].truncated
    return first, steps


def assert_equal(singly, batched):
    np.testing.assert_allclose(batched[0], singly[0], rtol=0, atol=1e-6)
    for one, many in zip(singly[1], batched[1], strict=True):
        np.testing.assert_allclose(many.observation, one.observation, rtol=0, atol=1e-6)
        np.testing.assert_allclose(many.reward, one.reward, rtol=0, atol=1e-6)
        for each in BatchStep._fields[2:]:
            np.testing.assert_array_equal(getattr(many, each), getattr(one, each), each)


@pytest.mark.parametrize("reward", ["dense", "sparse"])
@pytest.mark.parametrize("robot", ENVIRONMENTS)
def test_a_batch_equals_single_environments_over_ten_thousand_steps(singles, robot, reward):
    options = {"reward": reward, "max_steps": 100, "start_joints": starts_of(robot), "target_spread": 0.05}
    actions = deltas(robot, N, 1000)
    singly = one_by_one(singles(robot, **options), actions, range(N))
    assert sum(step.targets_reached.max() for step in singly[1]) > 10
    assert sum(step.truncated.sum() for step in singly[1]) > 10
    for device in (None, "cpu"):
        assert_equal(singly, together(ReachBatch(robot, N, device=device, **options), actions, range(N)))


@pytest.mark.parametrize("robot", ENVIRONMENTS)
def test_a_batch_with_all_faults_equals_single_environments(singles, robot):
    options = RICH | {"start_joints": starts_of(robot)}
    actions = deltas(robot, N, 500)
    singly = one_by_one(singles(robot, **options), actions, range(N))
    for device in (None, "cpu"):
        assert_equal(singly, together(ReachBatch(robot, N, device=device, **options), actions, range(N)))


@pytest.mark.parametrize("name", [each.name for each in fields(Faults)])
def test_a_batch_with_one_fault_equals_single_environments(singles, name):
    value = {"hidden": "elbow ee"}.get(name, 2 if "delay" in name else 0.3)
    options = {"max_steps": 30, "faults": Faults(**{name: value})}
    actions = deltas("planar", N, 100)
    singly = one_by_one(singles("planar", **options), actions, range(N))
    for device in (None, "cpu"):
        assert_equal(singly, together(ReachBatch("planar", N, device=device, **options), actions, range(N)))


@pytest.mark.parametrize("device", [None, "cpu"])
@pytest.mark.parametrize("robot", ENVIRONMENTS)
def test_numbers_do_not_depend_on_how_many_run_beside_bit_for_bit(robot, device):
    actions, seeds = deltas(robot, 7, 100), [4, 9, 1, 1, 0, 30, 2**40]
    options = RICH | {"start_joints": starts_of(robot), "device": device}
    first, steps = together(ReachBatch(robot, 7, **options), actions, seeds)
    for row, seed in enumerate(seeds):
        alone_first, alone = together(ReachBatch(robot, 1, **options), actions[:, row : row + 1], [seed])
        assert alone_first[0].tobytes() == first[row].tobytes()
        for one, many in zip(alone, steps, strict=True):
            assert [each[0].tobytes() for each in one] == [each[row].tobytes() for each in many]


def test_numpy_and_torch_draw_the_same():
    actions = deltas("panda", N, 100)
    ours, theirs = (
        together(ReachBatch("panda", N, device=device, **RICH), actions, range(N)) for device in (None, "cpu")
    )
    assert_equal(ours, theirs)


@pytest.mark.parametrize("given", [None, "cpu"])
@pytest.mark.parametrize("device", [None, "cpu"])
def test_a_loaded_state_goes_on_bit_for_bit(device, given):
    actions = deltas("planar", N, 300)
    batch = ReachBatch("planar", N, device=given, **RICH)
    together(batch, actions[:150], range(N))
    state = batch.state_dict()
    assert {len(each) for each in state.values()} == {N}
    order = np.random.default_rng(0).permutation(N)  # a row is one environment's whole state
    other = ReachBatch("planar", N, device=device, **RICH)
    other.load_state_dict({name: each[order] for name, each in state.items()})
    for action in actions[150:]:
        ours, theirs = plain(batch.step(action)), plain(other.step(action[order]))
        if device == given:
            assert [each[order].tobytes() for each in ours] == [each.tobytes() for each in theirs]
        else:
            np.testing.assert_allclose(theirs.observation, ours.observation[order], atol=1e-6)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda each: pickle.loads(pickle.dumps(each))])
@pytest.mark.parametrize("device", [None, "cpu"])
def test_a_copied_batch_goes_on_by_itself(device, copied):
    actions = deltas("planar", 3, 200)
    batch = ReachBatch("planar", 3, device=device, **RICH)
    together(batch, actions[:50], range(3))
    other = copied(batch)
    ours, theirs = ([plain(each.step(action)) for action in actions[50:]] for each in (batch, other))
    assert [step.observation.tobytes() for step in ours] == [step.observation.tobytes() for step in theirs]


def test_a_state_is_a_copy():
    batch = ReachBatch("planar", 3, **RICH)
    batch.begin()
    before = batch.state_dict()
    kept = {name: each.copy() for name, each in before.items()}
    for action in deltas("planar", 3, 5):
        batch.step(action)
    assert all(np.array_equal(before[name], kept[name]) for name in kept)
    batch.load_state_dict(before)
    for action in deltas("planar", 3, 5):
        batch.step(action)
    assert all(np.array_equal(before[name], kept[name]) for name in kept)


def test_episodes_begin_where_the_mask_holds_and_go_on_elsewhere():
    batch, other = (ReachBatch("panda", 4, target_spread=0.1) for _ in range(2))
    for each in (batch, other):
        each.seed(range(4))
        each.begin()
    actions = deltas("panda", 4, 10)
    for action in actions:
        batch.step(action)
        other.step(action)
    which = np.array([True, False, False, True])
    before, after = batch.episodes, batch.begin(which)
    np.testing.assert_allclose(batch.episodes.joints[which], [ROBOTS["panda"].home] * 2)
    assert batch.episodes.steps.tolist() == [0, 10, 10, 0]
    assert (batch.episodes.target[which] != before.target[which]).any(axis=1).all()
    np.testing.assert_array_equal(batch.episodes.target[~which], before.target[~which])
    action = actions[0]
    ours, theirs = batch.step(action), other.step(action)
    assert ours.observation[~which].tobytes() == theirs.observation[~which].tobytes()
    assert after.shape == (4, 10)
    assert after.dtype == np.float32


def test_environments_that_never_began_are_nan():
    batch = ReachBatch("planar", 2)
    observation = batch.begin([True, False])
    assert np.isnan(observation).all(axis=1).tolist() == [False, True]


def test_an_episode_that_is_over_goes_on_if_nobody_begins_another():
    batch = ReachBatch("planar", 1, max_steps=3, targets_per_episode=0)
    batch.begin()
    ends = [bool(batch.step(np.zeros((1, 2))).truncated[0]) for _ in range(6)]
    assert ends == [False, False, True, False, False, False]


@pytest.mark.parametrize("device", [None, "cpu"])
@pytest.mark.parametrize("faults", [NO_FAULTS, EVERYTHING])
def test_a_nan_harms_its_environment_alone_until_it_begins(device, faults):
    actions, seeds = deltas("planar", 5, 60), range(5)
    batch, sound = (ReachBatch("planar", 5, device=device, max_steps=0, faults=faults) for _ in range(2))
    for each in (batch, sound):
        each.seed(seeds)
        each.begin()
    for k, action in enumerate(actions):
        poisoned = action.copy()
        poisoned[2, 0] = np.nan if k in (20, 21, 22, 23, 24) else poisoned[2, 0]
        ours, theirs = plain(batch.step(poisoned)), plain(sound.step(action))
        for one, other in zip(ours, theirs, strict=True):
            np.testing.assert_array_equal(np.delete(one, 2, 0), np.delete(other, 2, 0))
    assert np.isnan(ours.observation[2]).any()
    assert np.isfinite(np.asarray(batch.begin(np.arange(5) == 2))).all()
    for action in actions:
        step = plain(batch.step(action))
        assert np.isfinite(step.observation).all()
        assert np.isfinite(step.reward).all()


def test_infinite_actions_are_the_largest():
    batch = ReachBatch("planar", 2)
    batch.begin()
    batch.step(np.array([[np.inf, -np.inf], [5.0, -5.0]]))
    np.testing.assert_allclose(batch.episodes.joints, [(-0.8, 1.7)] * 2)


class NothingRead(TorchDispatchMode):
    """Refuses operations that make the host wait for a device."""

    def __torch_dispatch__(self, operation, types, args=(), kwargs=None):
        name = str(operation)
        assert not any(
            each in name for each in ("_local_scalar_dense", "nonzero", "is_nonzero", "equal.", "masked_select")
        )
        return operation(*args, **(kwargs or {}))


@pytest.mark.parametrize("faults", [NO_FAULTS, EVERYTHING])
def test_nothing_is_read_back_from_a_device_between_two_looks_at_the_draws(faults):
    batch = ReachBatch("panda", 5, device="cpu", target_spread=0.1, faults=faults)
    action = torch.zeros(5, 7)
    over = torch.tensor([True, False, False, True, False])
    with NothingRead():
        batch.begin()
        batch.begin(over)
        for _ in range(20):
            batch.step(action)
            batch.step(action, over)


def test_actions_of_a_policy_that_learns_leave_no_graph():
    batch = ReachBatch("planar", 2, device="cpu")
    batch.begin()
    assert not batch.step(torch.zeros(2, 2, requires_grad=True)).reward.requires_grad


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"robot": "ur5"}, "unknown robot 'ur5'; accepted: panda, planar"),
        ({"num_envs": 0}, "num_envs is 0; accepted: 1 or more"),
        ({"reward": "shaped"}, "reward 'shaped'"),
        ({"start_joints": np.zeros((2, 7))}, r"start joints of shape \(2, 7\)"),
        ({"faults": {"control_delay": 1}}, "faults {'control_delay': 1}; accepted: rled_sim.faults.Faults"),
        ({"faults": Faults(hidden="wrist")}, "hidden is 'wrist'; accepted: shoulder, elbow, ee, target"),
        ({"device": "abacus"}, "device 'abacus': .*; accepted: None"),
    ],
)
def test_settings_that_do_not_fit_are_refused(options, said):
    with pytest.raises(RledError, match=said):
        ReachBatch(**({"robot": "planar", "num_envs": 2} | options))


def test_arrays_that_do_not_fit_are_refused():
    batch = ReachBatch("planar", 2)
    with pytest.raises(RledError, match="no episode has begun; call begin first"):
        batch.step(np.zeros((2, 2)))
    batch.begin()
    state = batch.state_dict()
    for use, said in (
        (lambda: batch.step(np.zeros(2)), r"actions of shape \(2,\); accepted: \(2, 2\)"),
        (lambda: batch.step([["a", "b"]] * 2), "numbers"),
        (lambda: batch.begin([True]), r"a mask of shape \(1,\); accepted: \(2,\)"),
        (lambda: batch.seed([1]), "1 seeds; accepted: 2, one for each environment"),
        (lambda: batch.seed([1, -1]), "seed -1; accepted: whole numbers from 0 to"),
        (lambda: batch.load_state_dict({"joints": 1}), "a state of joints; accepted: joints, position"),
        (lambda: batch.load_state_dict(state | {"steps": np.zeros(3)}), r"steps of shape \(3,\); accepted: \(2,\)"),
    ):
        with pytest.raises(RledError, match=said):
            use()


class TestVectorEnv:
    def both(self, make, robot="planar", **options):
        kwargs = {"num_envs": 5} | options
        device = kwargs.pop("device", None)
        batch = make(robot, device=device, **kwargs)
        return batch, make(robot, vectorization_mode="sync", **kwargs)

    @pytest.fixture
    def make(self):
        opened = []

        def opener(robot, **options):
            if options.get("device", "") is None:
                del options["device"]
            opened.append(gymnasium.make_vec(ENVIRONMENTS[robot], **options))
            return opened[-1]

        yield opener
        for each in opened:
            each.close()

    @staticmethod
    def assert_same(ours, theirs, is_torch=False):
        *values, info = ours
        *expected, told = theirs
        for one, other in zip(values, expected, strict=True):
            np.testing.assert_allclose(np.asarray(one), other, rtol=0, atol=1e-6)
            assert np.asarray(one).dtype == other.dtype
        assert info.keys() == told.keys()
        for name, each in told.items():
            np.testing.assert_array_equal(np.asarray(info[name]), each, name)
            assert np.asarray(info[name]).dtype == each.dtype

    @pytest.mark.parametrize("device", [None, "cpu"])
    @pytest.mark.parametrize("faults", [NO_FAULTS, replace(EVERYTHING, hidden="")])
    @pytest.mark.parametrize("robot", ENVIRONMENTS)
    def test_it_begins_episodes_as_gymnasiums_own_does(self, make, robot, faults, device):
        ours, theirs = self.both(make, robot, faults=faults, max_steps=20, start_joints=starts_of(robot), device=device)
        assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"]
        for space in ("observation_space", "action_space", "single_observation_space", "single_action_space"):
            assert getattr(ours, space) == getattr(theirs, space)
        self.assert_same(ours.reset(seed=11), theirs.reset(seed=11))
        for action in deltas(robot, 5, 90):
            self.assert_same(ours.step(action), theirs.step(action))
        self.assert_same(ours.reset(), theirs.reset())
        self.assert_same(ours.reset(seed=[3, None, 5, 5, None]), theirs.reset(seed=[3, None, 5, 5, None]))
        for action in deltas(robot, 5, 9):
            self.assert_same(ours.step(action), theirs.step(action))
        mask = np.array([True, False, True, False, False])
        self.assert_same(
            ours.reset(seed=4, options={"reset_mask": mask}), theirs.reset(seed=4, options={"reset_mask": mask})
        )
        for action in deltas(robot, 5, 30):
            self.assert_same(ours.step(action), theirs.step(action))

    def test_a_device_gives_tensors(self, make):
        env = make("panda", num_envs=3, device="cpu")
        observation, info = env.reset(seed=0)
        assert isinstance(observation, torch.Tensor)
        step = env.step(torch.zeros(3, 7))
        assert {type(each) for each in step[:4]} == {torch.Tensor}
        assert {type(each) for each in info.values()} == {torch.Tensor}

    @pytest.mark.parametrize(
        ("options", "what"),
        [
            ({"transition": "motors"}, "transition 'motors'"),
            ({"limits": Limits(collisions=True)}, "limits"),
            ({"render_mode": "rgb_array"}, "render_mode 'rgb_array'"),
        ],
    )
    def test_what_only_single_environments_do_is_refused(self, make, options, what):
        with pytest.raises(RledError, match=f"{what}.* of a batch.*gymnasium.make, .*vectorization_mode='sync'"):
            make("planar", num_envs=2, **options)
        make("planar", num_envs=2, vectorization_mode="sync", **options)

    def test_what_it_does_not_know_is_refused(self, make):
        env = make("planar", num_envs=2)
        with pytest.raises(RledError, match="no episode has begun"):
            env.step(np.zeros((2, 2)))
        for options, said in (
            ({"options": {"target": 1}}, "reset options target"),
            ({"options": {"reset_mask": np.ones(3, bool)}}, r"a mask of shape \(3,\)"),
            ({"seed": [1, 2, 3]}, "3 seeds; accepted: 2"),
            ({"seed": -1}, "seed -1"),
        ):
            with pytest.raises(RledError, match=said):
                env.reset(**options)

    def test_gymnasiums_wrappers_take_it(self, make):
        env = gymnasium.wrappers.vector.RecordEpisodeStatistics(make("planar", num_envs=2, max_steps=5))
        env.reset(seed=[1, 4])  # whose targets are not where they stand
        for _ in range(5):
            *_, info = env.step(np.zeros(env.action_space.shape, np.float32))
        assert info["episode"]["l"].tolist() == [5, 5]
