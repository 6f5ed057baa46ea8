"""What lenses have in common that take light from another lens's rays, and leave them where they are."""

import abc
import dataclasses

from jaxtyping import Array, Float

from focusjax.geometry import Camera, LensRay
from focusjax.lens._base import Channel
from focusjax.lens._wrapper import AbstractLensWrapper


class AbstractDimmedLens(AbstractLensWrapper):
    """A lens whose rays are those of another one with other weights, all else being that lens's own.

    Attributes:
        lens: the other one.
    """

    @abc.abstractmethod
    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        """The other lens's ray, and how much of its light arrives."""

    def channels(self) -> tuple[Channel, ...]:
        return tuple(
            Channel(dataclasses.replace(self, lens=each.lens), each.colour) for each in self.lens.channels()
        )

    def footprint(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        return self.lens.footprint(camera, film_point, disparity)

    def reach(self, camera: Camera, disparity: Float[Array, ""]) -> Float[Array, ""]:
        return self.lens.reach(camera, disparity)

    def parallax(self, camera: Camera) -> Float[Array, ""]:
        return self.lens.parallax(camera)
