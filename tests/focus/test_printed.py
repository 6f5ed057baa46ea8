"""What `print` says of a solution: settings, how the wishes are met, and what is in the way."""

import dataclasses
import xml.etree.ElementTree

import jax
import jax.numpy as jnp
import pytest

from focusjax.focus import (
    AtLeast,
    AtPoint,
    FocusPoint,
    Sharp,
    locate,
    solve,
    solve_focal_surface,
    solve_frames,
    solve_many,
    stacked,
)
from focusjax.geometry import make_camera
from focusjax.lens import focal_surface, thin_lens


@pytest.fixture
def asked():
    camera = make_camera(jnp.eye(4), width=640, height=480, focal_length=0.05)
    wishes = [
        FocusPoint(AtPoint((0, 0, -2)), Sharp(), name="nose"),
        FocusPoint(AtPoint((0, 0, -4)), AtLeast(30.0), name="wall"),
    ]
    return locate(wishes, camera), camera, thin_lens(focus_distance=3.0, f_number=2.0, focal_length=0.05)


def test_settings_wishes_and_what_is_in_the_way(asked):
    lines = str(solve(*asked)).splitlines()
    assert lines[0].startswith("Focus 95.2 cm")
    assert lines[0].endswith(", f/2.0, 50 mm")
    assert lines[1].split() == ["focus", "point", "wished", "result", "off", "by", "verdict"]
    assert [line.split()[0] for line in lines[2:4]] == ["nose", "wall"]
    assert lines[3].split()[1:4] == ["at", "least", "30"]
    assert all(line.endswith("missed") for line in lines[2:4])
    assert any("pull against each other" in line for line in lines[4:])


def test_notebooks_show_the_same_as_a_table(asked):
    points, camera, lens = asked
    names = ("<b>nose</b>", *points.names[1:])
    shown = solve(dataclasses.replace(points, names=names), camera, lens)._repr_html_()
    page = xml.etree.ElementTree.fromstring(shown)
    assert [cell.text for cell in page.iter("td")][::5] == ["<b>nose</b>", "wall"]
    said = [line.text for line in page.iter("p")]
    assert any("pull against each other" in line for line in said if line)
    assert "3 frames" in solve_frames([points] * 3, camera, lens)._repr_html_()


def test_a_focal_surface_says_how_wishes_are_met(asked):
    _, camera, lens = asked
    points = locate([FocusPoint(AtPoint((0, 0, -z)), Sharp(), name=f"at{z}") for z in (2, 4)], camera)
    surface = focal_surface([(100, 100), (500, 300), (300, 400)], 0.4)
    lines = str(solve_focal_surface(points, camera, surface, lens)).splitlines()
    assert [line.split()[0] for line in lines[1:3]] == ["at2", "at4"]


def test_a_turned_lens_says_how_it_is_turned(asked):
    assert ", tilt " in str(solve(*asked, free=("focus", "tilt"))).splitlines()[0]


def test_a_shot_and_many_solutions(asked):
    points, camera, lens = asked
    assert str(solve_frames([points] * 3, camera, lens)).startswith("3 frames, focus from 95.2 cm")
    many = solve_many(stacked([points] * 2), camera, lens)
    assert str(many) == "2 solutions, of which `at` gives one: at(0), at(1), ..."


def test_what_is_traced_is_printed_as_arrays(asked):
    points, camera, lens = asked
    said = []
    jax.jit(lambda z: said.append(str(solve(points, camera, lens, min_focus_distance=z, throw=False))) or z)(
        0.5
    )
    assert said[0].startswith("Solution(")
