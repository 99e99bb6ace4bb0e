"""What RViz and Foxglove draw: the target curve, the start, the target, the path travelled."""

from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any

from geometry_msgs.msg import Point, Vector3
from rclpy.time import Time
from rled_msgs_py.tick import Tick
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

CURVE = (0.45, 0.45, 0.5, 0.8)
START = (0.15, 0.6, 0.3, 1.0)
TARGET = (0.85, 0.1, 0.1, 1.0)
TRAIL = (0.1, 0.35, 0.85, 1.0)
MAX_POINTS = 500
"""Points of the trail, and of the curve."""


class MarkerView:
    """The path of the robot so far, to be drawn now and then."""

    def __init__(self, curve: Sequence[Sequence[float]]) -> None:
        """Begin with nothing but the curve of targets (m), closed."""
        self._curve = [_point(each) for each in [*curve[:: len(curve) // MAX_POINTS + 1], curve[0]]]
        self._trail: deque[Any] = deque(maxlen=MAX_POINTS)
        self._tick: Tick | None = None
        self._start: list[float] = []
        self._target: list[float] = []

    def add(self, tick: Tick) -> None:
        """Follow the robot by a tick; a new target makes a new start, a new episode a new trail."""
        if self._tick is None or tick.status.episode != self._tick.status.episode:
            self._trail.clear()
            self._target = []
        position, target = tick.ee.position.tolist(), tick.target.position.tolist()
        if target != self._target:
            self._start, self._target = position, target
        self._trail.append(_point(position))
        self._tick = tick

    def message(self) -> Any:
        """visualization_msgs/MarkerArray of the newest tick."""
        assert self._tick is not None
        header = Header(stamp=Time(nanoseconds=self._tick.stamp).to_msg(), frame_id=self._tick.target.frame)
        return MarkerArray(
            markers=[
                _line(header, "curve", CURVE, 0.004, self._curve),
                _line(header, "trail", TRAIL, 0.006, self._trail),
                _ball(header, "start", START, self._start),
                _ball(header, "target", TARGET, self._target),
            ]
        )


def _line(header: Any, name: str, colour: Sequence[float], width: float, points: Iterable[Any]) -> Any:
    marker = _marker(header, name, Marker.LINE_STRIP, colour, Vector3(x=width))
    marker.points = list(points)
    return marker


def _ball(header: Any, name: str, colour: Sequence[float], centre: Sequence[float]) -> Any:
    marker = _marker(header, name, Marker.SPHERE, colour, Vector3(x=0.04, y=0.04, z=0.04))
    marker.pose.position = _point(centre)
    return marker


def _marker(header: Any, name: str, kind: int, colour: Sequence[float], scale: Any) -> Any:
    red, green, blue, alpha = colour
    marker = Marker(header=header, ns=name, type=kind, action=Marker.ADD, scale=scale)
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=alpha)
    marker.pose.orientation.w = 1.0
    return marker


def _point(position: Sequence[float]) -> Any:
    x, y, z = position
    return Point(x=x, y=y, z=z)
