"""Replay buffers: uniform, n-step, prioritised, and mixtures of them by share."""
