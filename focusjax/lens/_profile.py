"""Lens profiles: what a data sheet says of a lens, put over an ideal one (Kyaw 2013 section 7.2)."""

import dataclasses
from collections.abc import Iterator
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera
from focusjax.lens._base import AbstractLens
from focusjax.lens._falloff import CosineFalloff, DarkenedLens, TableFalloff, require_reach
from focusjax.lens._height_curve import HeightCurve
from focusjax.lens._thin import ThinLens
from focusjax.lens._vignetted import VignettedLens
from focusjax.lens._wrapper import RGB
from focusjax.lens.aberrations import AberratedLens, ChromaticLens, tabulated_aberrations

_SLACK = 1e-3
"""Of openings and lengths that are compared."""


_Held = TypeVar("_Held", HeightCurve | None, tuple[HeightCurve, HeightCurve, HeightCurve] | None)


class CatsEyes(eqx.Module):
    """The disks that cut off a lens's rays towards the corners; see `VignettedLens`.

    Attributes:
        ahead_radius: metres, of the disk ahead of the lens.
        ahead_distance: metres ahead of it.
        behind_radius: metres, of the disk behind it.
        behind_distance: metres behind it.
        cosine_power: of natural vignetting.
    """

    ahead_radius: Float[Array, ""]
    ahead_distance: Float[Array, ""]
    behind_radius: Float[Array, ""]
    behind_distance: Float[Array, ""]
    cosine_power: Float[Array, ""]


class LensProfile(eqx.Module):
    """A lens as tables over the image height. `lens_profile` and `load_profile` read them from files.

    Curves are in metres on the film, shares, and dioptres; `TabulatedAberrations` says what each means. What
    is None, the profile does not know, and it is not there.

    Attributes:
        title: what it is (static).
        focal_length: metres.
        f_number: range (static); spherical aberration and coma are those at the first, the widest opening.
        focus_distance: metres from the nearest to the farthest plane that it may be focused on (static).
        distortion: share.
        sagittal: 1/m.
        tangential: 1/m.
        spherical: 1/m.
        coma: metres.
        lateral_colour: metres, of red, green and blue, against the colour of the other tables.
        axial_colour: 1/m by which red, green and blue focus nearer than that.
        illumination: share of the light on the axis.
        cats_eyes: disks that make vignetting, instead of `illumination`.
        sources: where the numbers of each table are from, by the table's name in files (static).
    """

    title: str = eqx.field(static=True)
    focal_length: Float[Array, ""]
    f_number: tuple[float, float] = eqx.field(static=True)
    focus_distance: tuple[float, float] = eqx.field(static=True)
    distortion: HeightCurve | None = None
    sagittal: HeightCurve | None = None
    tangential: HeightCurve | None = None
    spherical: HeightCurve | None = None
    coma: HeightCurve | None = None
    lateral_colour: tuple[HeightCurve, HeightCurve, HeightCurve] | None = None
    axial_colour: tuple[HeightCurve, HeightCurve, HeightCurve] | None = None
    illumination: HeightCurve | None = None
    cats_eyes: CatsEyes | None = None
    sources: tuple[tuple[str, str], ...] = eqx.field(static=True, default=())

    def curves(self) -> Iterator[tuple[str, HeightCurve]]:
        """The tables that it has, with their names in files."""
        for key, name in TABLES.items():
            held = getattr(self, key)
            for curve in held if isinstance(held, tuple) else (held,) if held is not None else ():
                yield name, curve

    def scaled(self, focal_length: Float[Array, ""] | float) -> "LensProfile":
        """The same lens built for another focal length in metres: it grows, and the f-number stays."""
        scale = focal_length / self.focal_length

        def longer(held: _Held, values: Float[Array, ""] | float) -> _Held:
            def one(curve: HeightCurve) -> HeightCurve:
                return dataclasses.replace(curve, reach=curve.reach * scale, values=curve.values * values)

            return jax.tree.map(one, held, is_leaf=lambda part: isinstance(part, HeightCurve))

        eyes = self.cats_eyes
        if eyes is not None:
            longer_eyes = jax.tree.map(lambda length: length * scale, eyes)
            eyes = dataclasses.replace(longer_eyes, cosine_power=eyes.cosine_power)
        near, far = self.focus_distance
        return dataclasses.replace(
            self,
            focal_length=jnp.asarray(focal_length, dtype=self.focal_length.dtype),
            focus_distance=(near * float(scale), far * float(scale)),
            distortion=longer(self.distortion, 1.0),
            sagittal=longer(self.sagittal, 1.0 / scale),
            tangential=longer(self.tangential, 1.0 / scale),
            spherical=longer(self.spherical, 1.0 / scale),
            coma=longer(self.coma, scale),
            lateral_colour=longer(self.lateral_colour, scale),
            axial_colour=longer(self.axial_colour, 1.0 / scale),
            illumination=longer(self.illumination, 1.0),
            cats_eyes=eyes,
        )


