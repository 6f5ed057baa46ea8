"""Lenses found again from their pictures, by other rays and by another renderer."""

import re
from functools import cache

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch, varied_scene, wide_lens

from focusjax.baselines import lens_picture
from focusjax.inverse import ImageFit, Scan, fit_image, scan_lenses, widest_lens
from focusjax.layers import Layers, peel
from focusjax.lens import ThinLens, TiltShiftLens
from focusjax.scene import make_scene
from focusjax.trace import render

ALL = ("focus", "f_number", "tilt", "swing", "gain")
TRUE = TiltShiftLens(jnp.array([0.2, -0.4, 0.5]), jnp.array(8.0 / 40))
GAIN = 1.3


@cache
def layers() -> Layers:
    """The varied scene, for any focus from 0.8 m on and any opening up to 12 pixels per dioptre."""
    camera = front_camera()
    f_number = float(camera.focal_length) / (2 * 12.0 / 40)
    widest = widest_lens(camera, min_focus_distance=0.8, f_number=f_number, max_tilt=0.05)
    return peel(varied_scene(), camera, widest, supersampling=2)


@cache
def target() -> np.ndarray:
    """What the true lens makes of it, by rays that no fit uses."""
    return GAIN * np.asarray(render(layers(), TRUE, rays=256, even=True, seed=5))


START = ThinLens(jnp.array(0.3), jnp.array(4.0 / 40))
"""Far off."""


@cache
def scan() -> Scan:
    return scan_lenses(layers(), START, free=ALL)


def fitted(picture: np.ndarray, *, search: bool = False, **options) -> ImageFit:
    """By the one program that all tests share."""
    found = scan() if search else None
    return fit_image(picture, layers(), START, free=ALL, search=search, scan=found, **options)


def misses(fit: ImageFit) -> dict[str, float]:
    """Relative errors of opening and gain, and of the rest absolutely: 1/m and radians."""
    camera = front_camera()
    assert isinstance(fit.lens, TiltShiftLens)
    found, true = fit.lens.movements(camera), TRUE.movements(camera)
    return {
        "focus": abs(float(fit.lens.plane[2] - TRUE.plane[2])),
        "f_number": abs(float(fit.lens.aperture_radius / TRUE.aperture_radius) - 1),
        "tilt": abs(float(found.tilt - true.tilt)),
        "swing": abs(float(found.swing - true.swing)),
        "gain": abs(fit.gain / GAIN - 1),
    }


@cache
def by_search() -> ImageFit:
    return fitted(target(), search=True)


@pytest.mark.slow
def test_all_parameters_are_found_from_a_picture_by_other_rays():
    fit = by_search()
    found = misses(fit)
    # Observed: 0.0021, 0.66 %, 0.0009 and 0.0001 rad, 0.003 %.
    assert found["focus"] < 0.005
    assert found["f_number"] < 0.01
    assert max(found["tilt"], found["swing"]) < 2e-3
    assert found["gain"] < 2e-3
    assert fit.converged
    assert fit.at_limits == ()
    assert [level.block for level in fit.levels] == [8, 2, 1, 1]
    assert fit.steps == sum(level.steps for level in fit.levels)


@pytest.mark.slow
def test_the_report_is_that_of_the_picture():
    fit = by_search()
    difference = np.asarray(fit.picture) - target()
    np.testing.assert_allclose(fit.rms_error, np.sqrt((difference**2).mean()), rtol=1e-9)
    again = fit.gain * np.asarray(render(layers(), fit.lens, rays=64, even=True))
    # The same rays through the same lens. Observed: 1e-15.
    np.testing.assert_allclose(fit.picture, again, rtol=0, atol=1e-12)


