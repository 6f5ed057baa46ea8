"""Which focus and f-number made this picture?

The picture is cast ray by ray at the triangles themselves, by Embree, as a stand-in for a photograph of a
scene whose geometry is known; that shares no code with what looks for the lens. It needs embreex.
"""

import focusjax as fj
from focusjax.baselines import lens_picture

spot = fj.load_mesh("configs/meshes/spot.glb", name="spot", rotate=(0, 160, 0), scale=0.08)
lamp = fj.load_mesh("configs/meshes/still_life/lamp_globe.ply", translate=(0.1, 0.1, -0.8), emission=3)
table = fj.load_mesh("configs/meshes/still_life/table.glb")
scene = fj.make_scene([spot, lamp, table], ambient=0.3, lights=[fj.directional_light((-1, -2, -1))])
camera = fj.look_at((0, 0.1, 0.6), (0, 0, 0), width=96, height=72, focal_length=0.05)

true = fj.thin_lens(focus_distance=0.9, f_number=1.4, focal_length=0.05)
photograph = 0.8 * lens_picture(scene, camera, true, rays=64)

# Any focus from 40 cm to infinity at f/1 or less is looked for.
layers = fj.peel(scene, camera, fj.widest_lens(camera, min_focus_distance=0.4, f_number=1.0))
start = fj.thin_lens(focus_distance=1.5, f_number=4, focal_length=0.05)
fit = fj.fit_image(photograph, layers, start, free=("focus", "f_number", "gain"), min_focus_distance=0.4)

error = fit.standard_errors
print(f"focus distance: {float(true.focus_distance()):.4f} m, found {float(fit.lens.focus_distance()):.4f} m")
print(f"f-number: {float(true.f_number(camera)):.3f}, found", end=" ")
print(f"{float(fit.lens.f_number(camera)):.3f} ± {error['f_number']:.3f}")
print(f"gain: 0.8, found {fit.gain:.4f} ± {error['gain']:.4f}")