TABLES = {
    "distortion": "distortion",
    "sagittal": "sagittal_focus",
    "tangential": "tangential_focus",
    "spherical": "spherical",
    "coma": "coma",
    "lateral_colour": "lateral_colour",
    "axial_colour": "axial_colour",
    "illumination": "illumination",
}
"""Attributes of `LensProfile` that are curves, and what files call them."""


def profiled_lens(
    lens: AbstractLens,
    profile: LensProfile,
    camera: Camera,
    *,
    colour: bool = True,
    extrapolate: bool = False,
) -> AbstractLens:
    """An ideal lens with the aberrations, the colour and the vignetting of a profile; itself if it has none.

    The profile is scaled to the camera's focal length, as a prescription is. Differentiable in the profile's
    tables by way of the lens that is returned.

    Args:
        lens: any lens that treats all colours alike, such as a thin one.
        profile: what to put over it.
        camera: whose frame the tables have to cover.
        colour: trace red, green and blue, where the profile knows how they differ.
        extrapolate: let the last line of each table go on to the corner that it does not reach.

    Raises:
        ValueError: a table that ends before the picture does, unless it is to be extrapolated; an opening or
            a focus distance beyond the profile's ranges.

    Example:
        >>> from focusjax.geometry import look_at
        >>> from focusjax.lens import lens_profile, thin_lens
        >>> camera = look_at((0, 0, 2), (0, 0, 0), width=60, height=40, focal_length=0.05)
        >>> thin = thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> lens = profiled_lens(thin, lens_profile("gauss_f1.8"), camera)
        >>> len(lens.channels())
        3
    """
    fitting = profile.scaled(float(camera.focal_length))
    _refuse_beyond_ranges(lens, fitting, camera)
    if not extrapolate:
        for name, curve in fitting.curves():
            title = f"the table {name} of {fitting.title}"
            require_reach(title, float(curve.heights[-1]), camera, slack=_SLACK)
    full = fitting.focal_length / (2.0 * fitting.f_number[0])
    own = ("distortion", "sagittal", "tangential", "spherical", "coma")
    terms = tabulated_aberrations({name: getattr(fitting, name) for name in own}, full)
    made = AberratedLens(lens, terms) if terms else lens
    if colour and (fitting.lateral_colour is not None or fitting.axial_colour is not None):
        axial, lateral = (each or (None,) * 3 for each in (fitting.axial_colour, fitting.lateral_colour))
        bands = [
            tabulated_aberrations({"sagittal": focus, "tangential": focus, "shift": shift}, full)
            for focus, shift in zip(axial, lateral, strict=True)
        ]
        made = ChromaticLens(made, tuple(bands), RGB)
    if fitting.cats_eyes is not None:
        eyes = fitting.cats_eyes
        made = VignettedLens(made, eyes.behind_radius, -eyes.behind_distance)
        made = VignettedLens(made, eyes.ahead_radius, eyes.ahead_distance)
        made = DarkenedLens(made, CosineFalloff(eyes.cosine_power))
    if fitting.illumination is not None:
        table = fitting.illumination
        made = DarkenedLens(made, TableFalloff(table.heights, table.values / table.values[0]))
    return made


def _refuse_beyond_ranges(lens: AbstractLens, profile: LensProfile, camera: Camera) -> None:
    widest, smallest = profile.f_number
    radius = float(lens.parallax(camera)) / float(camera.focal_px)
    if radius > 0:
        f_number = float(camera.focal_length) / (2.0 * radius)
        if not widest * (1.0 - _SLACK) <= f_number <= smallest * (1.0 + _SLACK):
            raise ValueError(
                f"the lens is at f/{f_number:.3g}, and {profile.title} goes from f/{widest:g} to"
                f" f/{smallest:g}; choose an f-number between them"
            )
    if isinstance(lens, ThinLens):
        distance = float(lens.focus_distance())
        near, far = profile.focus_distance
        if not near * (1.0 - _SLACK) <= distance <= far * (1.0 + _SLACK):
            raise ValueError(
                f"the focus distance is {distance:.3g} m, and {profile.title} at this focal length focuses"
                f" from {near:.3g} m to {far:.3g} m; focus between them"
            )
