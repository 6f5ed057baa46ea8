"""The error of the rays falls as it should: fast where all is smooth, more slowly at silhouettes."""

import numpy as np
from small_scenes import at_pixels, front_camera, patch, wide_lens

from focusjax.bench import near_silhouettes
from focusjax.layers import disparity_map, peel
from focusjax.scene import Scene, make_object, make_scene
from focusjax.trace import render

RAYS = (16, 256)


def bar_before_waves() -> Scene:
    """On the left a bar, blurred over 12 pixels; behind it a wall whose colours go up and down."""
    camera = front_camera()
    row, column = (index.ravel() for index in np.mgrid[:24, :32])
    xy = np.stack([2.0 * column - 16, 2.0 * row - 12], axis=1)
    colours = 0.5 + 0.4 * np.sin(xy @ np.array([(0.5, 0.3, 0.1), (0.2, -0.4, 0.5)]))
    corner = (row * 32 + column).reshape(24, 32)[:-1, :-1].reshape(-1, 1)
    faces = (corner[:, None] + np.array([(0, 1, 33), (0, 33, 32)])).reshape(-1, 3)
    wall = make_object("wall", at_pixels(xy, np.full(len(xy), 0.12), camera), faces, vertex_colours=colours)
    bar = patch("bar", camera, (4.3, -40, 7.1, 70), 1.0, (0.9, 0.1, 0.2))
    return make_scene([wall, bar], unlit=True)


def test_the_error_falls_with_the_rays():
    camera = front_camera()
    lens, scene = wide_lens(camera), bar_before_waves()
    layers = peel(scene, camera, lens, supersampling=2)

    def picture(rays: int, seed: int = 0) -> np.ndarray:
        return np.asarray(render(layers, lens, rays=rays, seed=seed, even=True))

    near = near_silhouettes(disparity_map(scene, camera), camera, lens)
    assert 0.3 < near.mean() < 0.7
    # Many more rays, and others.
    converged = np.mean([picture(RAYS[-1], seed=5 + k) for k in range(8)], axis=0)
    errors = [(picture(rays) - converged) ** 2 for rays in RAYS]
    for mask, wanted in ((near, 0.5), (~near, 0.75)):
        rms = [np.sqrt(error[mask].mean()) for error in errors]
        exponent = -np.polyfit(np.log(RAYS), np.log(rms), 1)[0]
        # Observed: 0.73 and 1.05.
        assert exponent > wanted
