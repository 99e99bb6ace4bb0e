"""Where a person wants the target, and whether it may lie there."""

from collections.abc import Sequence

from rled_msgs_py.records import PoseSample
from rled_msgs_py.task import TaskDescription

from rled_sim.commands import Code, Refused
from rled_sim.motion_guard import depth
from rled_sim.plant import Point


def requested_target(request: PoseSample, task: TaskDescription, present: Point) -> Point:
    """The target (m) that a request asks for; coordinates that the task does not look at stay as they are.

    Args:
        request: its position counts, its stamp and orientation do not.
        task: with the workspace and the limits of the end effector.
        present: the target now (m).

    Raises:
        Refused: another frame, or a point where the end effector may not go.
    """
    if request.frame != task.frame:
        raise Refused(Code.TARGET, f"a target in frame '{request.frame}'", task.frame)
    asked = request.position.tolist()
    x, y, z = (asked[axis] if axis in task.axes else present[axis] for axis in range(3))
    limits = task.limits
    _require_inside([asked[axis] for axis in task.axes], task.workspace_lower, task.workspace_upper)
    if limits.tip_lower:
        _require_inside([x, y, z], limits.tip_lower, limits.tip_upper)
    for zone in limits.keep_out:
        if float(depth(zone, (x, y, z))) > 0.0:
            raise Refused(Code.TARGET, f"a target in a keep-out {zone.shape}", "one outside of it")
    return x, y, z


def _require_inside(point: Sequence[float], lower: Sequence[float], upper: Sequence[float]) -> None:
    if not all(low <= each <= high for low, each, high in zip(lower, point, upper, strict=True)):
        at = ", ".join(f"{each:.3f}" for each in point)
        raise Refused(Code.TARGET, f"a target at ({at}) m, outside the workspace", f"{list(lower)} to {list(upper)} m")
