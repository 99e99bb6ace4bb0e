import json
import pickle
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.policy import GateSettings, Origin, Policy, Shape, load_policy
from rled_agent.nn.tensor_file import TensorFileError
from rled_msgs_py.errors import ContractError, RledError
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task
from safetensors import safe_open
from safetensors.torch import load_file, save_file

OBSERVATIONS = np.random.default_rng(0).uniform(-1, 1, (50, 4))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "policies" / "expert.safetensors"


@pytest.fixture
def changed(path, make_policy):
    """Writes a policy with header entries or tensors replaced; None takes them out."""

    def write(header=(), **tensors):
        make_policy().save(path)
        with safe_open(path, "pt") as file:
            written = {name: value for name, value in (file.metadata() | dict(header)).items() if value is not None}
        saved = {name: each for name, each in (load_file(path) | tensors).items() if each is not None}
        save_file(saved, path, written)
        return path

    return write


@pytest.mark.parametrize(
    "settings", [{}, {"activation": "leaky_relu", "layer_norm": True, "dropout": 0.2}, {"hidden": ()}]
)
def test_a_policy_comes_back_bit_for_bit(path, make_policy, settings):
    policy = make_policy(3, **settings)
    policy.save(path)
    loaded = load_policy(path)
    assert loaded.task == policy.task
    assert loaded.network.architecture == policy.network.architecture
    np.testing.assert_array_equal(loaded.act(OBSERVATIONS), policy.act(OBSERVATIONS))


def test_members_critic_and_origin_come_back(path, make_policy):
    one, draws = make_policy(), Draws([5])
    actors = Perceptron(4, 2, Architecture(hidden=(7,)), draws, ensemble=3, squash=True)
    critic = Perceptron(6, 1, Architecture(hidden=(5, 4), layer_norm=True), draws, ensemble=2)
    origin = Origin("mc_rled", GateSettings("std", 0.25, 12, "critics"))
    policy = Policy(actors, one.scaling, one.task, origin, critic)
    policy.save(path)
    loaded = load_policy(path)
    assert loaded.origin == origin
    assert (loaded.network.ensemble, loaded.critic.ensemble) == (3, 2)
    assert (loaded.network.squash, loaded.critic.squash) == (True, False)
    assert loaded.critic.architecture == critic.architecture
    pairs = draws.normal(9, 6)[0]
    assert torch.equal(loaded.critic(pairs), critic(pairs))
    np.testing.assert_array_equal(loaded.act(OBSERVATIONS), policy.act(OBSERVATIONS))
    one.save(path)
    alone = load_policy(path)
    assert (alone.critic, alone.origin) == (None, Origin("cloning", None))


def test_the_mean_of_the_members_acts(make_policy):
    one = make_policy()
    members = Perceptron(4, 2, Architecture(hidden=()), Draws([0]), ensemble=2, squash=True)
    members.load_vector(np.zeros(20, dtype=np.float32))
    members.state_dict()["biases.0"].copy_(torch.tensor([[[0.5, -0.5]], [[1.0, 2.0]]]))
    actions = Policy(members, one.scaling, one.task).act(OBSERVATIONS[:3])
    expected = 0.1 * (np.tanh([0.5, -0.5]) + np.tanh([1.0, 2.0])) / 2
    np.testing.assert_allclose(actions, np.tile(expected, (3, 1)), rtol=1e-6)


def test_actions_are_physical_and_bounded(make_policy):
    policy = make_policy()
    policy.network.load_vector(100.0 * policy.network.vector())
    actions = policy.act(10 * OBSERVATIONS)
    assert np.abs(actions).max() == pytest.approx(policy.task.max_delta)


def test_one_observation_or_a_batch_gives_the_same(make_policy):
    policy = make_policy()
    batch = policy.act(OBSERVATIONS.reshape(5, 10, 4))
    assert batch.shape == (5, 10, 2)
    single = policy.act(OBSERVATIONS[7])
    assert single.shape == (2,)
    np.testing.assert_allclose(single, batch[0, 7], atol=1e-7)


def test_acting_takes_the_observation_through_the_scaling(make_policy):
    policy = make_policy()
    policy.network.load_vector(0.0 * policy.network.vector())
    policy.network.state_dict()["biases.2"].copy_(torch.tensor([[[0.5, -0.5]]]))
    np.testing.assert_allclose(policy.act(OBSERVATIONS[0]), 0.1 * np.tanh([0.5, -0.5]), rtol=1e-6)


def test_a_missing_policy_is_refused(path):
    with pytest.raises(TensorFileError, match=r"there is no .*expert"):
        load_policy(path)


