"""A policy in physical units: a network with its scaling and task, and the file that keeps the three."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.task import TaskDescription

from rled_agent.architecture import Architecture
from rled_agent.checkpoint import CheckpointError, damaged, read_tensors, write_tensors
from rled_agent.networks import Network
from rled_agent.scaling import Scaling

FORMAT = "rled-policy"
VERSION = 1
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
    """

    network: Network
    scaling: Scaling
    task: TaskDescription

    def act(self, observation: NDArray[np.floating]) -> NDArray[np.float64]:
        """Action (rad), shape (..., n), of an observation, shape (..., o)."""
        rows = self.scaling.normalize_observation(observation).reshape(-1, observation.shape[-1])
        action = self.network.forward(torch.from_numpy(rows))[0].numpy()
        return self.scaling.denormalize_action(action.reshape(*observation.shape[:-1], -1))

    def save(self, path: Path) -> None:
        """Write weights and scaling as safetensors, architecture and task in its header.

        Raises:
            CheckpointError: the disk is full or can't be written.
        """
        tensors = {f"network.{name}": tensor for name, tensor in self.network.named_parameters().items()}
        tensors |= {name: torch.from_numpy(np.array(getattr(self.scaling, name))) for name in SCALING}
        header = {
            "format": FORMAT,
            "version": str(VERSION),
            "architecture": json.dumps(asdict(self.network.architecture)),
            "task": self.task.to_json(),
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

    Raises:
        CheckpointError: missing, damaged, of another program or version, or of other shapes.
    """
    path = policy_file(path)
    header, tensors = read_tensors(path, FORMAT, VERSION)
    try:
        description, saved = header["task"], json.loads(header["architecture"])
        architecture = Architecture(**saved | {"hidden": tuple(saved["hidden"])})
    except (KeyError, TypeError, ValueError) as error:
        raise damaged(path, FORMAT, f"header: {error}") from None
    task = TaskDescription.from_json(description)
    sizes = len(task.observation_bounds()[0]), task.action_size
    network = Network(*sizes, architecture, torch.Generator(), squash=True)
    for name, parameter in network.named_parameters().items():
        parameter.copy_(_tensor(tensors, f"network.{name}", parameter.shape, path))
    shapes = (sizes[0], sizes[0], sizes[1], sizes[1])
    scaling = (_tensor(tensors, name, (shape,), path).numpy() for name, shape in zip(SCALING, shapes, strict=True))
    return Policy(network, Scaling(*scaling), task)


def _tensor(tensors: dict[str, torch.Tensor], name: str, shape: tuple[int, ...], path: Path) -> torch.Tensor:
    found = tuple(tensors[name].shape) if name in tensors else "nothing"
    if found != tuple(shape):
        raise CheckpointError(
            f"{path} holds {found} as {name}", str(tuple(shape)), "use weights of this robot and task"
        )
    return tensors[name]
