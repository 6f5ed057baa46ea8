"""How far away should the sign hang, so that the lens which meets all wishes is an f/2 lens?

A question about the answer of a focus solve: each step of the root finder solves for focus and f-number and
uses the derivative of the solution with respect to the sign's distance.
"""

import dataclasses

import jax.numpy as jnp
import optimistix as optx

import focusjax as fj

camera = fj.look_at((0, 0, 2), (0, 0, 0), width=640, height=480, focal_length=0.05)
start = fj.thin_lens(focus_distance=2.0, f_number=2.8, focal_length=0.05)
points = fj.locate(
    [
        fj.FocusPoint(fj.AtPoint((0, 0, 0)), fj.Sharp(), name="face"),
        fj.FocusPoint(fj.AtPoint((0.1, 0, 0.2)), fj.Blur(-1.5, signed=True), name="hand"),
        fj.FocusPoint(fj.AtPoint((-0.4, 0, -3)), fj.Blur(8.0, signed=True), weight=4, name="sign"),
    ],
    camera,
)


def stops_off(sign_disparity, _):
    """How many stops the solved f-number is from f/2 when the sign hangs at a disparity (1/m)."""
    moved = dataclasses.replace(points, disparity=points.disparity.at[2].set(sign_disparity))
    lens = fj.solve(moved, camera, start, free=("focus", "f_number")).lens
    return 2 * jnp.log2(lens.f_number(camera) / 2.0)


found = optx.root_find(stops_off, optx.Newton(rtol=1e-4, atol=1e-4), points.disparity[2]).value
print(f"Hang the sign {1 / float(found):.2f} m from the camera.")
