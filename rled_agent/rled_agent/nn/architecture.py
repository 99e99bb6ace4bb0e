"""The shape of a network."""

from dataclasses import dataclass
from typing import Annotated, Literal

from rled_msgs_py.validation import Length, Range

Activation = Literal["relu", "leaky_relu"]
Weights = Literal["fan_in", "glorot"]
MAX_WIDTH, MAX_LAYERS, MAX_WEIGHTS = 100_000, 32, 2**25
"""Of a network; so many weights are 128 MiB, and a learner holds some twenty times as much."""
SLOPE: dict[Activation, float] = {"relu": 0.0, "leaky_relu": 0.01}


@dataclass(frozen=True)
class Architecture:
    """The hidden part of a network.

    Attributes:
        hidden: widths of the hidden layers.
        activation: after each hidden layer.
        dropout: probability that a hidden unit is dropped, where dropout is asked for.
        layer_norm: normalise each hidden layer, without gain and shift, before its activation.
        weights: how they are drawn, uniformly: fan_in, with the biases, in ±1/√fan-in (PyTorch's way); glorot, in
            ±√(6/(fan-in + fan-out)), with biases of zero (Glorot and Bengio, 2010; TensorFlow's way).
    """

    hidden: Annotated[tuple[int, ...], Range(1, MAX_WIDTH), Length(MAX_LAYERS)] = (400, 300)
    activation: Activation = "relu"
    dropout: Annotated[float, Range(0, 0.95)] = 0.0
    layer_norm: bool = False
    weights: Weights = "fan_in"
