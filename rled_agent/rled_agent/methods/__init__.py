"""One file a method: its settings, the parts that it is composed of, and what its paper says.

A file in this folder that defines a subclass of ``Method`` is a method; its name is the file's.
"""

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache

from rled_agent.methods.method import Learning, Method, Problem

__all__ = ["Learning", "Method", "Problem", "all_methods"]


@cache
def all_methods() -> Mapping[str, type[Method]]:
    """All methods by name, in alphabetical order."""
    found: dict[str, type[Method]] = {}
    for each in pkgutil.iter_modules(__path__):
        module = importlib.import_module(f"{__name__}.{each.name}")
        own = [value for value in vars(module).values() if getattr(value, "__module__", "") == module.__name__]
        for value in own:
            if isinstance(value, type) and issubclass(value, Method) and value is not Method:
                found[each.name] = value
    return found
