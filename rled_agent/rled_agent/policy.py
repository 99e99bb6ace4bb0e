"""A policy in physical units: a network with its scaling and task, and the file that keeps the three."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.errors import ContractError
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.untrusted import read_json
from rled_msgs_py.validation import check_fields, from_object

from rled_agent.checkpoint import CheckpointError, Layout, TensorFile, damaged, open_tensors, write_tensors
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.perceptron import Perceptron, parameter_shapes
from rled_agent.nn.scaling import Scaling
from rled_agent.uncertainty import GateSettings

FORMAT = "rled-policy"
VERSION = 2
FILES = ("policy.safetensors", "expert.safetensors")
"""What trainings call the policy in their folder."""
SCALING = ("observation_center", "observation_scale", "action_center", "action_scale")


@dataclass(frozen=True, eq=False)
class Policy:
    """A deterministic policy a = π(x) in physical units.

    Attributes:
        network: normalised observation to normalised action.
        scaling: physical to normalised.
        task: what it was trained for.
        gate: what the Monte-Carlo gate that it learned behind compared; None for one that learned without.
    """

    network: Perceptron
    scaling: Scaling
    task: TaskDescription
    gate: GateSettings | None = None

    def act(self, observation: NDArray[np.floating]) -> NDArray[np.float64]:
        """Action (rad), shape (..., n), of an observation, shape (..., o)."""
        rows = self.scaling.normalize_observation(observation).reshape(-1, observation.shape[-1])
        with torch.inference_mode():
            action = self.network(torch.from_numpy(rows))[0].numpy()
        return self.scaling.denormalize_action(action.reshape(*observation.shape[:-1], -1))

    def save(self, path: Path) -> None:
        """Write weights and scaling as safetensors, architecture, task and gate in its header.

        Raises:
            CheckpointError: the disk is full or can't be written.
        """
        tensors = {f"network.{name}": tensor for name, tensor in self.network.state_dict().items()}
        tensors |= {name: torch.from_numpy(np.array(getattr(self.scaling, name))) for name in SCALING}
        header = {
            "format": FORMAT,
            "version": str(VERSION),
            "architecture": json.dumps(asdict(self.network.architecture)),
            "task": self.task.to_json(),
            "gate": json.dumps(asdict(self.gate) if self.gate is not None else None),
        }
        write_tensors(path, tensors, header)


def policy_file(path: Path) -> Path:
    """The policy at a path: the file itself, or the one in the folder of a training.

    Raises:
        CheckpointError: a folder that holds none.
    """
    if not path.is_dir():
        return path
    found = [path / name for name in FILES if (path / name).is_file()]
    if not found:
        raise CheckpointError(f"there is no policy in {path}", " or ".join(FILES))
    return found[0]


def load_policy(path: Path) -> Policy:
    """Read a policy that ``Policy.save`` wrote, from its file or from the folder of a training.

    From wherever it comes, it costs no more than its file explains.

    Raises:
        CheckpointError: missing, damaged, of another program or version, of other shapes, or with numbers that are
            not finite or so large that no action comes of them.
    """
    path = policy_file(path)
    with open_tensors(path, FORMAT, VERSION) as file:
        task, architecture, gate = _described(file)
        sizes = len(task.observation_bounds()[0]), task.action_size
        layouts = {f"network.{name}": Layout(shape) for name, shape in parameter_shapes(*sizes, architecture).items()}
        for name, size in zip(SCALING, (sizes[0], sizes[0], sizes[1], sizes[1]), strict=True):
            layouts[name] = Layout((size,), "F64")
        tensors = file.read(layouts)
    for name in SCALING[1::2]:
        if not (tensors[name] > 0.0).all():
            raise CheckpointError(f"{path} holds 0 or less in {name}", "more than 0", "make it again")
    network = Perceptron(*sizes, architecture, torch.Generator(), squash=True)
    for name, parameter in network.state_dict().items():
        parameter.copy_(tensors[f"network.{name}"])
    policy = Policy(network, Scaling(*(tensors[name].numpy() for name in SCALING)), task, gate)
    low, high = task.observation_bounds()
    if not np.isfinite(policy.act(np.stack([low, (low + high) / 2.0, high]))).all():
        raise CheckpointError(f"{path} makes no action of a state: its numbers are too large", "", "make it again")
    return policy


class _Description(NamedTuple):
    task: TaskDescription
    architecture: Architecture
    gate: GateSettings | None


def _described(file: TensorFile) -> _Description:
    """What the header says."""
    try:
        architecture = from_object(Architecture, read_json(file.header["architecture"], "architecture"), "architecture")
        check_fields(architecture, "architecture.")
        gate = read_json(file.header.get("gate", "null"), "gate")
        task = TaskDescription.from_json(file.header["task"])
        return _Description(task, architecture, None if gate is None else from_object(GateSettings, gate, "gate"))
    except KeyError as error:
        raise damaged(file.path, FORMAT, f"header: no {error}") from None
    except ContractError as error:
        what = f"{file.path} is damaged (header: {error.what})"
        raise CheckpointError(what, error.accepted, "use a file that this version wrote") from None
