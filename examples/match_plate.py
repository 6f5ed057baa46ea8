"""Make one camera blur like another: a lens for computer graphics that are to go into a plate.

The plate was shot with a large sensor; ours is half as large, with half the focal length, and frames the
same. What is known is the set: its table and its lamp. Which focus and f-number of ours blur like the plate?
The plate is cast ray by ray at the triangles, by Embree, which shares no code with what looks for the lens.
"""

import focusjax as fj
from focusjax.baselines import lens_picture

lamp = fj.load_mesh("configs/meshes/still_life/lamp_globe.ply", translate=(0.1, 0.1, -0.8), emission=3)
table = fj.load_mesh("configs/meshes/still_life/table.glb")
near = fj.load_mesh("configs/meshes/still_life/jug.ply", translate=(-0.1, 0, 0.1))
light = fj.directional_light((-1, -2, -1))
room = fj.make_scene([table, lamp, near], ambient=0.3, lights=[light])


def camera(scale: float) -> fj.Camera:
    """The frame of both cameras, with 50 mm on 36 mm times `scale`."""
    return fj.look_at(
        (0, 0.1, 0.6), (0, 0, 0), width=72, height=54, focal_length=0.05 * scale, sensor_width=0.036 * scale
    )


theirs = fj.thin_lens(focus_distance=0.7, f_number=2.0, focal_length=0.05)
plate = lens_picture(room, camera(1.0), theirs, rays=64)

ours = camera(0.5)
# Two samples a pixel: in so small a picture much that is sharp is smaller than one.
layers = fj.peel(room, ours, fj.widest_lens(ours, min_focus_distance=0.4, f_number=0.7), supersampling=2)
start = fj.thin_lens(focus_distance=1.5, f_number=4, focal_length=0.025)
fit = fj.fit_image(plate, layers, start, rays=32)
print(f"focus at {float(fit.lens.focus_distance()):.3f} m (theirs {float(theirs.focus_distance()):.3f} m)")
print(f"f/{float(fit.lens.f_number(ours)):.2f} (theirs f/2.00 on twice the sensor, which is f/1.00 on ours)")

# Spot, who was not there, blurs as the plate does.
spot = fj.load_mesh("configs/meshes/spot.glb", name="spot", rotate=(0, 160, 0), scale=0.05)
filled = fj.make_scene([table, lamp, near, spot], ambient=0.3, lights=[light])
fj.save_png("matched.png", fj.render(fj.peel(filled, ours, fit.lens), fit.lens, rays=32))
