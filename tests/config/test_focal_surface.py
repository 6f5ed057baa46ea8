"""Focal surfaces in configs: what is refused, and whose word counts where control points overlap."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.config import ConfigError, build_camera, build_focal_surface, build_lens, load_config
from focusjax.focus import AtPoint, Blur, FocusPoint, locate

CONFIG = Path(__file__).parents[2] / "configs" / "focal_surface.toml"


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("lens.focal_surface.points=[]", "lens.focal_surface.points is []; expected at least 1 entries"),
        ("lens.focal_surface.basis=cubic", "lens.focal_surface.basis is \"cubic\"; expected 'constant'"),
        ("lens.focal_surface.kernel.exponent=9", "kernel.exponent is 9; expected a number of at most 4"),
        ("lens.focal_surface.kernel={kind='gaussian'}", "lens.focal_surface.kernel.width_px is missing"),
        ("lens.focal_surface.kernel={kind='box'}", 'lens.focal_surface.kernel has kind = "box"; give how'),
        ("lens.focal_surface.smoothness=-1", "lens.focal_surface.smoothness is -1; expected a number of at"),
        (
            "lens.focal_surface.favour_near=-1",
            "lens.focal_surface.favour_near is -1; expected a number of at",
        ),
        (
            "lens.focal_surface.points.0.weight=-1",
            "focal_surface.points.0.weight is -1; expected a number of",
        ),
        ("lens.focal_surface.points.0.aperture_scale=0", "points.0.aperture_scale is 0; expected a number"),
        (
            "lens.focal_surface.points.0.pixel=[1, 2]",
            "needs exactly one of pixel, point, direction,",
        ),
        (
            "lens.focal_surface.points=[{barycentric=[0.2, 0.3, 0.5]}]",
            "lens.focal_surface.points.0 needs triangle and barycentric together",
        ),
        ("lens.focal_surface.point=1", "unknown key lens.focal_surface.point; did you mean points?"),
        ("lens.focus_distance_m=2", "lens has focus_distance_m and a focal_surface; give one or the other"),
        ("focus.0={object='spot', in_frame_px=9}", "focus.0 wishes for neither sharp nor a blur"),
    ],
)
def test_bad_values(override, expected):
    with pytest.raises(ConfigError) as caught:
        load_config(CONFIG, [override])
    assert expected in str(caught.value)


def test_no_near_point_counts_more_unless_that_is_said():
    config = load_config(CONFIG)
    assert config.lens.focal_surface.favour_near == config.solve.favour_near == 0.0
    said = load_config(CONFIG, ["lens.focal_surface.favour_near=1"])
    assert said.lens.focal_surface.favour_near == 1.0


def test_where_points_overlap_the_near_and_the_visible_one_counts_more():
    """Two points at one place in the picture, at 1 m and 2 m, and a third apart from them."""
    points = "lens.focal_surface.points=[{point=[0,0,-1]}, {point=[0,0,-2], weight=3}, {point=[0.2,0,-2]}]"
    config = load_config(CONFIG, [points, "camera.position=[0,0,0]", "camera.look_at=[0,0,-1]"])
    camera = build_camera(config)
    lens = build_lens(config, camera, solved=True)
    wishes = [
        FocusPoint(AtPoint(place), Blur(0.0, signed=True), weight=weight)
        for place, weight in (((0, 0, -1), 1), ((0, 0, -2), 3), ((0.2, 0, -2), 1))
    ]

    def middle(disparity_map: np.ndarray | None) -> float:
        found = locate(wishes, camera, disparity_map=disparity_map, favour_near=1.0)
        surface = build_focal_surface(config, found, camera, lens)
        return float(surface.at(jnp.asarray(found.xy[0]))[0])

    # 1/m, by weight, of which the near one has twice as much for being near, the far one 1.5 times.
    assert middle(None) == pytest.approx((2 * 1.0 + 4.5 * 0.5) / 6.5, abs=1e-6)
    # Something at 1 m hides the second point, which then says nothing.
    assert middle(np.full((480, 640), 1.0)) == pytest.approx(1.0, abs=1e-6)
