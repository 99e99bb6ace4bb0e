"""Where the arrays of a batch live: in numpy, or in torch on a device."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError

Array = Any
"""A numpy array, or a tensor."""


class Arrays:
    """Makes arrays of numpy, or tensors on a device."""

    def __init__(self, device: str | None) -> None:
        """Choose numpy, or torch on a device such as ``cpu`` or ``cuda``, which is loaded only then.

        Raises:
            RledError: torch is not installed, or has no such device.
        """
        self._device = device
        if device is not None:
            _require_torch(device)

    @property
    def xp(self) -> Any:
        """The module whose functions take these arrays: numpy or torch; a module kept as an attribute is not copied."""
        if self._device is None:
            return np
        import torch

        return torch

    def array(self, values: Any, dtype: str = "float64") -> Array:
        """An array of values, which are not copied where they are one already.

        Raises:
            RledError: no numbers.
        """
        try:
            if self._device is None:
                return np.asarray(values, dtype=dtype)
            return self.xp.as_tensor(values, dtype=getattr(self.xp, dtype), device=self._device).detach()
        except (TypeError, ValueError, RuntimeError):
            raise RledError(f"{' '.join(repr(values).split())[:80]}", "numbers") from None

    def full(self, shape: tuple[int, ...], value: float, dtype: str = "float64") -> Array:
        """An array of one value."""
        return self.array(np.full(shape, value, dtype), dtype)

    def cast(self, array: Array, dtype: str) -> Array:
        """An array's values as another type; fractions are cut off."""
        return array.astype(dtype) if self._device is None else array.to(getattr(self.xp, dtype))

    def copied(self, array: Array) -> Array:
        """An array with the same values that shares nothing."""
        return array.copy() if self._device is None else array.clone()

    def copy_like(self, array: Array, values: Any, name: str) -> Array:
        """Values, copied into an array of the type of another.

        Raises:
            RledError: another shape, or no numbers; it has the name.
        """
        copy = self.copied(self.array(values, str(array.dtype).removeprefix("torch.")))
        if copy.shape != array.shape:
            raise RledError(f"{name} of shape {tuple(copy.shape)}", f"{tuple(array.shape)}")
        return copy

    def host(self, array: Array) -> NDArray[Any]:
        """The same values in numpy; waits for the device."""
        return np.asarray(array if self._device is None else array.cpu())

    def chosen(self, which: Array, there: Array, elsewhere: Array) -> Array:
        """The rows of one array where ``which`` holds, and of another elsewhere; either may be one number."""
        dimensions = max(getattr(each, "ndim", 0) for each in (there, elsewhere))
        return self.xp.where(which.reshape(*which.shape, *(1,) * (dimensions - which.ndim)), there, elsewhere)


def _require_torch(device: str) -> None:
    try:
        import torch
    except ImportError:
        raise RledError(
            f"device '{device}' without torch", "None, for numpy", "pip install 'rled_sim[torch]'"
        ) from None
    try:
        torch.zeros(1, dtype=torch.float64, device=device)
    except (RuntimeError, AssertionError, TypeError) as error:
        said = str(error).splitlines()[0]
        raise RledError(f"device '{device}': {said}", "None (numpy), cpu, or one that torch finds, as cuda") from None
