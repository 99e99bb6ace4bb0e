"""What is drawn of a world: the target, and pictures of the whole."""

import numpy as np
import pybullet
from numpy.typing import NDArray

from rled_sim.bullet.client import Client
from rled_sim.plant import Point
from rled_sim.robots import Camera

PICTURE = (640, 480)
"""Width and height of a rendered picture."""
TARGET_RADIUS = 0.02
"""Of the ball that is drawn at the target (m)."""
TARGET_COLOUR = (0.85, 0.1, 0.1, 1.0)


class Scene:
    """Draws in one client."""

    def __init__(self, client: Client, camera: Camera) -> None:
        self._client, self._camera = client, camera
        self._target: int | None = None

    def show_target(self, position: Point) -> None:
        """Draw the target in pictures and in the window."""
        p, client = pybullet, self._client.number
        if self._target is None:
            ball = p.createVisualShape(
                p.GEOM_SPHERE, radius=TARGET_RADIUS, rgbaColor=TARGET_COLOUR, physicsClientId=client
            )
            self._target = p.createMultiBody(baseVisualShapeIndex=ball, physicsClientId=client)
        p.resetBasePositionAndOrientation(self._target, position, (0.0, 0.0, 0.0, 1.0), client)

    def picture(self) -> NDArray[np.uint8]:
        """What the camera sees, shape (480, 640, 3)."""
        p, camera, (width, height) = pybullet, self._camera, PICTURE
        view = p.computeViewMatrixFromYawPitchRoll(
            camera.target, camera.distance, camera.yaw, camera.pitch, 0, upAxisIndex=2
        )
        lens = p.computeProjectionMatrixFOV(50.0, width / height, 0.05, 10.0)
        image = p.getCameraImage(
            width, height, view, lens, renderer=p.ER_TINY_RENDERER, physicsClientId=self._client.number
        )
        return np.reshape(image[2], (height, width, 4))[..., :3].astype(np.uint8)