def test_a_truncated_policy_is_refused(path, make_policy):
    make_policy().save(path)
    whole = path.read_bytes()
    for length in (0, 7, 200, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(TensorFileError, match="damaged"):
            load_policy(path)


@pytest.mark.parametrize(
    ("header", "what"),
    [
        ({"version": "1"}, "is rled-policy 1; accepted: rled-policy 3"),
        ({"format": "another"}, "is another 3; accepted: rled-policy 3"),
        ({"format": None}, "of no format"),
        ({"networks": None}, "damaged"),
        ({"networks": "{"}, "damaged"),
        ({"networks": json.dumps({"network": {"width": 3}})}, "damaged"),
        ({"networks": json.dumps({"critic": {"width": 3}})}, "networks of other names"),
        ({"origin": None}, "damaged"),
        ({"origin": "{}"}, "origin has other fields"),
        ({"task": None}, "damaged"),
        ({"task": "{}"}, "task description"),
    ],
)
def test_another_version_or_a_damaged_header_is_refused(changed, header, what):
    with pytest.raises(RledError, match=what) as caught:
        load_policy(changed(header))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("tensors", "what"),
    [
        (
            {"network.weights.0": torch.zeros(1, 5, 8)},
            r"\(1, 5, 8\) F32 as network.weights.0; accepted: \(1, 4, 8\)",
        ),
        ({"network.biases.1": None}, r"nothing as network.biases.1; accepted: \(1, 1, 6\)"),
        ({"observation_scale": torch.ones(3).double()}, r"\(3,\) F64 as observation_scale; accepted: \(4,\) F64"),
        ({"observation_scale": torch.ones(4)}, r"\(4,\) F32 as observation_scale; accepted: \(4,\) F64"),
        ({"network.weights.0": torch.zeros(1, 4, 8).half()}, r"\(1, 4, 8\) F16 as network.weights.0; accepted: .* F32"),
        ({"network.weights.9": torch.zeros(1)}, "holds network.weights.9; accepted: network.weights.0"),
    ],
)
def test_weights_of_another_shape_are_refused(changed, tensors, what):
    with pytest.raises(TensorFileError, match=what):
        load_policy(changed(**tensors))


def test_a_header_of_another_architecture_is_refused(changed, make_policy):
    wider = asdict(Shape(replace(make_policy().network.architecture, hidden=(9, 6)), 1))
    with pytest.raises(TensorFileError, match=r"network.weights.0"):
        load_policy(changed({"networks": json.dumps({"network": wider})}))


def test_a_pickle_is_refused(path):
    path.parent.mkdir()
    path.write_bytes(pickle.dumps({"weights": [1.0]}))
    with pytest.raises(TensorFileError, match="damaged"):
        load_policy(path)


def test_a_policy_of_another_robot_does_not_fit_a_task(path, make_policy, task):
    panda = reach_task(ROBOTS["panda"]).description
    make_policy(task=panda).save(path)
    with pytest.raises(ContractError, match="the policy is for robot panda; accepted: planar"):
        task.require_same_robot(load_policy(path).task, "the policy")


def test_a_policy_that_cannot_be_written_is_one_clear_error(tmp_path, make_policy):
    (tmp_path / "file").touch()
    with pytest.raises(TensorFileError, match=r"can't write .*policy"):
        make_policy().save(tmp_path / "file" / "policy.safetensors")


@pytest.mark.parametrize("name", ["expert.safetensors", "policy.safetensors"])
def test_the_folder_of_a_training_stands_for_the_policy_in_it(tmp_path, make_policy, name):
    with pytest.raises(TensorFileError, match=r"no policy in .*; accepted: policy.safetensors or expert.safetensors"):
        load_policy(tmp_path)
    policy = make_policy()
    policy.save(tmp_path / name)
    found = load_policy(tmp_path)
    assert (found.network.vector() == policy.network.vector()).all()


def test_a_seed_of_a_population_is_saved_as_one_alone(path, tmp_path, make_policy):
    one, settings = make_policy(), Architecture(hidden=(7, 5))
    actors = Perceptron(4, 2, settings, Draws([3, 4, 5]), squash=True)
    critics = Perceptron(6, 1, settings, Draws([3, 4, 5]), ensemble=2)
    for k, seed in enumerate((3, 4, 5)):
        Policy(actors.member(k), one.scaling, one.task, critic=critics.member(k)).save(path)
        actor = Perceptron(4, 2, settings, Draws([seed]), squash=True)
        critic = Perceptron(6, 1, settings, Draws([seed]), ensemble=2)
        Policy(actor, one.scaling, one.task, critic=critic).save(tmp_path / "alone")
        assert path.read_bytes() == (tmp_path / "alone").read_bytes()
        loaded = load_policy(path)
        assert (loaded.network.population, loaded.critic.population, loaded.critic.ensemble) == (1, 1, 2)
