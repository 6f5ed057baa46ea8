"""What people give by mistake is refused in words, where nobody checks types."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

SETUP = """
import json, sys
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import focusjax as fj
from focusjax import lens as L, optics as O, scene as S
from focusjax.focus import Prior, fit_focal_plane, solve_frames, stacked
from focusjax.layers import missed_light
from focusjax.optics import lens_preset
from focusjax.shutter import make_shutter
glass = O.find_glass("N-BK7")
camera = fj.look_at((0, 0, 0), (0, 0, -1), width=64, height=48, focal_length=0.05)
lens = fj.thin_lens(focus_distance=2.0, f_number=4.0, focal_length=0.05)
wish = fj.FocusPoint(fj.AtPoint((0, 0, -2)), fj.Sharp(), name="nose")
points = fj.locate([wish], camera)
corners = [(0, 0, -2), (1, 0, -2), (0, 1, -2)]
pane = S.make_object("pane", corners, [(0, 1, 2)])
scene = S.make_scene([pane], unlit=True)
layers = fj.peel(scene, camera, lens, supersampling=1)
def with_focus(value):
    return eqx.tree_at(lambda lens: lens.focus_disparity, lens, value)
def with_radius(value):
    return eqx.tree_at(lambda lens: lens.aperture_radius, lens, value)
tilted_by_nan = L.TiltShiftLens(jnp.full(3, jnp.nan), lens.aperture_radius)
said = {}
for call in json.load(sys.stdin):
    try:
        eval(call)
        said[call] = "nothing"
    except Exception as error:
        said[call] = f"{type(error).__name__}: {error}"
