"""What is written for pbrt means, by pbrt's own rules, the camera that it was written for."""

import math
import re
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from exchange_cameras import HEIGHT, WIDTH, projected, round_lens, slid_camera, world_points

import focusjax as fj
from focusjax.exchange import ExportError
from focusjax.lens import prescription_lens
from focusjax.optics import first_order, lens_preset, load_lens, opened_to, pbrt_lens_text

TRIPLET = "cooke_triplet_50mm_f4"


def parsed(path):
    """The kind of camera, the matrix camera_from_world, and the parameters, of a file."""
    text = re.sub(r"#.*", "", path.read_text())
    values = {
        name: [float(v) for v in numbers.split()] if kind != "string" else numbers.strip(' "')
        for kind, name, numbers in re.findall(r'"(float|integer|string) (\w+)" \[([^\]]*)\]', text)
    }
    columns = re.search(r"Transform \[([^\]]*)\]", text).group(1).split()
    # The file holds columns.
    return re.search(r'Camera "(\w+)"', text).group(1), np.array(columns, float).reshape(4, 4).T, values


def in_camera(matrix, points):
    return points @ matrix[:3, :3].T + matrix[:3, 3]


@pytest.mark.parametrize("size", [(WIDTH, HEIGHT), (HEIGHT, WIDTH)])
def test_points_are_where_pbrt_projects_them(tmp_path, size):
    camera = slid_camera(width=size[0], height=size[1])
    fj.export_camera(camera, round_lens(), tmp_path / "c.pbrt", to="pbrt")
    kind, matrix, values = parsed(tmp_path / "c.pbrt")
    assert kind == "perspective"
    x, y, z = in_camera(matrix, world_points()).T
    scale = 1 / math.tan(math.radians(values["fov"][0]) / 2)
    left, right, bottom, top = values["screenwindow"]
    across = (scale * x / z - left) / (right - left) * size[0]
    down = (top - scale * y / z) / (top - bottom) * size[1]
    np.testing.assert_allclose(np.stack([across, down], axis=1), projected(camera, world_points()), atol=1e-9)
    assert values["lensradius"][0] == pytest.approx(0.05 / 3.6)
    assert values["focaldistance"][0] == pytest.approx(1.3)
    assert values["xresolution"] == [size[0]]


def glass_lens(camera, **changes):
    return prescription_lens(lens_preset(TRIPLET), camera, focus_distance=1.5, f_number=5.6, **changes)


def focused_by_pbrt(lens_file, distance):
    """Where pbrt puts the film, in mm from the last vertex: it moves a lens whose film is the file's.

    As its source says: delta = (p + q - sqrt((p - q) (p - q - 4 f))) / 2, p and q from the film to the
    principal planes on the scene's side (counted to the focus) and on the film's.
    """
    rows = [[float(v) for v in row.split("#")[0].split()] for row in lens_file.read_text().splitlines()]
    film, length = [row for row in rows if row][-1][1], sum(row[1] for row in rows if row)
    seen = first_order(load_lens(lens_file))
    f = float(seen.focal_length)
    front = 1000 * distance - (length - float(seen.front_principal_plane))
    rear = -(film - float(seen.rear_principal_plane))
    root = math.sqrt((front - rear) * (front - rear - 4 * f))
    return film + (front + rear - root) / 2


def test_a_real_lens_is_its_prescription(tmp_path):
    camera = fj.look_at((0.2, 0.3, 1.2), (0, 0, 0), width=WIDTH, height=HEIGHT, focal_length=0.05)
    lens = glass_lens(camera)
    exported = fj.export_camera(camera, lens, tmp_path / "c.pbrt", to="pbrt")
    assert [file.name for file in exported.files] == ["c.pbrt", "c.dat"]
    kind, matrix, values = parsed(tmp_path / "c.pbrt")
    assert (kind, values["lensfile"]) == ("realistic", "c.dat")
    read, written = load_lens(tmp_path / "c.dat"), lens.prescription
    np.testing.assert_allclose(read.thicknesses[:-1], written.thicknesses[:-1])
    np.testing.assert_allclose(read.semi_diameters, written.semi_diameters)
    assert float(first_order(read).focal_length) == pytest.approx(float(first_order(written).focal_length))
    assert values["aperturediameter"][0] == pytest.approx(2 * float(written.semi_diameters[written.stop]))
    # pbrt leaves the film where it is: observed 1e-11 mm.
    film = focused_by_pbrt(tmp_path / "c.dat", values["focusdistance"][0])
    assert film == pytest.approx(float(lens.film_place), abs=1e-6)
    # Its camera stands on the film: the entrance pupil, where ours stands, is as far ahead as glass and film.
    ahead = in_camera(matrix, np.asarray(camera.position)[None])[0]
    total = float(np.sum(written.thicknesses[:-1])) + float(lens.film_place - lens.entrance_pupil)
    np.testing.assert_allclose(ahead, (0, 0, total / 1000), atol=1e-9)
    # What is seen a pixel off the axis falls one pixel from the middle of the film.
    pixel = values["diagonal"][0] / math.hypot(WIDTH, HEIGHT)
    assert pixel == pytest.approx(float(lens.film_scale) / float(camera.focal_px))


def test_a_lens_of_aspheres_or_flat_glass_is_refused():
    lens = opened_to(lens_preset(TRIPLET), 5.6)
    flat = replace(lens.surfaces[0], curvature=jnp.zeros(()))
    with pytest.raises(ValueError, match=r"surface 0 of .* is flat, and pbrt takes flat surfaces for"):
        pbrt_lens_text(replace(lens, surfaces=(flat, *lens.surfaces[1:])), 40.0)
    conic = replace(lens.surfaces[0], conic=jnp.ones(()))
    with pytest.raises(ValueError, match=r"surface 0 of .* is not spherical"):
        pbrt_lens_text(replace(lens, surfaces=(conic, *lens.surfaces[1:])), 40.0)


def test_a_real_lens_is_refused_elsewhere_or_idealised(tmp_path):
    camera = fj.look_at((0, 0, 1.2), (0, 0, 0), width=WIDTH, height=HEIGHT, focal_length=0.05)
    lens = glass_lens(camera)
    with pytest.raises(ExportError, match=r"USD cannot express a real lens \(.*\); export to pbrt, which"):
        fj.export_camera(camera, lens, tmp_path / "c.usda", to="usd")
    made = fj.export_camera(camera, lens, tmp_path / "c.usda", to="usd", approximate=True)
    assert made.record.frames[0].f_number == pytest.approx(5.6, rel=1e-3)
    assert 0.0 < made.blur_error_px < 5.0
