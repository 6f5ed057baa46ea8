"""Objects that move and deform: what a scene is in each frame."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from focusjax.motion._keyframes import Keyframes, Turns, keyframes, turns
from focusjax.motion._sequence import VertexSequence
from focusjax.scene import Scene, SceneObject, placement
from focusjax.shutter import Body


@dataclasses.dataclass(frozen=True)
class Transforms:
    """Where an object stands over time: scaled, then rotated, then translated.

    Attributes:
        translate: world metres [3].
        rotate: rotations.
        scale: factors [3].
    """

    translate: Keyframes
    rotate: Turns
    scale: Keyframes

    def __call__(self, frame: float) -> Float[np.ndarray, "4 4"]:
        """The matrix world_from_object at a frame."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotate(frame) * self.scale(frame)
        matrix[:3, 3] = self.translate(frame)
        return matrix


def transforms(
    keys: Mapping[float, Mapping[str, Sequence[float] | float]], *, between: str = "smooth"
) -> Transforms:
    """Placements of an object by frame.

    Args:
        keys: at least one; each may have `translate`, `rotate` and `scale`, as `load_mesh` takes them; one
            that it lacks is as without a placement. Frames in ascending order.
        between: how the placement goes from one keyframe to the next; rotations take the shortest way.

    Raises:
        ValueError: as `keyframes` and `placement`; an unknown key; or a scale that changes its sign.

    Example:
        >>> rise = transforms({1: {"translate": (0, 0, 0)}, 25: {"translate": (0, 1, 0)}})
        >>> rise(13)[:3, 3].tolist()
        [0.0, 0.5, 0.0]
    """
    shifts, rotations, factors = {}, {}, {}
    for frame, key in keys.items():
        unknown = set(key) - {"translate", "rotate", "scale"}
        if unknown:
            raise ValueError(
                f"the keyframe at frame {frame:g} has {sorted(unknown)}; expected translate, rotate and scale"
            )
        shift, turn, factor = (
            key.get(name, plain)
            for name, plain in (("translate", (0.0,) * 3), ("rotate", (0.0,) * 3), ("scale", 1.0))
        )
        placement(shift, turn, factor)  # type: ignore[arg-type]
        shifts[frame] = shift
        rotations[frame] = placement((0.0,) * 3, turn, 1.0)[:3, :3]  # type: ignore[arg-type]
        factors[frame] = np.broadcast_to(np.asarray(factor, dtype=float), (3,))
    scale = keyframes(factors, between=between)
    if (np.sign(scale.values) != np.sign(scale.values[0])).any():
        raise ValueError("the scale changes its sign between keyframes, which would flatten the object")
    return Transforms(keyframes(shifts, between=between), turns(rotations, between=between), scale)


_SKEWED = 1e-4
"""Cosine between two axes of a placement above which they are not at right angles."""


def transforms_of(matrices: Mapping[float, np.ndarray]) -> Transforms:
    """Placements of an object by frame, of matrices world_from_object [4, 4]; between them all is linear.

    Raises:
        ValueError: a matrix that is skewed or flat, or mirrored in some frames only.
    """
    shifts, rotations, factors = {}, {}, {}
    for frame, matrix in matrices.items():
        lengths = np.linalg.norm(matrix[:3, :3], axis=0)
        if not (lengths > 0).all():
            raise ValueError(f"is flat at frame {frame:g}; give it some thickness")
        axes = matrix[:3, :3] / lengths
        if np.abs(axes.T @ axes - np.eye(3)).max() > _SKEWED:
            raise ValueError(f"is skewed at frame {frame:g}; apply the scale of its parents")
        mirrored = -1.0 if np.linalg.det(axes) < 0 else 1.0
        left, _, right = np.linalg.svd(axes * mirrored)
        shifts[frame], rotations[frame] = matrix[:3, 3], left @ right
        factors[frame] = lengths * mirrored
    scale = keyframes(factors, between="linear")
    if (np.sign(scale.values) != np.sign(scale.values[0])).any():
        raise ValueError("is mirrored in some frames only; mirror it in all of them")
    return Transforms(keyframes(shifts, between="linear"), turns(rotations, between="linear"), scale)