print(json.dumps(said))
"""

CALLS = {
    "fj.solve(points, camera, lens, free=('focus', 'f_number'), priors={'f_number': 8})": (
        "the prior of f_number is the number 8; expected a Prior with a value and a sigma"
    ),
    "fj.locate(wish, camera)": "points of locate(points, camera) is one FocusPoint; put it into a list",
    "fj.locate([fj.Sharp()], camera)": "points.0 of locate(points, camera) is a Sharp; expected a FocusPoint",
    "fj.camera_settings(f_number=2, time='1/60')": "shutter time is '1/60'; expected seconds, such as 1 / 60",
    "make_shutter('1/60')": "the shutter's time is '1/60'; expected a number, such as 0.02",
    "fj.develop(jnp.ones((2, 2, 3)), fj.film_preset('plain'), balance=[1, 2])": (
        "the white balance is [1.0, 2.0]; expected a gain above 0 for red, green and blue"
    ),
    "fj.Blur('0.1mm')": "a diameter is '0.1mm'; expected a number of pixels, such as 8.0, or OnSensor",
    "fj.FocusPoint(wish.where, fj.Sharp(), weight='1')": "the weight of a focus point is '1'; expected zero",
    "L.prescription_lens(lens_preset('cooke_triplet_50mm_f4'), camera, focus_distance=2, aperture=6)": (
        "aperture of prescription_lens(aperture=) is the number 6; expected AbstractAperture: `polygon`"
    ),
    "fj.locate([wish], lens)": "camera of locate(points, camera) is a ThinLens; expected Camera: `look_at`",
    "fj.find_points(wish, camera, camera)": "scene of find_points(wishes, scene, camera) is a Camera;",
    "fj.solve([wish], camera, lens)": (
        "points of solve(points, camera, lens) is a list of FocusPoint; expected ImagePoints: `find_points`"
    ),
    "fj.solve(points, lens, camera)": "camera of solve(points, camera, lens) is a ThinLens; expected Camera",
    "fj.solve(points, camera, camera)": "lens of solve(points, camera, lens) is a Camera; expected ThinLens",
    "fj.solve(stacked([points, points]), camera, lens)": "are many sets of wishes; expected one: `solve",
    "fj.solve_many(points, camera, lens)": "are one set of wishes; expected many: `stacked` puts several",
    "fj.solve_frames(points, camera, lens)": "is an ImagePoints; expected a list of them, one for each frame",
    "fj.solve_frames([points], lens, camera)": "cameras of solve_frames(points, cameras, lenses) is a Thin",
    "fj.solve_focal_surface(points, camera, lens, lens)": "is a ThinLens; expected FocalSurface: ",
    "fj.diagnose(lens)": "solution of diagnose(solution) is a ThinLens; expected Solution or SurfaceSolution",
    "fit_focal_plane(points.xy, points.disparity, lens, camera)": "camera of fit_focal_plane",
    "fj.solve(points, camera, lens, free='focs')": "free parameters are ['focs']; did you mean 'focus'?",
    "fj.solve(points, camera, lens, free=3)": "free is 3; expected names, some of ['focus', 'f_number'",
    "fj.solve(points, camera, lens, solver='jaxopt')": "solver is the text 'jaxopt'; expected a solver",
    "fj.solve(points, camera, lens, max_steps='3')": "max_steps is '3'; expected a whole number, at least 1",
    "fj.solve(points, camera, lens, free=('aperture',))": "expected some of ['focus', 'f_number'",
    "fj.solve(points, camera, lens, tilt_range=(0, 0.1))": (
        "tilt_range is given, but tilt is not free, so that it would limit nothing; add 'tilt' to free"
    ),
    "fj.solve(points, camera, lens, keep_field_of_view=True)": "keep_field_of_view is given, but",
    "fj.solve(points, camera, lens, free='f_number', f_number_range=8)": (
        "f_number_range is 8; expected two numbers, the least and the most"
    ),
    "fj.solve(points, camera, lens, min_focus_distance=jnp.float32(0.007))": (
        "minimum focus distance in metres is 0.007; expected a finite distance beyond"
    ),
    "fj.solve(points, camera, lens, free='f_number', f_number_range=('1', 8))": (
        "the f-number range's start is '1'; expected a positive number such as 1.4"
    ),
    "fj.solve(points, camera, lens, min_focus_distance='1')": (
        "minimum focus distance in metres is '1'; expected a finite distance beyond"
    ),
    "fj.solve(points, camera, lens, min_focus_distance=True)": "in metres is True; expected a finite",
    "solve_frames([points], camera, lens, smoothness='1')": "smoothness is '1'; expected zero or a positive",
    "Prior(None, sigma=1)": "a prior's value is None; expected a number",
    "Prior(2.0, sigma='1')": "a prior's sigma is '1'; expected a positive finite number",
    "fj.locate([wish], camera, favour_near='1')": "favour_near is '1'; expected zero or a positive finite",
    "fj.AtPixel('3', 4)": "x of a focus point's pixel is '3'; expected a number of pixels",
    "fj.AtPixel(3, None)": "y of a focus point's pixel is None; expected a number of pixels",
    "fj.locate([fj.FocusPoint(fj.AtPoint('012'), fj.Sharp())], camera)": "position is '012'; expected three",
    "fj.OnObject('pane', samples='4')": "the number of samples of object 'pane' is '4'; expected a whole",
    "fj.OnObject(5)": "an object's name is 5; expected the text it has in the scene",
    "fj.OnMask(np.ones((48, 64)))": "a mask is a ndarray; expected an array of True and False, one for each",
    "fj.OnTriangle('0', (1, 0, 0))": "a triangle's face is '0'; expected its row in the scene's faces",
    "fj.InDepthRange('1', 2)": "the depth range's start is '1'; expected a distance in metres such as 2.0",
    "fj.Blur(None)": "a diameter is None; expected a number of pixels, such as 8.0, or OnSensor",
    "fj.FocusPoint(wish.where, fj.Sharp(), tolerance=[1, 2])": "a diameter is [1, 2]; expected a number of",
    "fj.FocusPoint(wish.where, fj.Sharp(), weight=True)": "the weight of a focus point is True; expected",
    "fj.thin_lens(focus_distance='2', aperture_radius=0.01)": (
        "focus distance in metres is '2'; expected a positive distance or infinity"
    ),
    "fj.thin_lens(focus_distance=2, f_number=4, focal_length=np.ones(2))": (
        "focal length in metres is array([1., 1.]); expected a positive length"
    ),
    "fj.thin_lens(focus_distance=2, aperture_radius=0.01, aperture='disk')": (
        "aperture of thin_lens(aperture=) is the text 'disk'; expected AbstractAperture: `polygon`"
    ),
    "L.tilt_shift_lens(focus_distance=2, focal_length=0.05, f_number=4, tilt='0.1')": (
        "tilt in radians is '0.1'; expected an angle between -pi/2 and pi/2"
    ),
    "L.polygon(float('nan'))": "an aperture has nan blades; expected a whole number, at least 3",
    "L.obstructed([0.3])": "obstruction is [0.3]; expected a share of the diameter between 0 and 1",
    "L.depth_of_field_lens(camera, '1', 2)": "the near end of what is to be sharp is '1'; expected a dist",
    "L.depth_of_field_lens(camera, 1, 2, f_number_range=8)": "f_number_range is 8; expected two numbers",
    "L.chromatic_lens(lens, focus_offset=0.1)": "focus offset is 0.1; expected finite numbers for red",
    "L.chromatic_lens(lens, bands='3')": "bands is '3'; expected a whole number, at least 1",
    "L.focal_surface([(1, 1)], ['0.5'])": "control points' focus disparity is ['0.5']; expected one number",
    "L.focal_surface([(1, 1), (2,)], 0.5)": "control points is [(1, 1), (2,)]; expected k rows of (x, y)",
    "L.height_curve([0, 1], [None, 1])": "values of the table is [None, 1]; expected finite numbers, one",
    "O.singlet('50', -50, thickness=5, semi_diameter=9, glass=glass)": (
        "the front radius of singlet is '50'; expected a length in mm, or inf for a plane"
    ),
    "O.singlet(50, None, thickness=5, semi_diameter=9, glass=glass)": "the back radius of singlet is None;",
    "O.singlet(50, -50, thickness='5', semi_diameter=9, glass=glass)": "the thickness of singlet is '5';",
    "O.singlet(50, -50, thickness=5, semi_diameter=[9], glass=glass)": "the semi-diameter of singlet is [9];",
    "O.singlet(50, -50, thickness=5, semi_diameter=9, glass='N-BK7')": (
        "glass=) is the text 'N-BK7'; expected AbstractGlass: `find_glass"
    ),
    "S.make_object('n', corners, [(0, 1, 2)], opacity='0.5')": "opacity of object 'n' is '0.5'; expected a",
    "S.make_object('n', corners, [(0, 1, 2)], opacity=True)": "opacity of object 'n' is True; expected a num",
    "S.make_object('n', corners, [(0, 1, 2)], shininess='9')": "shininess is '9'; expected a finite Phong",
    "S.make_object('n', corners, [(0, 1, 2)], scale='2')": "scale is '2'; expected 1 or 3 finite numbers",
    "S.make_object('n', corners, [(0, 1, 1.5)])": "faces of object 'n' are not all whole numbers",
    "S.make_scene(pane)": "objects of make_scene(objects, lights=, background=) is a SceneObject; expected",
    "S.make_scene([pane], lights=['sun'])": "is the text 'sun'; expected AbstractLight: `directional_light`",
    "S.point_light('top')": "the position of a point light is 'top'; expected three finite numbers",
    "fj.decompose(scene, camera, lens, blur_step='4')": "blur_step in pixels is '4'; expected a positive",
    "fj.decompose(scene, camera, lens, count='3')": "count is '3'; expected a whole number, at least 1",
    "fj.peel(scene, lens, camera)": "camera of layers of (scene, camera, lens) is a ThinLens; expected Cam",
    "fj.peel(scene, camera, lens, near='1')": "near is '1'; expected a positive depth in metres, or None",
    "fj.peel(scene, camera, lens, supersampling=None)": "supersampling is None; expected a whole number, at",
    "fj.peel(scene, camera, lens, umbra='no')": "umbra is 'no'; expected True or False",
    "fj.peel(scene, camera, lens, pixel_filter=['box'])": "pixel_filter is ['box']; expected one of box, t",
    "fj.render(lens, layers)": "layers of (layers, lens) is a ThinLens; expected Layers: `peel` and `dec",
    "fj.render(layers, camera)": "lens of (layers, lens) is a Camera; expected AbstractLens: `thin_lens`",
    "fj.render(layers, lens, smooth='no')": "smooth is 'no'; expected True or False",
    "fj.render(layers, lens, seed=-1)": "ArgumentError: seed is -1; expected a whole number from 0 to 4",
    "fj.render(layers, lens, rays=10**7)": "ArgumentError: rays is 10000000; at 64 x 48 pixels expected at m",
    "fj.render(layers, lens, even=True, derivative_rays=10**7)": "ArgumentError: derivative_rays is 10000",
    "fj.render(layers, lens, pixel_filter='bx')": "ArgumentError: pixel_filter is 'bx'; expected one of box",
    "fj.render(layers, lens, pixel_filter='tent')": "ArgumentError: rays start up to 1 pixels from their pix",
    "fj.render(layers, lens, devices=0)": "ArgumentError: devices are 0; expected at least one, each",
    "fj.render(layers, lens, devices=['cpu'])": "ArgumentError: devices are ['cpu']; expected at least one",
    "fj.render(layers, with_focus('0.5'))": "ArgumentError: focus_disparity of the lens is the text '0.5'",
    "fj.render(layers, with_focus(None))": "ArgumentError: focus_disparity of the lens is a NoneType; exp",
    "fj.render(layers, with_focus(np.nan))": "ArgumentError: focus_disparity of the lens is nan; expected",
    "fj.render(layers, with_focus(-0.1))": "ArgumentError: focus_disparity of the lens is -0.1; expected",
    "fj.render(layers, with_radius(-0.001))": "ArgumentError: aperture_radius of the lens is -0.001; expe",
    "fj.render(layers, with_radius(1.0))": "ArgumentError: the lens moves rays by 88.89 pixels per dioptr",
    "fj.render(layers, tilted_by_nan)": "ArgumentError: plane of the lens is not a number in places; expe",
    "fj.render(layers, with_focus(jnp.ones(2)))": (
        "ArgumentError: focus_disparity of the lens has the shape (2,), as of several lenses; expected one"
    ),
    "jax.jit(lambda r: fj.render(layers, with_radius(r)))(jnp.ones(2))": (
        "ArgumentError: aperture_radius of the lens has the shape (2,), as of several lenses; expected one"
    ),
    "fj.render(eqx.filter_vmap(lambda _: layers)(jnp.ones(2)), lens)": "ArgumentError: layers are several, s",
    "jax.jit(lambda r: fj.render(layers, with_radius(r), pixel_filter='tent'))(0.001)": (
        "ArgumentError: rays start up to 1 pixels from their pixel's centre"
    ),
    "jax.jit(lambda r: fj.peel(scene, camera, with_radius(r)).cells)(0.001)": (
        "ArgumentError: layers of (scene, camera, lens) are made within a function that JAX compiles, maps or"
        " differentiates, but how much they hold has to be known; make them outside of it"
    ),
    "jax.jit(lambda r: fj.decompose(scene, camera, with_radius(r), count=2).cells)(0.001)": (
        "ArgumentError: layers of (scene, camera, lens) are made within a function that JAX compiles"
    ),
    "jax.jit(lambda: fj.peel(scene, camera, lens).cells)()": "ArgumentError: layers of (scene, camera, lens)",
    "jax.grad(lambda r: fj.peel(scene, camera, with_radius(r)).background[0])(0.001)": "ArgumentError: la",
    "fj.peel(scene, camera, with_focus(np.nan))": "focus_disparity of the lens is nan; expected a finite num",
    "fj.peel(scene, camera, with_radius(np.nan))": "ArgumentError: aperture_radius of the lens is nan; exp",
    "fj.AtMost(-1)": "largest wished blur is -1.0 px; a limit is not negative, as it holds on both sides",
    "fj.plan_rays(layers, lens, 40, smooth=None)": "smooth is None; expected True or False",
    "fj.FocusPoint(wish.where, fj.Sharp(), even_hidden='no')": "even_hidden is 'no'; expected True or False",
    "fj.Blur(3.0, signed='no')": "signed is 'no'; expected True or False",
    "missed_light(layers, layers)": (
        "nearest of missed_light(layers, nearest) is a Layers; expected a function from lens rays to the"
        " disparities that they meet, such as nearest_in_layers(layers) of other layers"
    ),
    "missed_light(scene, layers)": "layers of missed_light(layers, nearest) is a Scene; expected Layers",
}


@pytest.fixture(scope="module")
def said():
    """What each call says, in a process of its own without type checks."""
    done = subprocess.run(
        [sys.executable, "-c", SETUP],
        input=json.dumps(list(CALLS)),
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("call", CALLS)
def test_wrong_arguments_are_refused_in_words(said, call):
    assert said[call].startswith(("ArgumentError: ", "ValueError: "))
    assert CALLS[call] in said[call]
