"""What learning has come to, as tensors and plain values by name, and back."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from rled_msgs_py.errors import RledError
from rled_msgs_py.validation import MAX_INT
from torch import Tensor

from rled_agent.methods.method import Learning
from rled_agent.nn.tensor_file import TensorFileError
from rled_agent.training.checkpoint import Checkpoint
from rled_agent.training.digests import file_digest


def pack(**parts: dict[str, Any]) -> Checkpoint:
    """The state of several parts; tensors share memory with them.

    Args:
        parts: state by name, of each part.
    """
    flat = {f"{part}.{name}": value for part, state in parts.items() for name, value in state.items()}
    tensors = {name: value for name, value in flat.items() if isinstance(value, Tensor)}
    return Checkpoint(tensors, {name: value for name, value in flat.items() if name not in tensors})


def part_of(checkpoint: Checkpoint, part: str, may_lack: bool = False) -> dict[str, Any]:
    """The state of one part.

    Raises:
        KeyError: there is none, and it may not lack.
    """
    flat: dict[str, Any] = checkpoint.tensors | checkpoint.state
    state = {name.removeprefix(f"{part}."): each for name, each in flat.items() if name.startswith(f"{part}.")}
    if not state and not may_lack:
        raise KeyError(part)
    return state


def seed_of(checkpoint: Checkpoint, seed: int, seeds: int) -> Checkpoint:
    """The state of one seed of a population: its part of each tensor, and the plain values of all."""
    tensors = {name: each.tensor_split(seeds)[seed] for name, each in checkpoint.tensors.items()}
    return Checkpoint(tensors, checkpoint.state)


def together(checkpoints: Sequence[Checkpoint]) -> Checkpoint:
    """The state of a population of those of its seeds.

    Raises:
        TensorFileError: plain values differ, as the step does.
    """
    first, *others = checkpoints
    for each in others:
        if each.state != first.state:
            names = first.state | each.state
            name = next(name for name in names if each.state.get(name, each) != first.state.get(name, first))
            raise TensorFileError(f"the checkpoints differ in {name}", "those of one step", "go on with each alone")
    tensors = {name: torch.cat([each.tensors[name] for each in checkpoints]) for name in first.tensors}
    return Checkpoint(tensors, first.state)


def learning_state(learning: Learning) -> dict[str, dict[str, Any]]:
    """Of learner, replay and batches, to be packed."""
    batches = {} if learning.batches is learning.replay else learning.batches.state_dict()
    return {"learner": learning.learner.state_dict(), "replay": learning.replay.state_dict(), "batches": batches}


def restore_learning(checkpoint: Checkpoint, learning: Learning) -> None:
    """Go on from a checkpoint's ``learning_state``.

    Raises:
        KeyError, TypeError, ValueError, RuntimeError, RledError: it is not as it was written.
    """
    replay, learner = part_of(checkpoint, "replay"), part_of(checkpoint, "learner")
    for name in ("updates", "actor_updates"):
        learner[name] = whole_number(learner, name)
    if "added" in replay:
        replay["added"] = whole_number(replay, "added")
    learning.replay.load_state_dict(replay)
    learning.learner.load_state_dict(learner)
    if learning.batches is not learning.replay:
        learning.batches.load_state_dict(part_of(checkpoint, "batches", may_lack=True))


def require_layout(state: Mapping[str, Any], own: Mapping[str, Tensor], what: str) -> None:
    """Refuse a state whose tensors are not those that are there.

    Raises:
        TensorFileError: names or shapes are others.
    """
    found, wanted = (
        {name: tuple(getattr(each, "shape", ("no tensor",))) for name, each in tensors.items()}
        for tensors in (state, own)
    )
    if found != wanted:
        raise TensorFileError(f"the checkpoint has {found} as {what}", str(wanted), "begin again without it")


def whole_number(state: dict[str, Any], name: str) -> int:
    """A count of a state.

    Raises:
        TensorFileError: it is none.
    """
    value = state[name]
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < MAX_INT:
        raise TensorFileError(f"the checkpoint says {str(value)[:40]} as {name}", "a whole number, 0 or more")
    return value


@contextmanager
def restoring(what: str) -> Iterator[None]:
    """Make one error of whatever a state that is not as it was written leads to.

    Raises:
        TensorFileError: names what is missing or of another kind.
    """
    try:
        yield
    except TensorFileError:
        raise
    except RledError as error:
        raise TensorFileError(f"{what}: {error.what}", error.accepted, "begin again without it") from None
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError, RuntimeError) as error:
        why = f"no {error}" if isinstance(error, KeyError) else " ".join(str(error).split())[:200]
        raise TensorFileError(f"{what} is not as it was written ({why})", "", "begin again without it") from None


def origin_of(policy: Path) -> dict[str, str]:
    """What a learning state keeps of the policy that it begins with.

    Raises:
        RledError: the policy cannot be read.
    """
    return {"policy": str(policy), "policy_sha256": file_digest(policy)}


def require_origin(state: dict[str, Any], path: Path, policy: Path) -> None:
    """Refuse what another policy has learned; the same policy in another place is the same.

    Args:
        state: of the learning state.
        path: where it lies.
        policy: to go on with.

    Raises:
        TensorFileError: says with which one it began.
    """
    if state.get("origin.policy_sha256") != origin_of(policy)["policy_sha256"]:
        what = f"{path} holds what another policy than {policy} has learned"
        began = shlex.quote(str(state.get("origin.policy", "POLICY"))[:200])
        remedy = f"go on with --agent {began}, or name another --learning-state"
        raise TensorFileError(what, "the state of this policy", remedy)
