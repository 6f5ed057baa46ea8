"""Lights of USD (UsdLux), as far as focusjax shades by them.

With L = intensity * 2^exposure * colour, a white Lambert surface that faces the light shows

    DistantLight    L sin^2(angle / 2), or L / pi where it is normalised or has no angle,
    SphereLight     L r^2 at a distance of 1 scene unit, or L / (4 pi) where it is normalised: a point light,
    DomeLight       L, from everywhere.

Source: the documentation of UsdLuxLightAPI (openusd.org), `intensity` and `normalize`.
"""

import math
import tempfile
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from focusjax._words import listed
from focusjax.scene import AbstractLight, directional_light, point_light, read_image
from focusjax.scene_files._usd_stage import pxr, refuse_outside, world_of


def usd_lights(
    stage: Any, prims: Sequence[Any], code: float, path: Path, within: Sequence[Path]
) -> tuple[tuple[AbstractLight, ...], Float[np.ndarray, "3"], Float[np.ndarray, "3"] | None]:
    """Lights, ambient light and the colour at infinity (None without a dome) of light prims.

    Warns:
        What is left out: lights of other kinds, spots, and domes with a picture.
    """
    Usd, UsdGeom, UsdLux = pxr(path, "Usd", "UsdGeom", "UsdLux")
    time = Usd.TimeCode(code)
    unit = UsdGeom.GetStageMetersPerUnit(stage)
    found: list[AbstractLight] = []
    left: list[str] = []
    dome = None
    for prim in prims:
        light = UsdLux.LightAPI(prim)
        radiance = _radiance(light, time, UsdLux)
        world = world_of(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(time), stage)
        normalised = bool(light.GetNormalizeAttr().Get(time))
        if prim.IsA(UsdLux.DistantLight):
            half = math.radians(float(UsdLux.DistantLight(prim).GetAngleAttr().Get(time))) / 2
            share = 1.0 / math.pi if normalised or half <= 0 else math.sin(min(half, math.pi / 2)) ** 2
            found.append(directional_light(-world[:3, 2], radiance * share))
        elif prim.IsA(UsdLux.SphereLight) and not _shaped(prim, time, UsdLux):
            size = abs(np.linalg.det(world[:3, :3])) ** (1 / 3)
            radius = float(UsdLux.SphereLight(prim).GetRadiusAttr().Get(time)) * size
            share = unit**2 / (4 * math.pi) if normalised else radius**2
            found.append(point_light(world[:3, 3], radiance * share))
        elif prim.IsA(UsdLux.DomeLight) and (even := _even_colour(prim, time, path, within)) is not None:
            dome = radiance * even if dome is None else dome + radiance * even
        else:
            left.append(f"{prim.GetName()} ({prim.GetTypeName()})")
    if left:
        warnings.warn(
            f"{path}: {listed(left)} {'is' if len(left) == 1 else 'are'} left out: focusjax has distant"
            " lights, spheres without a cone and domes without a picture; use these, or a [scene.background]",
            stacklevel=4,
        )
    return tuple(found), np.zeros(3) if dome is None else dome, dome


def _radiance(light: Any, time: Any, UsdLux: Any) -> Float[np.ndarray, "3"]:
    strength = float(light.GetIntensityAttr().Get(time)) * 2.0 ** float(light.GetExposureAttr().Get(time))
    colour = np.array(light.GetColorAttr().Get(time), dtype=float)
    if light.GetEnableColorTemperatureAttr().Get(time):
        kelvin = light.GetColorTemperatureAttr().Get(time)
        colour = colour * np.array(UsdLux.BlackbodyTemperatureAsRgb(kelvin), dtype=float)
    return np.maximum(strength * colour, 0.0)


def _even_colour(prim: Any, time: Any, path: Path, within: Sequence[Path]) -> Float[np.ndarray, "3"] | None:
    """What a dome's picture multiplies its light by, if it is of one colour; some programs write all so."""
    UsdLux, Ar = pxr(path, "UsdLux", "Ar")
    asset = UsdLux.DomeLight(prim).GetTextureFileAttr().Get(time)
    if not asset:
        return np.ones(3)
    place = str(asset.resolvedPath)
    if not place:
        return None
    refuse_outside(place, path, within)
    with tempfile.TemporaryDirectory() as folder:
        # Of a package, what is in it has no path of its own.
        file = Path(folder) / ("sky" + Path(place.rstrip("]")).suffix)
        try:
            file.write_bytes(bytes(Ar.GetResolver().OpenAsset(Ar.ResolvedPath(place)).GetBuffer()))
            picture = read_image(file)
        except ValueError:
            return None
    return picture[0, 0].astype(float) if np.ptp(picture, axis=(0, 1)).max() == 0 else None


def _shaped(prim: Any, time: Any, UsdLux: Any) -> bool:
    """Whether a light is a spot, or has a profile of its own."""
    shape = UsdLux.ShapingAPI(prim)
    cone, profile = shape.GetShapingConeAngleAttr(), shape.GetShapingIesFileAttr()
    return bool(cone and float(cone.Get(time)) < 90.0) or bool(profile and profile.Get(time))
