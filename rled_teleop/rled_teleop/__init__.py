"""TODO."""

