import focusjax as fj

spot = fj.load_mesh("configs/meshes/spot.glb", name="spot", rotate=(0, 160, 0), scale=0.08)
lamp = fj.load_mesh("configs/meshes/still_life/lamp_globe.ply", translate=(0.1, 0.1, -0.8), emission=3)
scene = fj.make_scene([spot, lamp], ambient=0.3, lights=[fj.directional_light((-1, -2, -1))])
camera = fj.look_at((0, 0.1, 0.6), (0, 0, 0), width=640, height=480, focal_length=0.05)
wishes = [
    fj.FocusPoint(fj.AtPixel(290, 190), fj.Sharp()),
    fj.FocusPoint(fj.OnObject("lamp_globe"), fj.Blur(24)),
]
points = fj.find_points(wishes, scene, camera)
start = fj.thin_lens(focus_distance=1.0, f_number=2.8, focal_length=0.05)
lens = fj.solve(points, camera, start, free=("focus", "f_number")).lens
image = fj.render(fj.peel(scene, camera, lens), lens, rays=64)
fj.save_png("spot.png", image)
