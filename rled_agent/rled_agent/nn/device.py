"""Where tensors are."""

import torch
from rled_msgs_py.errors import RledError


def require_device(name: str) -> None:
    """Refuse a device that is not there.

    Raises:
        RledError: names those that are.
    """
    found = ["cpu", *(f"cuda:{k}" for k in range(torch.cuda.device_count()))]
    if name not in (*found, *(["cuda"] if len(found) > 1 else [])):
        raise RledError(f"device is '{name[:80]}'", ", ".join(found), "leave out --device, or install PyTorch for CUDA")