def test_standard_errors_are_of_the_size_of_the_errors():
    fit, found = by_search(), misses(by_search())
    found["f_number"] *= float(TRUE.f_number(front_camera()))
    found["gain"] *= GAIN
    ratio = {name: found[name] / fit.standard_errors[name] for name in ALL}
    # Observed: 0.7, 1.2, 0.5, 0.2, 0.4.
    assert max(ratio.values()) < 4.0
    assert fit.standard_errors["focus"] < 0.01 * float(TRUE.plane[2])


def test_found_from_a_ray_cast_picture_without_a_search():
    """Triangles instead of layers, other rays, and a start that is far off."""
    fit = fitted(GAIN * lens_picture(varied_scene(), front_camera(), TRUE, rays=128))
    found = misses(fit)
    # Observed: 0.0085, 0.66 %, 0.0027 rad, 0.011 %.
    assert found["focus"] < 0.02
    assert found["f_number"] < 0.03
    assert max(found["tilt"], found["swing"]) < 4e-3
    assert found["gain"] < 0.01


def spoilt() -> tuple[np.ndarray, np.ndarray]:
    """The target with something in front that the layers do not have, and where that is not."""
    free = np.ones(target().shape[:2], dtype=bool)
    free[4:12, 20:26] = False
    return np.where(free[..., None], target(), 3.0), free


@pytest.mark.slow
def test_an_exact_renderer_takes_away_what_layers_get_wrong():
    """Layers that are all 5 % too bright, of which the last steps know nothing."""

    def cast(lens, seed: int = 77) -> np.ndarray:
        return lens_picture(varied_scene(), front_camera(), lens, rays=128, seed=seed)

    bright = eqx.tree_at(
        lambda each: (each.samples.radiance, each.background),
        layers(),
        (1.05 * layers().samples.radiance, 1.05 * layers().background),
    )
    picture = GAIN * cast(TRUE, seed=3)
    fits = [
        fit_image(picture, bright, START, free=ALL, search=False, exact=by, max_steps=12)
        for by in (None, cast)
    ]
    plain, exact = (misses(fit)["gain"] for fit in fits)
    # Observed: 4.7 % against 0.01 %; 1.2 % of the f-number.
    assert plain > 0.04
    assert exact < 0.01
    assert misses(fits[1])["f_number"] < 0.03
    assert fits[1].levels[-1].steps < 16


@pytest.mark.slow
def test_a_mask_leaves_out_what_the_layers_do_not_have():
    picture, free = spoilt()
    fit = fitted(picture, mask=free)
    again = fitted(np.where(free[..., None], picture, np.nan), mask=free)
    found = misses(fit)
    # Observed: 0.0003, 0.48 %.
    assert found["focus"] < 0.01
    assert found["f_number"] < 0.02
    assert float(again.lens.aperture_radius) == float(fit.lens.aperture_radius)


@pytest.mark.slow
def test_a_robust_fit_is_misled_less():
    picture, _ = spoilt()
    plain, robust = (misses(fitted(picture, search=True, robust=robust)) for robust in (False, True))
    # Observed: 0.0016 against 0.0005; focus 0.0005 to 0.0007, by compiler.
    assert robust["gain"] < 0.6 * plain["gain"]
    assert robust["focus"] < 0.005


def test_noise_is_weighed():
    """A half that is noise shows nothing when it is said to be."""
    noise = np.full(target().shape[:2], 1e-3)
    noise[:, 16:] = 10.0
    random = np.random.default_rng(0).normal(size=(24, 32, 3))
    fit = fitted(target() + np.where(noise > 1, 1.0, 0.0)[..., None] * random, noise=noise)
    found = misses(fit)
    # Observed: 0.34 %, 0.034 %.
    assert found["f_number"] < 0.03
    assert found["gain"] < 0.01


def refused(picture: np.ndarray, message: str, **options) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        fit_image(picture, layers(), wide_lens(front_camera()), **options)


