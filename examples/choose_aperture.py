"""Which aperture keeps a sign readable and the railings behind it below a fifth of their contrast?

The sign hangs at an angle, so that a wide opening blurs its ends as well. Contrast is that of rendered
pictures, relative to a picture without blur; Newton's method finds the opening with the derivative of the
picture, which knows what appears and disappears behind the sign's edges.
"""

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

import focusjax as fj
from focusjax.scene import make_object

WANTED = 0.2
READABLE = 0.8


def stripes(name, x, y, z, count):
    """Upright bars, light and dark in turn, from x[0], z[0] to x[1], z[1] in metres."""
    share = np.linspace(0, 1, count + 1)
    at = np.stack([x[0] + share * (x[1] - x[0]), 0 * share, z[0] + share * (z[1] - z[0])], axis=1)
    low, high = (at + np.array([0, edge, 0]) for edge in y)
    corners = np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1).reshape(-1, 3)
    faces = (4 * np.arange(count)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    light = np.repeat(0.1 + 0.8 * (np.arange(count) % 2), 4)[:, None] * np.ones(3)
    return make_object(name, corners, faces, vertex_colours=light)


sign = stripes("sign", (-0.24, 0.24), (-0.2, 0.0), (-1.35, -1.65), 16)
railings = stripes("railings", (-1.2, 1.2), (0.0, 1.0), (-4.0, -4.0), 40)
scene = fj.make_scene([sign, railings], unlit=True)
camera = fj.look_at((0, 0, 0), (0, 0, -1), width=72, height=54, focal_length=0.085)
subject, behind = np.zeros((54, 72), bool), np.zeros((54, 72), bool)
subject[30:48, 10:62], behind[4:20, 6:66] = True, True

widest = fj.thin_lens(focus_distance=1.5, f_number=1.0, focal_length=0.085)
layers = fj.peel(scene, camera, widest)


def picture(radius):
    return fj.render(layers, fj.ThinLens(widest.focus_disparity, radius), even=True, rays=32)


def contrast(image, region):
    """Standard deviation over the mean, of a region."""
    shown = image[region]
    return shown.std() / shown.mean()


sharp = picture(jnp.zeros(()))


@jax.jit
def excess(log_radius, _):
    """How far the railings' contrast is from what is wanted, as a logarithm."""
    left = contrast(picture(jnp.exp(log_radius)), behind) / contrast(sharp, behind)
    return jnp.log(left / WANTED)


largest = jnp.log(widest.aperture_radius)
limits = {"lower": largest - 3.0, "upper": largest}
found = optx.root_find(excess, optx.Newton(rtol=1e-3, atol=1e-3), largest - 0.7, options=limits)
radius = jnp.exp(found.value)
image = picture(radius)
kept = [float(contrast(image, region) / contrast(sharp, region)) for region in (subject, behind)]
print(
    f"at f/{float(camera.focal_length / (2 * radius)):.2f} the railings keep {kept[1]:.3f} of their contrast"
)
print(f"the sign keeps {kept[0]:.2f} of its own:", "readable" if kept[0] >= READABLE else "not readable")
