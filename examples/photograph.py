"""How should a room be photographed by hand, so that everything from 0.9 to 1.3 m is sharp?

The widest aperture that has that depth of field, the longest time that a hand holds, and the speed that is
left to choose. Then the same negative is printed, and the settings are found again from the print.
"""

import focusjax as fj

spot = fj.load_mesh("configs/meshes/spot.glb", rotate=(0, 160, 0), scale=0.16)
scene = fj.make_scene([spot], ambient=0.3, lights=[fj.directional_light((-1, -2, -1))])
camera = fj.look_at((0, 0.1, 1.1), (0, 0, 0), width=96, height=72, focal_length=0.035)

lens = fj.depth_of_field_lens(camera, near=0.9, far=1.3)
radiance = fj.render(fj.peel(scene, camera, lens), lens, rays=32)

luminance = fj.luminance_of_light_value(7)
settings = fj.settings_through(lens, camera, time=1 / 60)
chosen = fj.choose_settings(fj.meter(radiance, "centre"), settings, luminance=luminance, longest_time=1 / 60)
settings = chosen.settings
print(
    f"focus {float(lens.focus_distance()):.2f} m, f/{float(settings.f_number):.1f},"
    f" 1/{1 / float(settings.time):.0f} s, ISO {float(settings.iso):.0f},"
    f" {float(chosen.stops_off):+.1f} stops off"
)

film = fj.film_preset("negative", rms_granularity=6)
shown = fj.photograph(radiance, settings, film, luminance=luminance, seed=0)
fj.save_png("photograph.png", shown)

start = fj.settings_through(lens, camera, time=settings.time, iso=100)
fit = fj.fit_settings(shown, radiance, start, film, luminance=luminance, free=("iso",))
print(f"the print was exposed at ISO {float(fit.settings.iso):.0f}")
