"""How does the picture change with a wish? One gradient from a wanted blur, through the solve, to the pixels.

The lens is solved for a sharp pawn and a lamp with a wanted blur; the picture is rendered through it; and the
derivative of the lamp's mean brightness by the wanted blur goes through all of it in one compiled function.
What stays outside is looking at the scene: what shows is known while the function compiles, `peel` comes
first, and the layers serve every lens whose rays they hold.
"""

import jax
import jax.numpy as jnp

import focusjax as fj

MESHES = "configs/meshes/still_life"
pawn = fj.load_mesh(f"{MESHES}/pawn.ply", translate=(-0.05, 0, 0.1))
lamp = fj.load_mesh(f"{MESHES}/lamp_globe.ply", translate=(0.06, 0.06, -0.8), emission=0.8)
scene = fj.make_scene([pawn, lamp], ambient=0.4, lights=[fj.directional_light((-1, -2, -1))])
camera = fj.look_at((0, 0.1, 0.6), (0, 0.04, 0), width=96, height=72, focal_length=0.05)
disparity = fj.disparity_map(scene, camera)
start = fj.thin_lens(focus_distance=0.6, f_number=4, focal_length=0.05)
widest = fj.thin_lens(focus_distance=0.5, f_number=1.4, focal_length=0.05)
layers = fj.peel(scene, camera, widest)
beside = jnp.zeros((72, 96)).at[10:40, 50:90].set(1.0)


@jax.jit
def brightness(blur: jax.Array) -> jax.Array:
    """Mean square radiance around the lamp, for a wanted blur of its in pixels."""
    wishes = [
        fj.FocusPoint(fj.OnObject("pawn"), fj.Sharp()),
        fj.FocusPoint(fj.OnObject("lamp_globe"), fj.Blur(blur)),
    ]
    points = fj.find_points(wishes, scene, camera, disparity=disparity)
    lens = fj.solve(points, camera, start, free=("focus", "f_number")).lens
    picture = fj.render(layers, lens, rays=64)
    return (picture.mean(axis=-1) ** 2 * beside).sum() / beside.sum()


at, step = jnp.asarray(4.0), 0.5
value, slope = jax.value_and_grad(brightness)(at)
difference = (brightness(at + step) - brightness(at - step)) / (2 * step)
print(f"{float(value):.4f}, changing by {float(slope):.5f} per pixel of wanted blur")
print(f"by differences: {float(difference):.5f}")
