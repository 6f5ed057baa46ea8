"""What moves: a scene over time, and the bodies in it."""

import dataclasses
from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from focusjax.scene import Scene


@dataclasses.dataclass(frozen=True)
class Body:
    """Faces of a scene that move together.

    Attributes:
        name: how messages call it.
        faces: numbers of its faces.
        placed: the matrix [4, 4] that takes it from any one pose to the world at a time, rigid or any other
            affine map; None for what deforms.
    """

    name: str
    faces: range
    placed: Callable[[float], Float[np.ndarray, "4 4"]] | None = None


@runtime_checkable
class MovingWorld(Protocol):
    """A scene of which parts move: `focusjax.shot.MovingScene`, for one."""

    def at(self, frame: float) -> Scene:
        """The scene at a time: always the same faces, in the same order."""
        ...

    def bodies(self) -> tuple[Body, ...]:
        """What may move; all other faces stand still."""
        ...


@dataclasses.dataclass(frozen=True)
class StillWorld:
    """A scene in which nothing moves, for cameras that do."""

    scene: Scene

    def at(self, frame: float) -> Scene:
        """The scene."""
        return self.scene

    def bodies(self) -> tuple[Body, ...]:
        """None."""
        return ()
