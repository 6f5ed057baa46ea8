"""A tilted thin lens traced exactly, from its axis, focal length and sensor: no formula of focusjax's in it.

Axes X right, Y up, Z forward along the sensor's normal, metres; the lens centre is the origin and the
sensor is the plane Z = -s. At the lens a ray's slopes against the axis change by -h / F, with h the height of
its crossing.
"""

import dataclasses

import numpy as np


@dataclasses.dataclass(frozen=True)
class TracedLens:
    """A thin lens of focal length `length` whose unit axis is `axis` [3], a sensor at `sensor` metres."""

    axis: np.ndarray
    length: float
    sensor: float

    def opening(self, radius: float, count: int = 12) -> np.ndarray:
        """Points [n, 3] on the rim of the opening, at half its radius, and its middle, the lens centre."""
        first = np.cross(self.axis, [0.3, 0.9, 0.1])
        first /= np.linalg.norm(first)
        second = np.cross(self.axis, first)
        angle = 2 * np.pi * (np.arange(count) + 0.2) / count
        rim = radius * (np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second)
        return np.concatenate([rim, rim / 2, np.zeros((1, 3))])

    def bent(self, direction: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Directions [n, 3] behind the lens of rays that cross it at `at` [n, 3] with `direction` [n, 3]."""
        slope = direction / (direction @ self.axis)[:, None] - self.axis
        return self.axis + slope - at / self.length

    def from_film(self, tangents: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Directions [n, 3] in the scene of rays from the film point that looks along `tangents` [2]."""
        film = -self.sensor * np.append(tangents, 1.0)
        return self.bent(at - film, at)

    def onto_film(self, point: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Tangents [n, 2] of the film points where rays from the scene's `point` [3] land, by way of `at`."""
        # Light from the scene travels against the axis: the same law along -axis.
        mirrored = dataclasses.replace(self, axis=-self.axis)
        direction = mirrored.bent(at - point, at)
        film = at + direction * ((-self.sensor - at[:, 2]) / direction[:, 2])[:, None]
        return -film[:, :2] / self.sensor
