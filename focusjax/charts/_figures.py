"""The figures: cross-section, spots, blur of highlights, and curves of focus and distortion."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from focusjax.charts._beams import FieldCurves, beam, paths
from focusjax.optics import RGB_WAVELENGTHS, Prescription, first_order, line

_COLOURS = ("#c0392b", "#27ae60", "#2c5fb3")
_FIELDS = (0.0, 0.5, 0.75, 1.0)
_GLASS = "#cfe3f2"


def cross_section(path: Path, lens: Prescription, film: float, field: float) -> None:
    """Surfaces, glass, stop and film, with rays on the axis, at 0.7 of the field, and at its edge."""
    figure = _figure(9.0, 4.2)
    axes = figure.subplots()
    vertices = np.asarray(lens.vertices())
    profiles = []
    for number, surface in enumerate(lens.surfaces):
        y = jnp.linspace(-1.0, 1.0, 81) * lens.semi_diameters[number]
        z = np.asarray(jax.vmap(surface.sag)(jnp.zeros_like(y), y)) + vertices[number]
        profiles.append((z, np.asarray(y)))
    indices = np.asarray(lens.indices(line()))
    for number, (z, y) in enumerate(profiles):
        if indices[number + 1] > 1.0 and number + 1 < len(profiles):
            following_z, following_y = profiles[number + 1]
            outline_z = np.concatenate([z, following_z[::-1]])
            axes.fill(outline_z, np.concatenate([y, following_y[::-1]]), color=_GLASS, lw=0)
        if indices[number] != indices[number + 1]:
            axes.plot(z, y, color="#30506b", lw=1.0)
    for share, colour in zip((0.0, 0.7, 1.0), _COLOURS[::-1], strict=True):
        for points in paths(lens, share * field, 11, film):
            axes.plot(*points.T, color=colour, lw=0.6)
    radius, place = float(lens.semi_diameters[lens.stop]), vertices[lens.stop]
    highest = float(np.max(lens.semi_diameters))
    for sign in (1, -1):
        axes.plot([place, place], [sign * radius, sign * max(radius * 1.1, highest)], color="black", lw=2.0)
    reach = max(abs(np.tan(field)) * float(first_order(lens).focal_length), 1.0)
    axes.plot([film, film], [-0.3 * reach, 1.1 * reach], color="black", lw=1.0)
    axes.text(film, 1.12 * reach, "film", ha="center", va="bottom", fontsize=8)
    axes.set_aspect("equal")
    axes.set_xlim(-1.2 * highest, film + 4)
    axes.set_xlabel("mm")
    axes.set_title(_title(lens), fontsize=10)
    _save(figure, path)


def spots(path: Path, lens: Prescription, film: float, field: float) -> None:
    """Where rays of far points land on the film, for red, green and blue, about their common middle."""
    figure = _figure(10.0, 3.2)
    panels = figure.subplots(1, len(_FIELDS), sharex=True, sharey=True)
    farthest = 0.0
    for axes, share in zip(panels, _FIELDS, strict=True):
        landed = [beam(lens, share * field, wavelength=w, across=31).at(film) for w in RGB_WAVELENGTHS]
        everything = np.concatenate(landed)
        middle = everything.mean(axis=0)
        rms = float(np.sqrt(((everything - middle) ** 2).sum(axis=1).mean()))
        for points, colour, wavelength in zip(landed, _COLOURS, RGB_WAVELENGTHS, strict=True):
            away = 1e3 * (points - middle)
            axes.plot(*away.T, ".", color=colour, ms=1.2, label=f"{wavelength:.0f} nm")
            farthest = max(farthest, float(np.abs(away).max(initial=1.0)))
        axes.set_title(f"{np.degrees(share * field):.1f}°, rms {1e3 * rms:.1f} µm", fontsize=9)
        axes.set_aspect("equal", adjustable="box")
    panels[0].set(ylabel="µm", xlim=(-farthest, farthest), ylim=(-farthest, farthest))
    panels[0].legend(fontsize=6, loc="lower left", markerscale=4)
    figure.suptitle(f"Spots of far points: {_title(lens)}", fontsize=10)
    _save(figure, path)


def highlights(path: Path, lens: Prescription, field: float) -> None:
    """Points of light behind and before the plane in focus, over the field, each in its own brightness."""
    focal = float(first_order(lens).focal_length)
    focused = 30.0 * focal
    film = beam(lens, 0.0, distance=focused).best_place()
    figure = _figure(9.0, 4.8)
    panels = figure.subplots(2, len(_FIELDS), sharex=True, sharey=True)
    rows = (("far behind the focus", np.inf), ("in front of the focus", 15.0 * focal))
    landed = [[_highlight(lens, share * field, distance, film) for share in _FIELDS] for _, distance in rows]
    size = 1.1 * max(float(np.abs(points).max(initial=1e-3)) for row in landed for points in row)
    edges = np.linspace(-size, size, 81)
    for row, (name, _), found in zip(panels, rows, landed, strict=True):
        for axes, share, points in zip(row, _FIELDS, found, strict=True):
            density, _, _ = np.histogram2d(*points.T[::-1], bins=[edges, edges])
            top = np.percentile(density[density > 0], 97) if density.any() else 1.0
            extent = (-size, size, -size, size)
            axes.imshow(density, origin="lower", extent=extent, cmap="gray", vmin=0, vmax=top)
            axes.set_title(f"{np.degrees(share * field):.1f}°", fontsize=9)
        row[0].set_ylabel(f"{name}\nmm", fontsize=8)
    figure.suptitle(f"Highlights, focused at 30 focal lengths: {_title(lens)}", fontsize=10)
    _save(figure, path)


def _highlight(lens: Prescription, field: float, distance: float, film: float) -> np.ndarray:
    """Where the rays of a point land, in mm about the middle of them all [r, 2]."""
    points = beam(lens, field, distance=distance, across=401, scattered=True).at(film)
    return points - 0.5 * (points.max(axis=0) + points.min(axis=0)) if len(points) else points


def curves(path: Path, lens: Prescription, film: float, over_field: FieldCurves) -> None:
    """Spherical aberration, field curvature and astigmatism, distortion, and focus by wavelength."""
    figure = _figure(11.0, 3.4)
    spherical, curvature, distorted, colour = figure.subplots(1, 4)
    radius = float(first_order(lens).entrance_pupil_radius)
    for wavelength, tint in zip(RGB_WAVELENGTHS, _COLOURS, strict=True):
        rays = beam(lens, 0.0, wavelength=wavelength, across=61, width=1.0)
        along = np.abs(rays.pupil[:, 0]) < radius / 61
        height, middle = rays.pupil[along, 1], rays.at(film)[along, 1]
        upper = height > 0.05 * radius
        focus = -middle[upper] / rays.slope[along][upper, 1]
        order = np.argsort(height[upper])
        spherical.plot(focus[order], height[upper][order] / radius, color=tint, label=f"{wavelength:.0f} nm")
    spherical.set(xlabel="focus from film, mm", ylabel="share of the pupil", title="spherical")
    spherical.legend(fontsize=6)
    degrees = np.degrees(over_field.angles)
    curvature.plot(over_field.tangential, degrees, color="black", label="tangential")
    curvature.plot(over_field.sagittal, degrees, color="black", ls="--", label="sagittal")
    curvature.set(xlabel="focus from film, mm", ylabel="field, °", title="field and astigmatism")
    curvature.legend(fontsize=6)
    distorted.plot(over_field.distortion, degrees, color="black")
    distorted.set(xlabel="%", title="distortion")
    wavelengths = np.linspace(420.0, 680.0, 27)
    places = [float(first_order(lens, jnp.asarray(w)).back_focal_distance) for w in wavelengths]
    shifts = 1e3 * (np.array(places) - float(first_order(lens).back_focal_distance))
    colour.plot(wavelengths, shifts, color="black")
    colour.set(xlabel="nm", ylabel="focal shift, µm", title="colour")
    for axes in (spherical, curvature, distorted):
        axes.axvline(0.0, color="#bbbbbb", lw=0.6)
    _save(figure, path)


def _title(lens: Prescription) -> str:
    seen = first_order(lens)
    return f"{lens.name}, {float(seen.focal_length):.4g} mm f/{float(seen.f_number):.3g}"


def _figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), layout="constrained")


def _save(figure: Figure, path: Path) -> None:
    figure.savefig(path, dpi=130)