@dataclasses.dataclass(frozen=True)
class Motion:
    """How one object of a scene changes over a shot.

    Attributes:
        placed: world_from_object [4, 4] with which the object was placed in the scene.
        transforms: where it stands over time, instead of `placed`; None when it stays there.
        vertices: its shape over time; None when it keeps it.
    """

    placed: Float[np.ndarray, "4 4"] = dataclasses.field(default_factory=lambda: np.eye(4))
    transforms: Transforms | None = None
    vertices: VertexSequence | None = None


class MovingScene:
    """A scene of which some objects move.

    Example:
        >>> from focusjax.scene import make_object, make_scene
        >>> card = make_object("card", [(0, 0, -2), (1, 0, -2), (0, 1, -2)], [(0, 1, 2)])
        >>> scene = make_scene([card], unlit=True)
        >>> growing = Motion(transforms=transforms({1: {}, 3: {"scale": 3}}))
        >>> moving = MovingScene(scene, [card], {"card": growing})
        >>> moving.at(2).vertices[1].tolist()
        [2.0, 0.0, -4.0]
    """

    def __init__(self, scene: Scene, objects: Sequence[SceneObject], motions: Mapping[str, Motion]):
        """Check that everything fits.

        Args:
            scene: made of `objects`.
            objects: in the order in which the scene was made of them.
            motions: by object name.

        Raises:
            ValueError: an unknown name, other objects than the scene's, or a sequence of vertices that does
                not fit its object.
        """
        if sum(len(item.vertices) for item in objects) != len(scene.vertices):
            raise ValueError(
                "the objects are not those that the scene was made of; give these, in their order"
            )
        self._scene = scene
        self._moving: list[tuple[slice, SceneObject, Motion]] = []
        for name in motions:
            scene.face_range(name)
        start = 0
        for item in objects:
            rows = slice(start, start + len(item.vertices))
            start = rows.stop
            motion = motions.get(item.name)
            if motion is not None:
                handed = np.linalg.det(motion.placed[:3, :3])
                if not abs(handed) > 0:
                    raise ValueError(f"object {item.name!r} was placed with a matrix that flattens it")
                if motion.transforms is not None and handed * np.prod(motion.transforms.scale.values[0]) < 0:
                    raise ValueError(
                        f"object {item.name!r} was placed with another sign of its scale than its keyframes"
                        " have; place it as they do"
                    )
                if motion.vertices is not None:
                    motion.vertices.check(item)
                self._moving.append((rows, item, motion))
        self._known: dict[bytes, Scene] = {}

    @property
    def still(self) -> Scene:
        """The scene with all objects where they were placed."""
        return self._scene

    @property
    def moves(self) -> bool:
        """Whether anything does."""
        return bool(self._moving)

    def bodies(self) -> tuple[Body, ...]:
        """The objects that move: as one, by a matrix, or deforming."""
        return tuple(
            Body(
                item.name,
                self._scene.face_range(item.name),
                motion.transforms if motion.vertices is None else None,
            )
            for _, item, motion in self._moving
            if motion.transforms is not None or motion.vertices is not None
        )

    def at(self, frame: float) -> Scene:
        """The scene in one frame: the same triangles, materials and lights, with vertices and normals moved.

        Frames in which everything stands alike give the same scene.
        """
        if not self._moving:
            return self._scene
        vertices, normals = self._scene.vertices.copy(), self._scene.normals.copy()
        for rows, item, motion in self._moving:
            vertices[rows], normals[rows] = _moved(item, motion, frame)
        key = vertices.tobytes()
        if key not in self._known:
            # One is enough: what stands still does so in consecutive frames.
            self._known = {key: dataclasses.replace(self._scene, vertices=vertices, normals=normals)}
        return self._known[key]


def _moved(
    item: SceneObject, motion: Motion, frame: float
) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "v 3"]]:
    """Vertices and unit normals of one object in world axes."""
    world_from_object = motion.placed if motion.transforms is None else motion.transforms(frame)
    object_from_world = np.linalg.inv(motion.placed)
    if motion.vertices is None:
        vertices = _points(world_from_object @ object_from_world, item.vertices)
        normals = item.normals @ motion.placed[:3, :3] @ np.linalg.inv(world_from_object[:3, :3])
    else:
        vertices = _points(world_from_object, motion.vertices.at(frame, item))
        normals = motion.vertices.normals(vertices, item)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return vertices, np.where(length > 0, normals / np.where(length > 0, length, 1.0), item.normals)


def _points(matrix: Float[np.ndarray, "4 4"], points: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 3"]:
    return points @ matrix[:3, :3].T + matrix[:3, 3]
