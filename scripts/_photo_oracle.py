"""A photograph with the real scene in place of its guesses: how good guesses could be."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from focusjax.layers._assemble import assemble
from focusjax.layers._peel import first_surface, peel_fragments
from focusjax.layers._picture import rasterised_for
from focusjax.photo import GUESS

_MAX_LAYERS = 24


def with_real_scene(real, guess, camera, lens, *, behind=True):
    """Layers of what the photograph `guess` has seen, with the real scene in place of its guesses.

    Args:
        real: the scene that was photographed.
        guess: the scene of its photograph, of as many pixels as `camera` has.
        camera: of the picture that is made.
        lens: what it is made with.
        behind: whether guesses behind foregrounds are replaced, too, and not only those beyond the frame.
    """
    scene = _joined(real, guess if real.unlit else _dark(guess))
    layers = _layers(scene, len(real.faces), guess, camera, lens, behind=behind)
    radiance = np.array(layers.samples.radiance)
    # A photograph needs no light, and a pixel of it shows nothing of the real surface in its place.
    face = np.asarray(layers.samples.triangle) - len(real.faces)
    own = np.flatnonzero(face >= 0)
    grid = layers.grid
    row, column = np.divmod(np.asarray(layers.samples.index)[own] % grid.size, grid.columns)
    pictures = np.array([each.texture for each in guess.materials])[guess.face_material[face[own]]]
    for number, picture in enumerate(guess.textures):
        some = pictures == number
        border = (picture.shape[0] - camera.height) // 2 - grid.margin
        radiance[own[some]] = picture[row[some] + border, column[some] + border]
    return eqx.tree_at(lambda layers: layers.samples.radiance, layers, jnp.asarray(radiance))


def _layers(scene, count, guess, camera, lens, *, behind):
    """Layers of a joined scene, the first `count` faces of which are real, without what it has twice."""
    picture = rasterised_for(scene, camera, lens, supersampling=1, near=None)
    fragments, grid = picture.fragments, picture.grid
    parallax = float(lens.parallax(camera))
    face = picture.triangles.source[fragments.triangle]
    is_real = face < count
    guesses = guess.objects.get(GUESS, range(0))
    is_guess = (face >= count + guesses.start) & (face < count + guesses.stop)
    row, column = np.divmod(fragments.sample, grid.columns)
    row, column = row - grid.margin, column - grid.margin
    inside = (row >= 0) & (row < camera.height) & (column >= 0) & (column < camera.width)
    if behind:
        # The first surface in the middle of a pixel was photographed, if the photograph has it there.
        numbers = np.flatnonzero(is_real)
        nearest, owner = first_surface(fragments.sample[numbers], fragments.disparity[numbers], grid)
        is_first = np.zeros(len(face), dtype=bool)
        is_first[numbers[owner[owner >= 0]]] = True
        seen = ~is_real & ~is_guess
        apart = np.full(grid.size, np.inf)
        place = fragments.sample[seen]
        np.minimum.at(apart, place, np.abs(nearest[place] - fragments.disparity[seen]))
        twice = is_first & (apart[fragments.sample] * parallax <= 1.0)
        kept = np.where(is_real, ~inside | ~twice, ~is_guess)
    else:
        kept = np.where(is_real, ~inside, inside | ~is_guess)
    chosen = np.flatnonzero(kept)
    picture = picture.held([chosen])
    found, left = peel_fragments(picture.fragments, grid, parallax, _MAX_LAYERS, opacity=picture.opacity)
    counts = [len(layer) for layer in found]
    held = picture.held(found)
    return assemble(scene, camera, lens, held, counts, max_layers=_MAX_LAYERS, left_out=left)


def _dark(scene):
    """The scene in black, with its shapes and opacities."""
    zero = np.zeros(3)
    return dataclasses.replace(
        scene,
        materials=tuple(
            dataclasses.replace(each, base_colour=zero, emission=zero, specular=zero, reflectance=zero)
            for each in scene.materials
        ),
    )


def _joined(real, guess):
    """All triangles of both, under the lights and before the background of the first."""
    pictures, cuts = len(real.textures), len(real.opacities)

    def after(number, count):
        return number + count if number >= 0 else number

    materials = tuple(
        dataclasses.replace(
            each, texture=after(each.texture, pictures), opacity_texture=after(each.opacity_texture, cuts)
        )
        for each in guess.materials
    )
    arrays = {
        key: np.concatenate([getattr(real, key), getattr(guess, key)])
        for key in ("vertices", "normals", "uv", "colours")
    }
    opacities = [
        np.ones(len(each.vertices)) if each.vertex_opacity is None else each.vertex_opacity
        for each in (real, guess)
    ]
    return dataclasses.replace(
        real,
        **arrays,
        faces=np.concatenate([real.faces, guess.faces + len(real.vertices)]).astype(np.int32),
        face_material=np.concatenate([real.face_material, guess.face_material + len(real.materials)]),
        materials=real.materials + materials,
        textures=real.textures + guess.textures,
        opacities=real.opacities + guess.opacities,
        vertex_opacity=np.concatenate(opacities),
    )
