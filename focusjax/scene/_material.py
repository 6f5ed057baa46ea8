"""How a surface answers light: constants of one material, and the checks of their values."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from focusjax._arguments import real_number, real_numbers

UNTEXTURED = -1
"""The texture number of a material that has none."""


@dataclass(frozen=True)
class Material:
    """Lambert reflection, a Phong highlight, a mirror and light of its own, all linear RGB.

    Attributes:
        base_colour: albedo [3], 0 to 1; vertex colours and texture multiply it.
        emission: radiance [3] the surface sends out itself; may exceed 1.
        specular: Phong coefficient [3]; 0 is matt.
        shininess: Phong exponent, at least 1; the larger, the smaller the highlight.
        texture: number of the base-colour texture, or -1.
        reflectance: share [3] of the surroundings at infinity that the surface mirrors, 0 to 1. It is added
            to the rest: a polished metal has a black base colour.
        opacity: share of the surface that is there, 0 to 1; vertex opacity and its picture multiply it.
        opacity_texture: number of the opacity picture, or -1.
        cutoff: the picture only cuts the surface out: it is there where the picture holds at least this
            much. None where it blends.
        pixels: the texels of the texture are means over pixels: samples no larger than a texel see the one
            they are in, unchanged, and not a mixture with those around it.
    """

    base_colour: Float[np.ndarray, "3"]
    emission: Float[np.ndarray, "3"]
    specular: Float[np.ndarray, "3"]
    shininess: float = 32.0
    texture: int = UNTEXTURED
    reflectance: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    opacity: float = 1.0
    opacity_texture: int = UNTEXTURED
    cutoff: float | None = None
    pixels: bool = False

    def cut_at(self, cutoff: float) -> "Material":
        """This material, there where its opacity is at least `cutoff` and nowhere else (glTF's MASK)."""
        if self.opacity_texture == UNTEXTURED or self.opacity == 0.0:
            return replace(self, opacity=float(0.0 < self.opacity >= cutoff))
        return replace(self, opacity=1.0, cutoff=cutoff / self.opacity)

    def renumbered(self, textures: Mapping[int, int], opacities: Mapping[int, int]) -> "Material":
        """This material with other numbers for the pictures that it has."""
        unpainted, solid = self.texture == UNTEXTURED, self.opacity_texture == UNTEXTURED
        return replace(
            self,
            texture=UNTEXTURED if unpainted else textures[self.texture],
            opacity_texture=UNTEXTURED if solid else opacities[self.opacity_texture],
        )


def triple(value: object, what: str, *, largest: float = float("inf")) -> Float[np.ndarray, "3"]:
    """Three finite values of 0 to `largest`, from three or from one for all.

    Raises:
        ValueError: another number of values, or one out of range.
    """
    values = real_numbers(value, what, "one number or three (red, green, blue)")
    if values.shape not in ((), (3,)):
        raise ValueError(f"{what} is {value!r}; expected one number or three (red, green, blue)")
    if not (np.isfinite(values).all() and (values >= 0).all() and (values <= largest).all()):
        bound = "at least 0" if largest == float("inf") else f"0 to {largest:g}"
        raise ValueError(f"{what} is {value!r}; expected finite values of {bound}")
    return np.broadcast_to(values, (3,)).copy()


def opacity_of(value: float, what: str) -> float:
    """A share of 0 to 1.

    Raises:
        ValueError: out of range, or not a number.
    """
    share = real_number(value, what, "a number, 0 (not there) to 1 (opaque)")
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"{what} is {value!r}; expected a number, 0 (not there) to 1 (opaque)")
    return share


def shininess_of(value: float) -> float:
    """A Phong exponent.

    Raises:
        ValueError: below 1, where a lobe's slope has no bound, or not finite.
    """
    expected = "a finite Phong exponent of at least 1"
    if not 1.0 <= real_number(value, "shininess", expected) < float("inf"):
        raise ValueError(f"shininess is {value}; expected {expected}")
    return float(value)
