"""Pictures of hard scenes and their derivatives, in both precisions, against rays cast at the triangles.

The picture I(v) of settings v (focus, opening, tilt) is compared

- with the picture that Embree makes of the same lens and triangles;
- between float32 and float64.

Its derivatives J = dI / dv are compared

- between modes: the gradient of sum(w I) for fixed weights w, in reverse, with sum(w J), forward;
- between float32 and float64;
- with differences of Embree's pictures, of the same rays with settings a little apart, or with 0 where
  nothing changes.

Errors of pictures are |a - I| / |I|. Those of derivatives are |a - J| / (|I| p) with p the pixels that the
setting moves a ray at the rim for every dioptre: the share of the light that a pixel of blur puts elsewhere.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.baselines import RayScene, lens_picture
from focusjax.hard_cases import _stages as stages
from focusjax.hard_cases._check import Check
from focusjax.hard_cases._stages import PARALLAX, Stage, layers_of, lens_of
from focusjax.layers import Layers
from focusjax.trace import render

RAYS = 256
"""Rays to the pixel, for the picture and for its derivatives."""
_TRUTH_RAYS = 4096
_STEP_PX = 0.2
"""Pixels that a difference of settings moves the rim by."""
_MOST_STEP = 0.05
"""Dioptres that focus and tilt change by at most."""

Settings = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class PictureCase:
    """One hard picture.

    Attributes:
        name: what is hard about it.
        stage: what is seen.
        settings: focus in 1/m, pixels that the rim moves a ray per dioptre, and tilt in 1/m.
        picture: bound of the picture against the truth, as a share of its size.
        single: bound of float32 against float64, of the picture.
        modes: bound of reverse against forward, in float32.
        slopes: bound of float32 against float64, of the derivatives.
        differences: bound of the derivatives against differences of the truth.
        flat: bounds of the derivatives by settings, of 0 to 2, that change nothing.
        closed_form: radiance of every pixel, where rays cast at triangles cannot give it.
        why: what makes a bound wider than in other cases.
    """

    name: str
    stage: Stage
    settings: Settings
    picture: float = 0.025
    single: float = 1e-3
    modes: float = 1e-5
    slopes: float = 0.01
    differences: float = 0.05
    flat: dict[int, float] = dataclasses.field(default_factory=dict)
    closed_form: Callable[[], float] | None = None
    why: str = ""


def _panes_light() -> float:
    passed, light = 1.0, 0.0
    for number in range(stages.PANES):
        light += passed * stages.STOPPED * stages.pane_light(number)
        passed *= 1.0 - stages.STOPPED
    return light + passed * 0.2


_MIXED = Stage(stages.mixed)
_WALLED = Stage(stages.before_a_wall)
_COMMON = (0.5, PARALLAX, 0.0)
_NONE = 1e-12

_NARROW = "at one sample to the pixel a light of a pixel's size keeps 98 % of its light; two lose nothing"
_ONE_SIDED = "an edge exactly in focus has no slope: it blurs whichever way focus moves, and rounding chooses"
_NO_BLUR = "the blur is of 1e-5 px: there is nothing to average over, and the unit is as small"
_THIN = "needles of a fiftieth of a pixel lose an eighth of their light where several are in one sample"
_FEW = "a lamp of two pixels in a blur of a hundred is met by four rays in a pixel: noise"
_UNSEEN = "layers hold what the lens centre can see, and it sees this edge on"
_STEEP = "its distance changes within a sample by more than the lens resolves"
_CHANCE = "which pane stops a ray is chance: noise"

CASES = (
    PictureCase("focus at infinity", _MIXED, (0.0, PARALLAX, 0.0)),
    PictureCase(
        "focus at the nearest surface",
        _MIXED,
        (1.0, PARALLAX, 0.0),
        picture=0.25,
        slopes=0.2,
        differences=0.2,
        why=f"{_NARROW}; {_ONE_SIDED}",
    ),
    PictureCase("focus beyond every surface", _MIXED, (0.1, PARALLAX, 0.0)),
    PictureCase(
        "closed opening",
        _MIXED,
        (0.5, 0.0, 0.0),
        picture=0.05,
        flat={0: _NONE, 1: 0.02, 2: _NONE},
        why=_NARROW,
    ),
    PictureCase(
        "opening of 1e-6 m",
        Stage(stages.mixed, common=False),
        (0.5, 2e-5, 0.0),
        picture=0.05,
        modes=2e-3,
        slopes=0.15,
        differences=0.5,
        why=f"{_NARROW}; {_NO_BLUR}",
    ),
    PictureCase("opening wider than everything is far", _MIXED, (0.5, 40.0, 0.0)),
    PictureCase("in focus alone", Stage(stages.in_focus), _COMMON),
    PictureCase("in focus before a wall", _WALLED, _COMMON, slopes=0.05, why=_ONE_SIDED),
    PictureCase("tilted plane in focus", _MIXED, (0.5, 6.0, 0.5), picture=0.06, why=_NARROW),
    PictureCase(
        "tilt of 44.4 degrees", _MIXED, (0.5, 0.2, 15.55), picture=0.08, differences=0.2, why=_NARROW
    ),
    PictureCase("coincident triangles", Stage(stages.coincident), (0.3, PARALLAX, 0.0)),
    PictureCase("inverted triangles", Stage(stages.inverted), (0.3, PARALLAX, 0.0)),
    PictureCase("needles", Stage(stages.needles), _COMMON, picture=0.25, differences=0.2, why=_THIN),
    PictureCase("triangles below a pixel", Stage(stages.subpixel), _COMMON, picture=0.04),
    PictureCase("triangles far beyond the frame", Stage(stages.frame_filling), (0.3, PARALLAX, 0.0)),
    PictureCase(
        "a sheet seen edge on",
        Stage(stages.edge_on),
        (0.3, PARALLAX, 0.0),
        picture=0.3,
        differences=0.15,
        why=_UNSEEN,
    ),
    PictureCase(
        "radiance of 1e-8 to 1e8",
        Stage(stages.lamps, background=0.0),
        (0.2, PARALLAX, 0.0),
        picture=0.12,
        differences=0.4,
        why=_FEW,
    ),
    PictureCase(
        "all behind the camera", Stage(stages.nothing), _COMMON, flat=dict.fromkeys((0, 1, 2), _NONE)
    ),
    PictureCase("a floor through the lens plane", Stage(stages.floor), (0.5, 2.0, 0.0)),
    PictureCase(
        "a wall that touches the lens",
        Stage(stages.touching, common=False),
        (0.5, 2.0, 0.0),
        picture=0.06,
        why=_STEEP,
    ),
    PictureCase("blur of 400 px", Stage(stages.close, common=False), (0.5, 10.0, 0.0), picture=0.03),
    PictureCase(
        "119 layers",
        Stage(stages.panes, max_layers=128, solid=False, common=False),
        _COMMON,
        picture=0.08,
        flat={0: 0.06, 1: 0.02, 2: 0.015},
        closed_form=_panes_light,
        why=_CHANCE,
    ),
    PictureCase(
        "camera 1e6 m from the origin",
        Stage(stages.before_a_wall, place=(1e6, 1e6, -1e6)),
        _COMMON,
        slopes=0.05,
        why=_ONE_SIDED,
    ),
    PictureCase("frame of one column", Stage(stages.mixed, size=(1, 12), common=False), _COMMON),
    PictureCase("frame of one row", Stage(stages.mixed, size=(16, 1), common=False), _COMMON),
    PictureCase("panorama of 100:1", Stage(stages.mixed, size=(200, 2), common=False), _COMMON),
)


@dataclasses.dataclass(frozen=True, eq=False)
class _Found:
    """A picture [h, w, 3], its Jacobian [h, w, 3, 3], and the gradient [3] of the sum with `weights`."""

    picture: np.ndarray
    jacobian: np.ndarray
    gradient: np.ndarray


def picture_checks(case: PictureCase) -> Iterator[Check]:
    """All that is looked at in one case."""

    def check(quantity: str, truth: str, error: float, bound: float, usual: float = math.inf) -> Check:
        return Check("pictures", case.name, quantity, truth, error, bound, case.why, usual)

    double, single = (_found(case, double=double) for double in (True, False))
    truth, slopes = _truth(case)
    reference = "Embree" if case.closed_form is None else "closed form"
    light = np.linalg.norm(double.picture)
    moved = np.array([case.settings[1], 1.0, case.settings[1]])
    unit = light * np.maximum(moved, 1e-6)
    yield check("picture, float64", reference, _off(double.picture, truth), case.picture, PictureCase.picture)
    yield check("picture, float32", "float64", _off(single.picture, double.picture), case.single)
    weights = _weights(double.picture.shape)
    for found, name, bound in ((double, "float64", 1e-10), (single, "float32", case.modes)):
        forward = np.einsum("hwc,hwck->k", weights, found.jacobian)
        yield check(f"reverse, {name}", "forward", _largest((found.gradient - forward) / unit), bound)
    apart = np.linalg.norm((single.jacobian - double.jacobian).reshape(-1, 3), axis=0)
    yield check("derivatives, float32", "float64", _largest(apart / unit), case.slopes, PictureCase.slopes)
    for number, name in enumerate(("focus", "opening", "tilt")):
        found, flat = double.jacobian[..., number], number in case.flat
        if not flat and slopes is None:
            continue
        expected = np.zeros_like(found) if flat or slopes is None else slopes[..., number]
        error = float(np.linalg.norm(found - expected) / unit[number])
        bound = case.flat.get(number, case.differences)
        usual = math.inf if flat else PictureCase.differences
        yield check(f"by {name}, float64", "0" if flat else "differences of Embree", error, bound, usual)


def _found(case: PictureCase, *, double: bool) -> _Found:
    with jax.enable_x64(double):
        layers = layers_of(case.stage, case.settings)
        settings, weights = jnp.array(case.settings), jnp.asarray(_weights(_shape(case.stage)))
        picture, gradient = _reverse(layers, settings, weights)
        found = picture, _forward(layers, settings), gradient
        return _Found(*(np.asarray(part, dtype=np.float64) for part in found))


@jit
def _forward(layers: Layers, settings: Float[Array, "3"]) -> Float[Array, "h w 3 3"]:
    return jax.jacfwd(lambda settings: _picture(layers, settings))(settings)


@jit
def _reverse(
    layers: Layers, settings: Float[Array, "3"], weights: Float[Array, "h w 3"]
) -> tuple[Float[Array, "h w 3"], Float[Array, "3"]]:
    picture, back = jax.vjp(lambda settings: _picture(layers, settings), settings)
    return picture, back(weights.astype(picture.dtype))[0]


def _picture(layers: Layers, settings: Float[Array, "3"]) -> Float[Array, "h w 3"]:
    lens = lens_of(settings, layers.camera)
    return render(layers, lens, even=True, rays=RAYS, derivative_rays=RAYS)


def _truth(case: PictureCase) -> tuple[np.ndarray, np.ndarray | None]:
    """The picture, and its derivatives by the settings; the latter are None where it is a closed form."""
    if case.closed_form is not None:
        return np.full(_shape(case.stage), case.closed_form()), None
    with jax.enable_x64(True):
        camera = case.stage.camera()
        ready = RayScene(case.stage.scene())

        def seen(settings: Sequence[float]) -> np.ndarray:
            return lens_picture(ready, camera, lens_of(jnp.array(settings), camera), rays=_TRUTH_RAYS)

        radius, slopes = case.settings[1], []
        for number in range(3):
            step = min(radius, _STEP_PX) if number == 1 else min(_MOST_STEP, _STEP_PX / max(radius, _STEP_PX))
            sides = [
                [v + sign * step * (k == number) for k, v in enumerate(case.settings)] for sign in (1, -1)
            ]
            ahead, behind = (seen(settings) for settings in sides)
            slopes.append((ahead - behind) / (2.0 * max(step, 1e-12)))
        return seen(case.settings), np.stack(slopes, axis=-1)


def _shape(stage: Stage) -> tuple[int, int, int]:
    width, height = stage.size
    return height, width, 3


def _weights(shape: tuple[int, ...]) -> np.ndarray:
    return np.cos(np.arange(np.prod(shape), dtype=np.float64)).reshape(shape)


def _off(found: np.ndarray, truth: np.ndarray) -> float:
    return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))


def _largest(values: np.ndarray) -> float:
    """The largest size of all, or NaN if one is not finite."""
    return float(np.abs(values).max())
