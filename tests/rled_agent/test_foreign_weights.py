"""Weights and checkpoints from a stranger: refused in one line, before they cost anything."""

import json
import struct
import tracemalloc
from dataclasses import asdict

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rled_agent.methods import all_methods
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.policy import load_policy
from rled_agent.nn.tensor_file import TensorFileError
from rled_agent.training.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from rled_agent.training.run_directory import RunDirectory
from rled_msgs_py.errors import RledError
from safetensors import safe_open
from safetensors.torch import load_file, save_file

JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 10**20) | st.floats() | st.text(max_size=9),
    lambda part: st.lists(part, max_size=3) | st.dictionaries(st.text(max_size=4), part, max_size=3),
    max_leaves=6,
)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "policy.safetensors"


@pytest.fixture
def changed(path, make_policy):
    """Writes a policy with texts of its header or tensors replaced; None takes them out."""

    def write(header=(), **tensors):
        make_policy().save(path)
        with safe_open(path, "pt") as file:
            texts = {name: each for name, each in (file.metadata() | dict(header)).items() if each is not None}
        save_file({name: each for name, each in (load_file(path) | tensors).items() if each is not None}, path, texts)
        return path

    return write


def refusal(path) -> str:
    with pytest.raises(RledError) as caught:
        load_policy(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1000
    return str(caught.value)


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("hidden", [1.5], "architecture.hidden (1.5,)); accepted: a list, each a whole number"),
        ("hidden", [-5], "architecture.hidden is (-5,)); accepted: 1 to 100000"),
        ("hidden", [0], "architecture.hidden is (0,)"),
        ("hidden", [True], "architecture.hidden (True,)"),
        ("hidden", "abc", "architecture.hidden 'abc'"),
        ("hidden", None, "architecture.hidden None"),
        ("hidden", [1] * 100_000, "accepted: at most 32 values"),
        ("hidden", [[8, 6]], "architecture.hidden ((8, 6),)"),
        ("hidden", [100_000] * 32, "holds (1, 4, 8) F32 as network.weights.0; accepted: (1, 4, 100000) F32"),
        ("hidden", [10**30], "architecture.hidden (1000000000000000000000000000000,)"),
        ("dropout", 1.0, "architecture.dropout is 1.0); accepted: 0 to 0.95"),
        ("dropout", "much", "architecture.dropout 'much'); accepted: a finite number"),
        ("layer_norm", 1, "architecture.layer_norm 1); accepted: true or false"),
        ("activation", "tanh", "architecture.activation 'tanh'); accepted: relu, leaky_relu"),
        ("width", 3, "architecture has other fields"),
    ],
)
def test_an_architecture_that_makes_no_network_is_refused_by_its_field(changed, make_policy, field, value, said):
    architecture = asdict(make_policy().network.architecture) | {field: value}
    networks = {"network": {"architecture": architecture, "members": 1}}
    assert said in refusal(changed({"networks": json.dumps(networks)}))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(st.sampled_from(["networks", "task", "origin"]), JSON)
def test_any_other_json_in_the_header_is_one_clear_error(changed, part, content):
    try:
        load_policy(changed({part: json.dumps(content)}))
    except RledError as error:
        said = str(error)
        assert "\n" not in said
    else:
        assert part == "origin"
        assert set(content) == {"method", "gate"}


@pytest.mark.parametrize("text", ["[" * 100_000, "{", "", "\x00", '{"a": ' * 2000, "NaN", "1e999"])
def test_a_header_that_is_no_json_is_refused(changed, text):
    for part in ("networks", "task", "origin"):
        refusal(changed({part: text}))


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["network.weights.0", "network.biases.2", "observation_center", "action_scale"])
def test_a_number_that_is_not_finite_is_refused_by_its_tensor(changed, path, name, number):
    tensor = load_file(changed())[name]
    tensor.view(-1)[-1] = number
    assert f"holds NaN or infinity in {name}; accepted: finite numbers" in refusal(changed(**{name: tensor}))


@pytest.mark.parametrize("name", ["observation_scale", "action_scale"])
@pytest.mark.parametrize("number", [0.0, -1.0])
def test_a_scale_that_is_not_positive_is_refused(changed, name, number):
    tensor = load_file(changed())[name]
    tensor[0] = number
    assert f"holds 0 or less in {name}" in refusal(changed(**{name: tensor}))


@pytest.mark.parametrize("size", [5 << 20, 1 << 30, 2**63, 2**64 - 1])
def test_a_header_of_absurd_size_costs_nothing(path, size):
    """The file is sparse: as large as its header says, and holds nothing."""
    with path.open("wb") as file:
        file.write(struct.pack("<Q", size))
        file.truncate(min(size + 8, 1 << 34))
    tracemalloc.start()
    assert "is damaged (its header would have" in refusal(path)
    assert tracemalloc.get_traced_memory()[1] < 1 << 20
    tracemalloc.stop()