def test_targets_that_are_no_linear_pictures_of_this_camera():
    good = target()
    refused(good[::2, ::2], "the target is 16 x 12 pixels but the layers are of 32 x 24; resample it with")
    refused(good[:12], "it is of another shape, too, so crop it before")
    refused(good[..., 0], "expected [height, width, 3], linear RGB")
    codes = np.round(200 * good / good.max())
    refused(codes.astype(np.uint8), "the target holds uint8 codes, in display encoding; decode it to linear")
    refused(codes, "whole numbers up to 200, which suggests display codes from 0 to 255")
    refused(
        (codes / 255).astype(np.float32), "multiples of 1/255 only, which suggests display codes over 255"
    )
    broken = good.copy()
    broken[3, 7, 1] = np.nan
    refused(broken, "the target is not finite in 1 pixels, the first at x = 7, y = 3; leave them out")
    refused(-good, "the target's mean is -")
    refused(
        np.ones_like(good), "the target is the same everywhere, so that the lens cannot be estimated from it"
    )


def test_other_arguments_that_do_not_fit():
    refused(target(), "no parameter is free; give some of", free=())
    refused(target(), "free has 'zoom'; expected some of", free=("focus", "zoom"))
    refused(target(), "the mask has shape (2, 2); expected (24, 32)", mask=np.ones((2, 2)))
    refused(target(), "the mask is empty", mask=np.zeros((24, 32)))
    refused(target(), "the mask holds values that are neither 0 nor 1", mask=np.full((24, 32), 0.2))
    refused(target(), "the mask holds values that are neither 0 nor 1", mask=np.full((24, 32), np.nan))
    refused(target(), "noise has shape (7, 1, 1)", noise=np.ones((7, 1)))
    refused(target(), "a standard deviation that is not positive and finite", noise=np.inf)
    with pytest.raises(ValueError, match="the lens is a pinhole, whose picture is the same at any focus"):
        fit_image(target(), layers(), ThinLens(jnp.array(0.5), jnp.array(0.0)), free=("focus",))
    refused(target(), "a standard deviation that is not positive", noise=0.0)
    refused(target(), "min_focus_distance is -1.0 m", min_focus_distance=-1.0)
    with pytest.raises(ValueError, match="peel again"):
        fit_image(target(), layers(), ThinLens(jnp.array(0.5), jnp.array(1.0)), free=("focus",))


def test_an_exact_picture_of_another_size():
    with pytest.raises(ValueError, match=re.escape("the exact picture has shape (2, 2, 3)")):
        fitted(target(), max_steps=1, exact=lambda lens: np.zeros((2, 2, 3)))


def test_a_scan_of_something_else_is_refused():
    def blank(shape: tuple[int, int], openings: int) -> Scan:
        pictures = np.zeros((openings, 2, *shape, 3))
        served = np.ones((openings, 2), dtype=bool)
        return Scan(np.array([0.1, 1.0]), np.linspace(0.1, 0.05, openings), pictures, pictures, served, 1)

    refused(
        target(),
        "the scan's pictures are of 16 x 12 blocks but the layers make 32 x 24",
        scan=blank((12, 16), 2),
    )
    refused(target(), "the scan is of one opening but f_number is free", scan=blank((24, 32), 1))


def test_a_picture_that_says_nothing_of_the_lens_is_refused():
    """Where all is of one colour the picture is the same through any lens."""
    radiance = layers().samples.radiance
    plain = eqx.tree_at(
        lambda each: (each.samples.radiance, each.background),
        layers(),
        (jnp.full_like(radiance, 0.5), jnp.full_like(layers().background, 0.5)),
    )
    with pytest.raises(ValueError, match="the picture does not depend on focus and f_number and tilt and sw"):
        fit_image(target(), plain, START, free=ALL, search=False)


def test_an_empty_view_is_refused():
    camera = front_camera()
    aside = make_scene([patch("aside", camera, (900, 0, 910, 9), 0.5)], unlit=True)
    with pytest.raises(ValueError, match="no surface is in sight"):
        fit_image(target(), peel(aside, camera, wide_lens(camera), supersampling=2), wide_lens(camera))
