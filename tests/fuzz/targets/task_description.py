"""The description of a task, as JSON on a topic or in a bag."""

from contextlib import suppress
from pathlib import Path

import numpy as np
from rled_msgs_py.errors import ContractError
from rled_msgs_py.task import TaskDescription
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

from ...rled_msgs_py.samples import TASK
from ..mutators.values import json_text as mutate

__all__ = ["mutate", "read", "seeds"]


def seeds() -> list[bytes]:
    return [each.to_json().encode() for each in (TASK, *(reach_task(robot).description for robot in ROBOTS.values()))]


def read(data: bytes, _: Path) -> None:
    task = TaskDescription.from_json(data.decode(errors="replace"))
    again = TaskDescription.from_json(task.to_json())
    assert again == task, "another description after a way through JSON"
    low, high = task.observation_bounds()
    n = task.action_size
    found = task.observe(np.zeros(n), np.zeros(3), np.ones(3))
    assert low.shape == high.shape == found.shape
    with suppress(ContractError):
        TASK.require_same_robot(task, "the bag")