def test_tensors_that_do_not_fill_the_file_as_the_header_says_are_refused(path, make_policy):
    make_policy().save(path)
    whole = path.read_bytes()
    size = struct.unpack("<Q", whole[:8])[0]
    header = json.loads(whole[8 : 8 + size])
    for offsets in ([0, 10**12], [5, 5], [-4, 4], [0, 3]):
        header["network.weights.0"]["data_offsets"] = offsets
        text = json.dumps(header).encode()
        path.write_bytes(struct.pack("<Q", len(text)) + text + whole[8 + size :])
        assert "is damaged" in refusal(path)
    path.write_bytes(whole + b"more")
    assert "is damaged" in refusal(path)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
@given(st.integers(0, 10**6), st.binary(min_size=1, max_size=9))
def test_garbled_bytes_are_one_clear_error_or_other_finite_numbers(path, make_policy, place, noise):
    make_policy().save(path)
    whole = bytearray(path.read_bytes())
    place %= len(whole)
    whole[place : place + len(noise)] = noise
    path.write_bytes(whole)
    try:
        policy = load_policy(path)
    except RledError as error:
        said = str(error)
        assert "\n" not in said
    else:
        assert np.isfinite(policy.scaling.observation_scale).all()
        assert np.isfinite(policy.network.vector()).all()


def test_what_is_no_file_is_refused(tmp_path):
    import os

    os.mkfifo(tmp_path / "pipe")  # nobody writes: whoever opened it would wait
    for path in (tmp_path / "pipe", tmp_path / "gone"):
        assert f"there is no {path}" in refusal(path)
    assert f"there is no policy in {tmp_path}" in refusal(tmp_path)


@pytest.mark.parametrize("state", [[], 3, None, "state", {"added": {}}])
def test_a_state_of_another_kind_is_refused(path, state):
    save_file({"a": torch.zeros(1)}, path, {"format": "rled-checkpoint", "version": "5", "state": json.dumps(state)})
    if isinstance(state, dict):
        assert read_checkpoint(path).state == state
    else:
        with pytest.raises(TensorFileError, match="its state is no object"):
            read_checkpoint(path)


def test_a_checkpoint_with_a_number_that_is_not_finite_is_refused(path):
    write_checkpoint(path, Checkpoint({"actor": torch.tensor([1.0, np.nan])}, {}))
    with pytest.raises(TensorFileError, match="holds NaN or infinity in actor"):
        read_checkpoint(path)


def test_a_network_is_refused_before_it_takes_memory():
    with pytest.raises(RledError, match=r"networks of 4 x 100000 x 100000 x 2 units; accepted: 33,554,432 weights"):
        Perceptron(4, 2, Architecture(hidden=(100_000, 100_000)), Draws([0]))


GATE = {"measure": "qcd", "threshold": 0.1, "passes": 30, "estimator": "dropout"}


@pytest.mark.parametrize(
    ("origin", "said"),
    [
        ({"method": 3, "gate": None}, "origin.method 3); accepted: a text"),
        ({"method": "td3"}, "origin has other fields"),
        ({"method": "td3", "gate": []}, "gate"),
        ({"method": "td3", "gate": GATE | {"threshold": -1}}, "threshold is -1); accepted: 0 to 1e+12"),
        ({"method": "td3", "gate": GATE | {"measure": 3}}, "measure 3); accepted: a text"),
        ({"method": "td3", "gate": GATE | {"passes": 10**9}}, "passes is 1000000000); accepted: 2 to 10000"),
        (
            {"method": "td3", "gate": GATE | {"estimator": "dice"}},
            "estimator 'dice'); accepted: dropout, actors, critics",
        ),
        ({"method": "td3", "gate": {"measure": "qcd"}}, "gate has other fields"),
    ],
)
def test_an_origin_that_cannot_be_is_refused_by_its_field(changed, origin, said):
    assert said in refusal(changed({"origin": json.dumps(origin)}))


@pytest.mark.parametrize(
    ("members", "said"),
    [
        (0, "members is 0); accepted: 1 to 100"),
        (10**9, "members is 1000000000); accepted: 1 to 100"),
        (True, "members True); accepted: a whole number"),
        (2, "holds (1, 4, 8) F32 as network.weights.0; accepted: (2, 4, 8) F32"),
    ],
)
def test_members_that_the_file_does_not_hold_are_refused(changed, make_policy, members, said):
    shape = {"architecture": asdict(make_policy().network.architecture), "members": members}
    assert said in refusal(changed({"networks": json.dumps({"network": shape})}))


def test_a_critic_that_the_file_does_not_hold_is_refused(changed, make_policy):
    shape = {"architecture": asdict(make_policy().network.architecture), "members": 1}
    said = refusal(changed({"networks": json.dumps({"network": shape, "critic": shape})}))
    assert "holds nothing as critic.weights.0; accepted: (1, 6, 8) F32" in said


@pytest.mark.parametrize("text", ["[]", "{}", "null", '{"config": []}', '{"config": {"env": "os:path"}}', "{", "\xff"])
def test_settings_beside_a_policy_are_refused_by_their_file(tmp_path, text):
    (tmp_path / "config.json").write_text(text)
    with pytest.raises(RledError) as caught:
        RunDirectory(tmp_path).settings(all_methods())
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)
