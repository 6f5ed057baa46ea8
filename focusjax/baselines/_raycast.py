"""Where rays first meet the triangles themselves, by Embree."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from focusjax.geometry import Camera, LensRay
from focusjax.scene import Scene


@dataclasses.dataclass(frozen=True)
class SurfaceHits:
    """First surfaces along rays.

    Attributes:
        triangle: index [n] into the scene's faces; -1 where nothing is hit.
        distance: position [n] along the ray in multiples of its direction vector; infinite where
            nothing is hit.
        barycentric: weights [n, 3] of the face's three vertices.
    """

    triangle: Int[np.ndarray, " n"]
    distance: Float[np.ndarray, " n"]
    barycentric: Float[np.ndarray, "n 3"]


class RayCaster:
    """Triangles made ready for ray casting; building takes seconds per million triangles.

    Args:
        vertices: world metres [v, 3].
        faces: vertex indices [t, 3].

    Raises:
        ValueError: Embree's Python binding is not installed.
    """

    def __init__(self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"]):
        try:
            from embreex.mesh_construction import TriangleMesh
            from embreex.rtcore_scene import EmbreeScene
        except ImportError as error:
            raise ValueError(
                "the ray-casting baseline needs Embree, which is not installed; run `pip install embreex`"
            ) from error
        self._corners = np.asarray(vertices, dtype=np.float64)[faces]
        # Embree computes in single precision: keep its coordinates small.
        self._centre = self._corners.mean(axis=(0, 1))
        self._scene = EmbreeScene()
        self._mesh = TriangleMesh(self._scene, (self._corners - self._centre).astype(np.float32))

    def first_hits(
        self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
    ) -> SurfaceHits:
        """The nearest surface, seen from either side, along each ray.

        Embree names the triangle; where it is met is solved again in double precision.

        Args:
            origins: world metres.
            directions: world vectors of any length.
        """
        found = self._scene.run(
            (origins - self._centre).astype(np.float32),
            directions.astype(np.float32),
            query="INTERSECT",
            output=1,
        )
        triangle = np.asarray(found["primID"]).astype(np.int64)
        hit = triangle >= 0
        distance = np.full(len(triangle), np.inf)
        barycentric = np.zeros((len(triangle), 3))
        distance[hit], barycentric[hit] = _meet(
            self._corners[triangle[hit]], origins[hit].astype(np.float64), directions[hit].astype(np.float64)
        )
        return SurfaceHits(np.where(hit, triangle, -1), distance, barycentric)


def nearest_in_scene(scene: Scene, camera: Camera) -> Callable[[LensRay], Float[np.ndarray, " n"]]:
    """Which surface lens rays of `camera` meet first, by casting them: the truth for `missed_light`.

    Triangles are solid here; holes that an opacity texture cuts are not known.

    Returns:
        a function from n rays to the disparities [n] in 1/m where they first meet a surface, 0 where none.

    Raises:
        ValueError: Embree is not installed, or some of the scene may be seen through.
    """
    if scene.may_be_seen_through() is not None:
        raise ValueError(
            "some of the scene may be seen through, and a ray cast takes holes for solid; compare with"
            " nearest_in_layers(peel(..., umbra=False)) instead"
        )
    caster = RayCaster(scene.vertices, scene.faces)

    def first_disparity(rays: LensRay) -> Float[np.ndarray, " n"]:
        lines = (np.asarray(part, dtype=np.float64) for part in (rays.a, rays.b))
        return 1.0 / caster.first_hits(*world_rays(camera, *lines)).distance

    return first_disparity


def world_rays(camera: Camera, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origins in the lens plane and directions, one metre deep, of image lines q(w) = a + b w.

    X(z) = X0 + m z with b = f (X0, -Y0) and a = c + f (m_x, -m_y); the camera looks along -z.
    """
    focal = float(camera.focal_px)
    centre = np.asarray(camera.principal_point, dtype=np.float64)
    pose = np.asarray(camera.world_from_camera, dtype=np.float64)
    down = np.array([1.0, -1.0])
    crossing, slope = b / focal * down, (a - centre) / focal * down
    origins = np.concatenate([crossing, np.zeros((len(a), 1))], axis=1)
    directions = np.concatenate([slope, np.full((len(a), 1), -1.0)], axis=1)
    return origins @ pose[:3, :3].T + pose[:3, 3], directions @ pose[:3, :3].T


def _meet(corners: np.ndarray, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance [n] and barycentric weights [n, 3] where rays meet the planes of `corners` [n, 3, 3].

    Möller and Trumbore 1997, without the test whether the point is inside: Embree made it.
    """
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(directions, second)
    volume = np.einsum("ni,ni->n", first, across)
    # A ray within the triangle's plane meets it nowhere in particular; any finite answer serves.
    volume = np.where(volume == 0.0, 1.0, volume)
    offset = origins - corners[:, 0]
    turned = np.cross(offset, first)
    u = np.clip(np.einsum("ni,ni->n", offset, across) / volume, 0.0, 1.0)
    v = np.clip(np.einsum("ni,ni->n", directions, turned) / volume, 0.0, 1.0 - u)
    return np.einsum("ni,ni->n", second, turned) / volume, np.stack([1.0 - u - v, u, v], axis=1)
