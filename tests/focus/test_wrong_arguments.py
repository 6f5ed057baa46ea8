"""What people give by mistake is refused in words, where nobody checks types."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

SETUP = """
import json, sys
import jax.numpy as jnp
import focusjax as fj
from focusjax.focus import fit_focal_plane, stacked
camera = fj.look_at((0, 0, 0), (0, 0, -1), width=64, height=48, focal_length=0.05)
lens = fj.thin_lens(focus_distance=2.0, f_number=4.0, focal_length=0.05)
wish = fj.FocusPoint(fj.AtPoint((0, 0, -2)), fj.Sharp(), name="nose")
points = fj.locate([wish], camera)
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
    "fj.Blur('0.1mm')": "a diameter is '0.1mm'; expected a number of pixels, such as 8.0, or OnSensor",
    "fj.FocusPoint(wish.where, fj.Sharp(), weight='1')": "a focus point has weight '1'; expected zero or",
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
    "fj.solve(points, camera, lens, method=['jaxopt'])": "method is ['jaxopt']; expected one of",
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
