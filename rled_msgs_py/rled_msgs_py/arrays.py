"""Which library an array belongs to, so that the same few lines work on numpy arrays and on torch tensors."""

import sys
from typing import Any

import numpy as np


def namespace(array: Any) -> Any:
    """The module whose functions take this array: torch, which is not imported here, for its tensors; else numpy."""
    torch = sys.modules.get("torch")
    return torch if torch is not None and isinstance(array, torch.Tensor) else np
