"""What learning has come to, learner and replay, as tensors and plain values, and back."""

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from rled_msgs_py.validation import MAX_INT
from torch import Tensor

from rled_agent.checkpoint import Checkpoint, CheckpointError
from rled_agent.digests import file_digest
from rled_agent.learners.td3 import Learner
from rled_agent.replay import Replay


def pack(learner: Learner, replay: Replay) -> Checkpoint:
    """All state of learner and replay; the tensors share memory with them."""
    tensors: dict[str, Tensor] = learner.tensors() | {
        "replay.rows": torch.from_numpy(replay.rows[: len(replay)]),
        "generator": learner.generator.get_state(),
    }
    return Checkpoint(tensors, {"updates": learner.updates, "added": replay.added})


def whole_number(state: dict[str, Any], name: str) -> int:
    """A count of a state.

    Raises:
        CheckpointError: it is none.
    """
    value = state[name]
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < MAX_INT:
        raise CheckpointError(f"the checkpoint says {str(value)[:40]} as {name}", "a whole number, 0 or more")
    return value


def unpack(checkpoint: Checkpoint, learner: Learner, replay: Replay) -> None:
    """Continue from a state that ``pack`` made.

    Raises:
        CheckpointError: of other networks or another environment.
    """
    with restoring("the checkpoint"):
        _unpack(checkpoint, learner, replay)


@contextmanager
def restoring(what: str) -> Iterator[None]:
    """Make one error of whatever a state that is not as it was written leads to.

    Raises:
        CheckpointError: names what is missing or of another kind.
    """
    try:
        yield
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError, RuntimeError) as error:
        why = f"no {error}" if isinstance(error, KeyError) else " ".join(str(error).split())[:200]
        raise CheckpointError(f"{what} is not as it was written ({why})", "", "begin again without it") from None


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
        CheckpointError: says with which one it began.
    """
    if state.get("policy_sha256") != origin_of(policy)["policy_sha256"]:
        what = f"{path} holds what another policy than {policy} has learned"
        began = shlex.quote(str(state.get("policy", "POLICY"))[:200])
        remedy = f"go on with --agent {began}, or name another --learning-state"
        raise CheckpointError(what, "the state of this policy", remedy)


def _unpack(checkpoint: Checkpoint, learner: Learner, replay: Replay) -> None:
    tensors, state = checkpoint
    for name, tensor in learner.tensors().items():
        if name not in tensors or tensors[name].shape != tensor.shape:
            found = tuple(tensors[name].shape) if name in tensors else "nothing"
            raise CheckpointError(f"the checkpoint holds {found} as {name}", str(tuple(tensor.shape)))
    rows = tensors["replay.rows"].numpy()
    added, updates = (whole_number(state, name) for name in ("added", "updates"))
    if rows.ndim != 2 or rows.shape[1] != replay.rows.shape[1] or len(rows) != min(added, replay.capacity):
        raise CheckpointError(f"the checkpoint holds transitions of shape {rows.shape}", str(replay.rows.shape))
    for name, tensor in learner.tensors().items():
        tensor.copy_(tensors[name])
    replay.rows[: len(rows)] = rows
    replay.added, learner.updates = added, updates
    learner.generator.set_state(tensors["generator"])
