"""The shape of a network."""

from dataclasses import dataclass
from typing import Literal

Activation = Literal["relu", "leaky_relu"]
Weights = Literal["fan_in", "glorot"]
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

    hidden: tuple[int, ...] = (400, 300)
    activation: Activation = "relu"
    dropout: float = 0.0
    layer_norm: bool = False
    weights: Weights = "fan_in"
