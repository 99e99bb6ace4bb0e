"""A policy in physical units: a network with its scaling and task, and the file that keeps them."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.errors import ContractError
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.untrusted import read_json
from rled_msgs_py.validation import Range, check_fields, from_object

from rled_agent.bounds import Amount
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron, parameter_shapes
from rled_agent.nn.scaling import Scaling
from rled_agent.nn.tensor_file import Layout, TensorFile, TensorFileError, damaged, open_tensors, write_tensors

R = TypeVar("R")
FORMAT = "rled-policy"
VERSION = 3
FILES = ("policy.safetensors", "expert.safetensors")
"""What trainings call the policy in their folder."""
SCALING = ("observation_center", "observation_scale", "action_center", "action_scale")
MAX_MEMBERS = 100
Estimator = Literal["dropout", "actors", "critics"]
Passes = Annotated[int, Range(2, 10_000)]


@dataclass(frozen=True)
class GateSettings:
    """What Eq. 4.40 compares; a policy that learned behind the gate carries them.

    Attributes:
        measure: u_t.
        threshold: ξ; at this uncertainty or more the expert acts.
        passes: N, of an actor that drops units.
        estimator: what u_t comes from.
    """

    measure: str = "qcd"
    threshold: Amount = 1e-3
    passes: Passes = 30
    estimator: Estimator = "dropout"

    def __post_init__(self) -> None:
        check_fields(self)

    def __str__(self) -> str:
        return f"{self.measure}, threshold {self.threshold:g}, {self.passes} passes"


@dataclass(frozen=True)
class Origin:
    """How a policy was made.

    Attributes:
        method: its name.
        gate: what the gate compared that it learned behind; None for one that learned without.
    """

    method: str = "cloning"
    gate: GateSettings | None = None


@dataclass(frozen=True, eq=False)
class Policy:
    """A deterministic policy a = π(x) in physical units.

    Attributes:
        network: normalised observation to normalised action; the mean of its members acts.
        scaling: physical to normalised.
        task: what it was trained for.
        origin: how it was made.
        critic: Q of normalised observation and action, for a gate that asks it.
    """

    network: Perceptron
    scaling: Scaling
    task: TaskDescription
    origin: Origin = Origin()
    critic: Perceptron | None = None

    def act(self, observation: NDArray[np.floating]) -> NDArray[np.float64]:
        """Action (rad), shape (..., n), of an observation, shape (..., o)."""
        rows = self.scaling.normalize_observation(observation).reshape(-1, observation.shape[-1])
        with torch.inference_mode():
            members = self.network(torch.from_numpy(rows))
            action = (members[0] if self.network.ensemble == 1 else members.mean(dim=0)).cpu().numpy()
        return self.scaling.denormalize_action(action.reshape(*observation.shape[:-1], -1))

    def save(self, path: Path) -> None:
        """Write weights and scaling as safetensors, the rest in its header.

        Raises:
            TensorFileError: the disk is full or can't be written.
        """
        networks = {"network": self.network} | ({} if self.critic is None else {"critic": self.critic})
        tensors = {
            f"{part}.{name}": tensor for part, each in networks.items() for name, tensor in each.state_dict().items()
        }
        tensors |= {name: torch.from_numpy(np.array(getattr(self.scaling, name))) for name in SCALING}
        shapes = {part: asdict(Shape(each.architecture, each.ensemble)) for part, each in networks.items()}
        header = {
            "format": FORMAT,
            "version": str(VERSION),
            "networks": json.dumps(shapes),
            "task": self.task.to_json(),
            "origin": json.dumps(asdict(self.origin)),
        }
        write_tensors(path, tensors, header)


@dataclass(frozen=True)
class Shape:
    """Of a network, as the header has it."""

    architecture: Architecture
    members: Annotated[int, Range(1, MAX_MEMBERS)]


def policy_file(path: Path) -> Path:
    """The policy at a path: the file itself, or the one in the folder of a training.

    Raises:
        TensorFileError: a folder that holds none.
    """
    if not path.is_dir():
        return path
    found = [path / name for name in FILES if (path / name).is_file()]
    if not found:
        raise TensorFileError(f"there is no policy in {path}", " or ".join(FILES))
    return found[0]


def load_policy(path: str | Path) -> Policy:
    """Read a policy that ``Policy.save`` wrote, from its file or from the folder of a training.

    From wherever it comes, it costs no more than its file explains.

    Raises:
        TensorFileError: missing, damaged, of another program or version, of other shapes, or with numbers that are
            not finite or so large that no action comes of them.
    """
    path = policy_file(Path(path))
    with open_tensors(path, FORMAT, VERSION) as file:
        described = _described(file)
        task, sizes = described.task, _sizes(described.task)
        layouts = {
            f"{part}.{name}": Layout(size)
            for part, shape in described.shapes.items()
            for name, size in parameter_shapes(*sizes[part], shape.architecture, shape.members).items()
        }
        o, n = sizes["network"]
        for name, width in zip(SCALING, (o, o, n, n), strict=True):
            layouts[name] = Layout((width,), "F64")
        tensors = file.read(layouts)
    for name in SCALING[1::2]:
        if not (tensors[name] > 0.0).all():
            raise TensorFileError(f"{path} holds 0 or less in {name}", "more than 0", "make it again")
    networks = {}
    for part, shape in described.shapes.items():
        squash = part == "network"
        network = Perceptron(*sizes[part], shape.architecture, Draws([0]), ensemble=shape.members, squash=squash)
        for name, parameter in network.state_dict().items():
            parameter.copy_(tensors[f"{part}.{name}"])
        networks[part] = network
    scaling = Scaling(*(tensors[name].numpy() for name in SCALING))
    policy = Policy(networks["network"], scaling, task, described.origin, networks.get("critic"))
    low, high = task.observation_bounds()
    if not np.isfinite(policy.act(np.stack([low, (low + high) / 2.0, high]))).all():
        raise TensorFileError(f"{path} makes no action of a state: its numbers are too large", "", "make it again")
    return policy


class _Description(NamedTuple):
    task: TaskDescription
    shapes: dict[str, Shape]
    origin: Origin


def _sizes(task: TaskDescription) -> dict[str, tuple[int, int]]:
    """Inputs and outputs of each network."""
    o, n = len(task.observation_bounds()[0]), task.action_size
    return {"network": (o, n), "critic": (o + n, 1)}


def _described(file: TensorFile) -> _Description:
    """What the header says."""
    try:
        named = read_json(file.header["networks"], "networks")
        if not isinstance(named, dict) or "network" not in named or not set(named) <= {"network", "critic"}:
            raise ContractError("networks of other names", "network, and critic if there is one")
        shapes = {part: _read(Shape, values, part) for part, values in named.items()}
        origin = _read(Origin, read_json(file.header["origin"], "origin"), "origin")
        return _Description(TaskDescription.from_json(file.header["task"]), shapes, origin)
    except KeyError as error:
        raise damaged(file.path, FORMAT, f"header: no {error}") from None
    except ContractError as error:
        what = f"{file.path} is damaged (header: {error.what})"
        raise TensorFileError(what, error.accepted, "use a file that this version wrote") from None


def _read(kind: type[R], values: Any, what: str) -> R:
    record = from_object(kind, values, what)
    check_fields(record, f"{what}.")
    return record
