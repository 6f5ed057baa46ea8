"""The shape of a lens's opening as other programs know it: a disk or blades, perhaps narrowed."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np

from focusjax.lens import AbstractAperture, Disk, Polygon, Squeezed, polygon, squeezed


@dataclasses.dataclass(frozen=True)
class Opening:
    """An opening.

    Attributes:
        blades: number of sides; 0 for a disk.
        rotation: radians of the first corner, from right towards down (clockwise on screen).
        roundness: of the sides, 0 (straight) to 1 (a circle).
        squeeze: how many times narrower it is than high.
        other: the class of an opening of another shape, such as a mask; empty for these.
        radius_share: aperture radius of a disk whose light is spread as widely (of equal variance about the
            axis), over this one's.
    """

    blades: int = 0
    rotation: float = 0.0
    roundness: float = 0.0
    squeeze: float = 1.0
    other: str = ""
    radius_share: float = 1.0

    def aperture(self) -> AbstractAperture:
        """As focusjax has it; a disk in place of other shapes."""
        whole: AbstractAperture = Disk()
        if self.blades:
            whole = polygon(self.blades, rotation=self.rotation, roundness=self.roundness)
        return squeezed(self.squeeze, whole) if self.squeeze > 1.0 else whole

    @property
    def words(self) -> str:
        """What it is, for a sentence."""
        if self.other:
            return f"an opening of class {self.other}"
        sides = f"{self.blades} blades" if self.blades else "a disk"
        if self.blades and self.roundness:
            sides += f" of roundness {self.roundness:g}"
        return sides + (f", narrowed {self.squeeze:g} times" if self.squeeze > 1.0 else "")

    @property
    def is_disk(self) -> bool:
        """Whether it is a plain disk."""
        return not (self.blades or self.other) and self.squeeze == 1.0


def opening_of(aperture: AbstractAperture) -> Opening:
    """The opening that `aperture` is."""
    share = _radius_share(aperture)
    squeeze, whole = 1.0, aperture
    if isinstance(aperture, Squeezed):
        squeeze, whole = float(aperture.squeeze), aperture.whole
    if isinstance(whole, Polygon):
        rotation, roundness = (float(str(np.asarray(v))) for v in (whole.rotation, whole.roundness))
        if roundness < 1.0:
            return Opening(whole.blades, rotation, roundness, squeeze, radius_share=share)
    other = "" if isinstance(whole, Disk | Polygon) else type(whole).__name__
    return Opening(squeeze=squeeze, other=other, radius_share=share)


def opening_points(aperture: AbstractAperture, side: int = 24) -> jax.Array:
    """Points of the opening [side^2, 2], spread as its light is."""
    steps = (np.arange(side) + 0.5) / side
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    return jax.vmap(aperture.point)(jnp.asarray(grid, dtype=float))


def _radius_share(aperture: AbstractAperture) -> float:
    points = np.asarray(opening_points(aperture, 48))
    # A unit disk's mean square is a half; the same grid over it takes its own error out.
    even = np.asarray(opening_points(Disk(), 48))
    return math.sqrt(float((points**2).sum(axis=1).mean() / (even**2).sum(axis=1).mean()))
