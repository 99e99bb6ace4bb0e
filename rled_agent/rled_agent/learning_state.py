"""What learning has come to, learner and replay, as tensors and plain values, and back."""

import torch
from torch import Tensor

from rled_agent.checkpoint import Checkpoint, CheckpointError
from rled_agent.learners.td3 import Learner
from rled_agent.replay import Replay


def pack(learner: Learner, replay: Replay) -> Checkpoint:
    """All state of learner and replay; the tensors share memory with them."""
    tensors: dict[str, Tensor] = learner.tensors() | {
        "replay.rows": torch.from_numpy(replay.rows[: len(replay)]),
        "generator": learner.generator.get_state(),
    }
    return Checkpoint(tensors, {"updates": learner.updates, "added": replay.added})


def unpack(checkpoint: Checkpoint, learner: Learner, replay: Replay) -> None:
    """Continue from a state that ``pack`` made.

    Raises:
        CheckpointError: of other networks or another environment.
    """
    tensors, state = checkpoint
    for name, tensor in learner.tensors().items():
        if name not in tensors or tensors[name].shape != tensor.shape:
            found = tuple(tensors[name].shape) if name in tensors else "nothing"
            raise CheckpointError(f"the checkpoint holds {found} as {name}", str(tuple(tensor.shape)))
    rows = tensors["replay.rows"].numpy()
    if rows.shape[1] != replay.rows.shape[1] or len(rows) > replay.capacity:
        raise CheckpointError(f"the checkpoint holds transitions of shape {rows.shape}", str(replay.rows.shape))
    for name, tensor in learner.tensors().items():
        tensor.copy_(tensors[name])
    replay.rows[: len(rows)] = rows
    replay.added, learner.updates = state["added"], state["updates"]
    learner.generator.set_state(tensors["generator"])
