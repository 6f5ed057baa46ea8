"""What lenses have in common that change the rays of another one, or what is known of them."""

import equinox as eqx
from jaxtyping import Array, Float

from focusjax.geometry import Camera
from focusjax.lens._aperture import AbstractAperture
from focusjax.lens._base import AbstractLens


class AbstractLensWrapper(AbstractLens):
    """A lens with the opening and the blur of another one.

    Attributes:
        lens: the other one.
    """

    lens: eqx.AbstractVar[AbstractLens]

    def opening(self) -> AbstractAperture:
        return self.lens.opening()

    def vignettes(self) -> bool:
        return self.lens.vignettes()

    def blur(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> Float[Array, ""]:
        return self.lens.blur(camera, film_point, disparity)
