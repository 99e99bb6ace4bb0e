"""The spaces of a task's observations and actions."""

import gymnasium
import numpy as np
from rled_msgs_py.task import TaskDescription


def observation_space(task: TaskDescription) -> gymnasium.spaces.Box:
    """What ``TaskDescription.observe`` gives inside the workspace and the joint limits, float32."""
    lower, upper = task.observation_bounds()
    return gymnasium.spaces.Box(lower.astype(np.float32), upper.astype(np.float32))


def action_space(task: TaskDescription) -> gymnasium.spaces.Box:
    """Joint displacements within ±Δq_max (rad), float32."""
    return gymnasium.spaces.Box(-task.max_delta, task.max_delta, (task.action_size,), np.float32)
