"""The contract of the RLED graph: topics, QoS, records with units, messages and bags."""

__version__ = "0.1.0"
