"""What the tests of strategies share: two policies that always do the same, and a state that goes through a file."""

from pathlib import Path

import torch
from rled_agent.exploration.agent import Noise
from rled_agent.exploration.strategy import Choice, PolicyFunction, Strategy
from rled_agent.nn.draws import Draws
from rled_agent.training.checkpoint import read_checkpoint, write_checkpoint
from rled_agent.training.learning_state import pack, part_of
from torch import Tensor

STATE = torch.zeros(1, 4)
AGENT, EXPERT = torch.tensor([[0.5, -0.5]]), torch.tensor([[0.25, 0.75]])
YES, NO = torch.tensor([True]), torch.tensor([False])


def always(action: Tensor) -> PolicyFunction:
    return lambda _: action


def noise(std: float = 0.0, seed: int = 0) -> Noise:
    return Noise(std, Draws([seed]))


def actor(choice: Choice) -> str:
    """a of the agent, e of the expert."""
    return "e" if choice.by_expert.item() else "a"


def carry(one: Strategy, other: Strategy, folder: Path) -> None:
    """Bring the state of one strategy to another, by way of a checkpoint."""
    write_checkpoint(folder / "state", pack(strategy=one.state_dict()))
    other.load_state_dict(part_of(read_checkpoint(folder / "state"), "strategy", may_lack=True))
