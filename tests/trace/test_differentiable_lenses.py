"""Derivatives of pictures through lenses of many kinds, by every array that they are made of."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, varied_layers

from focusjax.layers import Layers
from focusjax.lens import (
    AberratedLens,
    AbstractLens,
    Disk,
    ThinLens,
    TiltShiftLens,
    apodized,
    focal_surface,
    focal_surface_lens,
    obstructed,
    polygon,
    power_profile,
    seidel,
    vignetted_lens,
)
from focusjax.trace import render

CAMERA = front_camera()
RADIUS = 8.0 / float(CAMERA.focal_px)
RAYS = 128
STEP = 0.06
"""Of the logarithm of an array: half a pixel of blur."""
_LEAST, _NOISY = 1e-6, 0.05
"""Of differences: squares in all, and the share of them that is noise, that show something."""


def thin(aperture) -> ThinLens:
    return ThinLens(jnp.array(0.45), jnp.array(RADIUS), aperture)


def lenses() -> dict[str, AbstractLens]:
    surface = focal_surface([(4, 4), (28, 10), (15, 21)], [0.3, 0.5, 0.7], basis="affine")
    faults = seidel(thin(Disk()), CAMERA, w040=0.9, w131=-1.4, w222=0.8, w220=-0.7, w311=1.2)
    aberrated = AberratedLens(thin(Disk()), (faults, power_profile([0.1, -0.05, 0.2])))
    return {
        "tilted, blades": TiltShiftLens(
            jnp.array((0.15, -0.2, 0.45)), jnp.array(RADIUS), polygon(5, rotation=0.3, roundness=0.5)
        ),
        "focal surface": focal_surface_lens(surface, CAMERA, thin(Disk())),
        "apodized ring": thin(apodized([1.0, 0.6, 0.2], obstructed(0.4))),
        "aberrated, cat's eyes": vignetted_lens(aberrated, CAMERA, corner_shift=0.6),
    }


def scaled(lens: AbstractLens, shares: jax.Array) -> AbstractLens:
    """The lens with each of its arrays times the exponential of a share."""
    arrays, rest = eqx.partition(lens, eqx.is_inexact_array)
    leaves, shape = jax.tree.flatten(arrays)
    moved = [leaf * jnp.exp(share) for leaf, share in zip(leaves, shares, strict=True)]
    return eqx.combine(jax.tree.unflatten(shape, moved), rest)


def names_of(lens: AbstractLens) -> list[str]:
    paths = jax.tree_util.tree_leaves_with_path(eqx.filter(lens, eqx.is_inexact_array))
    return [jax.tree_util.keystr(path) for path, _ in paths]


@eqx.filter_jit
def both_modes(layers: Layers, lens: AbstractLens) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Jacobian [h, w, 3, k] by the logarithm of each array, a gradient [k], and its weights."""

    def picture(shares: jax.Array) -> jax.Array:
        return render(layers, scaled(lens, shares), even=True, rays=RAYS, derivative_rays=RAYS)

    none = jnp.zeros(len(names_of(lens)), dtype=layers.background.dtype)
    weights = jnp.cos(jnp.arange(24 * 32 * 3.0, dtype=none.dtype)).reshape(24, 32, 3)
    gradient = jax.grad(lambda shares: (weights * picture(shares)).sum())(none)
    return jax.jacfwd(picture)(none), gradient, weights


NAMES = [
    name if name == "tilted, blades" else pytest.param(name, marks=pytest.mark.slow) for name in lenses()
]


@cache
def derivatives(name: str) -> tuple[np.ndarray, ...]:
    return tuple(np.asarray(part) for part in both_modes(varied_layers(), lenses()[name]))


def blocks(picture: np.ndarray) -> np.ndarray:
    return picture.reshape(6, 4, 8, 4, 3).mean(axis=(1, 3))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.slow
def test_forward_and_reverse_agree(name: str):
    jacobian, gradient, weights = derivatives(name)
    assert np.isfinite(jacobian).all()
    forward = np.einsum("hwc,hwck->k", weights, jacobian)
    scale = np.einsum("hwc,hwck->k", np.abs(weights), np.abs(jacobian)).max()
    # Observed: 1e-16.
    assert np.abs(gradient - forward).max() < 1e-12 * scale


@pytest.mark.slow
def test_forward_and_reverse_agree_in_single_precision():
    double = varied_layers(), lenses()["tilted, blades"]
    with jax.enable_x64(False):
        single = jax.tree.map(lambda a: a.astype(jnp.float32) if eqx.is_inexact_array(a) else a, double)
        jacobian, gradient, weights = (np.asarray(part, dtype=np.float64) for part in both_modes(*single))
    forward = np.einsum("hwc,hwck->k", weights, jacobian)
    scale = np.einsum("hwc,hwck->k", np.abs(weights), np.abs(jacobian)).max()
    off = np.abs(gradient - forward).max() / scale
    # Observed: 1.2e-8.
    assert off < 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_differences_of_converged_pictures(name: str):
    """By each array that changes the picture; two differences by other rays show how far they are noise."""
    lens, (jacobian, _, _) = lenses()[name], derivatives(name)
    checked = []
    for number, leaf in enumerate(names_of(lens)):
        step = np.zeros(jacobian.shape[-1])
        step[number] = STEP
        first, second = (
            blocks(
                np.subtract(
                    *(
                        np.asarray(
                            render(
                                varied_layers(),
                                scaled(lens, jnp.asarray(side * step)),
                                rays=512,
                                smooth=False,
                                even=True,
                                seed=seed,
                            )
                        )
                        for side in (1, -1)
                    )
                )
            )
            / (2 * STEP)
            for seed in (1, 2)
        )
        found, power = blocks(jacobian[..., number]), (first * second).sum()
        if power < _LEAST or ((first - second) ** 2).sum() / 4 > _NOISY * power:
            continue
        checked.append(leaf)
        # Observed: 0.97 to 1.04, and 1.08 by the disk of the cat's eyes, whose differences are not straight.
        assert abs((found * (first + second)).sum() / 2 / power - 1.0) < 0.12, leaf
    assert len(checked) >= {"tilted, blades": 2, "aberrated, cat's eyes": 8}.get(name, 3)
