"""Operators that demonstrate over topics, and the recorder."""

__version__ = "0.1.0"
