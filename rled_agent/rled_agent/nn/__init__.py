"""Networks in plain PyTorch: perceptrons with a population dimension, dropout by generator, scaling."""
