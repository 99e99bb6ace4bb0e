"""The robot of a URDF text, as shapes on links that turn."""

import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_sim.published_urdf import mesh_path
from rled_sim.robots import ROBOTS

Floats = NDArray[np.float64]
Colour = tuple[int, int, int]

GREY: Colour = (176, 182, 190)
ALMOST_WHITE = 250
"""Colours without a value below this are toned down: they would outshine their own shading."""


class Shape(NamedTuple):
    """A mesh of one colour.

    Attributes:
        vertices: in the frame of its link (m), shape (k, 3).
        faces: indices of vertices, shape (f, 3).
        colour: 0 to 255.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]
    colour: Colour


class Link(NamedTuple):
    """A link, with the joint that carries it.

    Attributes:
        path: names of the links from the root to here.
        joint: that moves it against its parent; empty for a fixed one.
        origin: its pose in its parent's frame when the joint is at 0, shape (4, 4).
        axis: of the joint, in its own frame, shape (3,).
        prismatic: the joint slides and does not turn.
        shapes: what is seen of it.
    """

    path: tuple[str, ...]
    joint: str
    origin: Floats
    axis: Floats
    prismatic: bool
    shapes: tuple[Shape, ...]


@dataclass(frozen=True)
class RobotModel:
    """All links, parents first.

    Attributes:
        links: of the robot.
        missing: meshes that were not found.
    """

    links: tuple[Link, ...]
    missing: tuple[str, ...]


@lru_cache(2)
def load_robot(description: str) -> RobotModel:
    """Read a URDF text with the meshes that it names; read before, it is at hand.

    Raises:
        ValueError: it is no URDF, or one that cannot be drawn.
    """
    import yourdfpy  # a second, only for whoever shows a robot

    missing = set[str]()

    def find(fname: str) -> str:
        found = mesh_path(fname, [robot.urdf.parent for robot in ROBOTS.values()])
        if not found.is_file():
            missing.add(fname)
        return str(found)

    try:
        urdf = yourdfpy.URDF.load(
            io.BytesIO(description.encode()),
            filename_handler=find,
            build_collision_scene_graph=False,
            load_collision_meshes=False,
        )
        links = tuple(_links(urdf))
    except Exception as error:  # yourdfpy raises whatever a broken text leads it to
        raise ValueError(f"the robot description cannot be drawn ({type(error).__name__}: {error})") from error
    return RobotModel(links, tuple(sorted(missing)))


def _links(urdf: Any) -> Iterator[Link]:
    shapes = _shapes(urdf.scene)
    base: str = urdf.base_link
    yield Link((base,), "", np.eye(4), np.zeros(3), False, shapes.get(base, ()))
    paths: dict[str, tuple[str, ...]] = {base: (base,)}
    waiting = list(urdf.robot.joints)
    while waiting:
        ready = [joint for joint in waiting if joint.parent in paths]
        if not ready:
            return
        for joint in ready:
            waiting.remove(joint)
            paths[joint.child] = (*paths[joint.parent], joint.child)
            yield _link(joint, paths[joint.child], shapes.get(joint.child, ()))


def _link(joint: Any, path: tuple[str, ...], shapes: tuple[Shape, ...]) -> Link:
    moves = joint.type in ("revolute", "continuous", "prismatic")
    origin = np.eye(4) if joint.origin is None else np.asarray(joint.origin, dtype=np.float64)
    axis = np.asarray(joint.axis if joint.axis is not None else (1.0, 0.0, 0.0), dtype=np.float64)
    return Link(path, joint.name if moves else "", origin, axis, joint.type == "prismatic", shapes)


def _shapes(scene: Any) -> dict[str, tuple[Shape, ...]]:
    """The meshes of each link by its name, those of one colour put together."""
    parts: dict[str, dict[Colour, list[tuple[Any, Any]]]] = {}
    for name in scene.graph.nodes_geometry:
        geometry = scene.graph[name][1]
        mesh, link = scene.geometry[geometry], scene.graph.transforms.parents[name]
        pose = scene.graph.get(name, link)[0]
        vertices = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
        parts.setdefault(link, {}).setdefault(_colour(mesh.visual), []).append((vertices, mesh.faces))
    return {link: tuple(_joined(colour, meshes) for colour, meshes in by.items()) for link, by in parts.items()}


def _joined(colour: Colour, meshes: list[tuple[Any, Any]]) -> Shape:
    offsets = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])[:-1]
    vertices = np.concatenate([vertices for vertices, _ in meshes]).astype(np.float32)
    faces = np.concatenate([faces + offset for (_, faces), offset in zip(meshes, offsets, strict=True)])
    return Shape(vertices, faces.astype(np.uint32), colour)


def _colour(visual: Any) -> Colour:
    material = getattr(visual, "material", None)
    given = getattr(material, "main_color", None) if material is not None else getattr(visual, "main_color", None)
    if given is None:
        return GREY
    red, green, blue = (int(each) for each in given[:3])
    return (red, green, blue) if min(red, green, blue) < ALMOST_WHITE else (236, 238, 241)


def pose_of(link: Link, angles: Mapping[str, float]) -> tuple[Floats, Floats]:
    """Position (m) and orientation (w, x, y, z) of a link in its parent's frame, shapes (3,) and (4,).

    Args:
        link: which.
        angles: of the joints by name (rad or m); 0 for those that are not there.
    """
    value = angles.get(link.joint, 0.0)
    if link.prismatic:
        return link.origin[:3, 3] + link.origin[:3, :3] @ (value * link.axis), quaternion(link.origin[:3, :3])
    half = value / 2.0
    turn = np.array([np.cos(half), *(np.sin(half) * link.axis / max(float(np.linalg.norm(link.axis)), 1e-12))])
    return link.origin[:3, 3], product(quaternion(link.origin[:3, :3]), turn)


def quaternion(rotation: Floats) -> Floats:
    """(w, x, y, z) of a rotation matrix: the eigenvector of Bar-Itzhack's symmetric matrix, shape (4,)."""
    m = rotation
    k = np.array(
        [
            [m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [0.0, m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [0.0, 0.0, m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1]],
            [0.0, 0.0, 0.0, m[2, 2] - m[0, 0] - m[1, 1]],
        ]
    )
    vector: Floats = np.linalg.eigh(k, UPLO="U")[1][:, -1]
    return vector if vector[0] >= 0.0 else -vector


def product(left: Floats, right: Floats) -> Floats:
    """Product of two quaternions (w, x, y, z), shape (4,)."""
    w, v, s, u = left[0], left[1:], right[0], right[1:]
    return np.array([w * s - v @ u, *(w * u + s * v + np.cross(v, u))])
