"""One placed object of a scene: triangles in world metres with all that shading needs."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from focusjax._arguments import real_number, real_numbers
from focusjax.scene._images import decode_srgb, fill_hidden
from focusjax.scene._material import Material, opacity_of, shininess_of, triple
from focusjax.scene._normals import directed, smooth_normals, unit_rows
from focusjax.scene._part import Part, check_part, check_placed, check_size
from focusjax.scene._placement import placement

DEFAULT_ALBEDO = 0.8
"""Linear grey of surfaces that say nothing about their colour."""

DEFAULT_SMOOTH_ANGLE = 40.0
"""Degrees up to which edges are shaded smooth when a mesh has no normals of its own."""


@dataclass(frozen=True)
class SceneObject:
    """A named triangle mesh, placed in the world.

    Attributes:
        name: unique within a scene.
        vertices: world metres [v, 3].
        faces: vertex numbers [t, 3], counter-clockwise seen from outside.
        normals: unit shading normals [v, 3].
        uv: texture coordinates [v, 2], u to the right and v upwards, 1 = the whole picture.
        colours: linear vertex colours [v, 3].
        face_material: material number of each face [t].
        materials: what the numbers mean.
        textures: linear pictures [h, w, 3] the materials refer to.
        opacities: opacity pictures [h, w], 0 to 1, the materials refer to.
        vertex_opacity: 0 to 1 [v]; None where all are 1.
        source: row of the mesh's own vertices [v] that each of `vertices` is, which may be there more than
            once, where normals differ; those of a file's geometries count on from one to the next.
    """

    name: str
    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "t 3"]
    normals: Float[np.ndarray, "v 3"]
    uv: Float[np.ndarray, "v 2"]
    colours: Float[np.ndarray, "v 3"]
    face_material: Int[np.ndarray, "t"]
    materials: tuple[Material, ...]
    textures: tuple[Float[np.ndarray, "_ _ 3"], ...] = ()
    opacities: tuple[Float[np.ndarray, "_ _"], ...] = ()
    vertex_opacity: Float[np.ndarray, "v"] | None = None
    source: Int[np.ndarray, "v"] | None = None


def make_object(
    name: str,
    vertices: object,
    faces: object,
    *,
    uv: object = None,
    texture: Float[np.ndarray, "h w c"] | None = None,
    vertex_colours: object = None,
    colour: object = None,
    emission: object = 0.0,
    specular: object = 0.0,
    shininess: float = 32.0,
    reflectance: object = 0.0,
    opacity: float = 1.0,
    cutoff: float | None = None,
    smooth_angle: float = DEFAULT_SMOOTH_ANGLE,
    translate: Sequence[float] = (0.0, 0.0, 0.0),
    rotate: Sequence[float] = (0.0, 0.0, 0.0),
    scale: float | Sequence[float] = 1.0,
) -> SceneObject:
    """A `SceneObject` from arrays, for scenes made by a program.

    Args:
        name: unique within a scene.
        vertices: [v, 3]; metres after `scale`.
        faces: vertex numbers [t, 3].
        uv: texture coordinates [v, 2].
        texture: *linear* picture [h, w, 3], or [h, w, 4] with opacity, 0 to 1, last; needs `uv`.
        vertex_colours: *linear* colours [v, 3].
        colour: sRGB base colour, 0 to 1; white with a texture or vertex colours, else a light grey.
        emission: linear radiance, may exceed 1.
        specular: linear Phong coefficient.
        shininess: Phong exponent, at least 1.
        reflectance: share of the background that is mirrored, 0 to 1; one number or three.
        opacity: share of the surface that is there, 0 to 1; what is behind it shows through the rest.
        cutoff: with it the texture's opacity cuts the surface out instead of blending it.
        smooth_angle: degrees up to which edges are shaded smooth; 0 to 180.
        translate: metres.
        rotate: as in `placement`.
        scale: as in `placement`.

    Raises:
        ValueError: no faces, none with an area, vertices that are not finite or too far away, faces out of
            range, or a bad value.

    Example:
        >>> corners = [(0, 0, -2), (1, 0, -2), (0, 1, -2)]
        >>> make_object("pane", corners, [(0, 1, 2)], opacity=0.3).materials[0].opacity
        0.3
    """
    what = f"object {name!r}"
    if texture is not None and uv is None:
        raise ValueError(f"{what} has a texture but no texture coordinates; give uv as well")
    textures, opacities = _pictures(texture, what)
    cut = None if cutoff is None else opacity_of(cutoff, f"cutoff of {what}")
    if cut is not None and not opacities and opacity == 1:
        raise ValueError(
            f"{what} has a cutoff of {cut}, but nothing to cut: its texture has no fourth channel and its"
            " opacity is 1; leave cutoff out"
        )
    material = Material(
        base_colour=_base_colour(colour, texture is not None or vertex_colours is not None, what),
        emission=triple(emission, f"emission of {what}"),
        specular=triple(specular, f"specular of {what}"),
        shininess=shininess_of(shininess),
        texture=-1 if texture is None else 0,
        reflectance=triple(reflectance, f"reflectance of {what}", largest=1.0),
        opacity=opacity_of(opacity, f"opacity of {what}"),
        opacity_texture=0 if opacities else -1,
    )
    part = Part(
        vertices=real_numbers(vertices, f"vertices of {what}", "three coordinates per vertex"),
        faces=_vertex_numbers(faces, what),
        material=material if cut is None else material.cut_at(cut),
        uv=None if uv is None else real_numbers(uv, f"uv of {what}", "two texture coordinates per vertex"),
        colours=None
        if vertex_colours is None
        else real_numbers(vertex_colours, f"vertex colours of {what}", "three linear values per vertex"),
    )
    check_part(part, what)
    return assemble(
        name,
        [part],
        textures,
        opacities,
        placement(translate, rotate, scale),
        what=what,
        smooth_angle=smooth_angle,
        keep_normals=False,
    )


def _vertex_numbers(faces: object, what: str) -> Int[np.ndarray, "..."]:
    """Whole numbers, of whatever type."""
    if not np.issubdtype(getattr(faces, "dtype", np.void), np.integer):
        faces = real_numbers(faces, f"faces of {what}", "three vertex numbers per face")
        if not (faces == np.floor(faces)).all():
            raise ValueError(f"faces of {what} are not all whole numbers; expected those of its vertices")
    return np.asarray(faces).astype(np.int64, copy=False)


def _base_colour(colour: object, tinted: bool, what: str) -> Float[np.ndarray, "3"]:
    """Linear; where no sRGB `colour` is given, white below what is `tinted` otherwise, or a light grey."""
    if colour is not None:
        return decode_srgb(triple(colour, f"colour of {what}", largest=1.0))
    return np.full(3, 1.0 if tinted else DEFAULT_ALBEDO)


def _pictures(
    texture: Float[np.ndarray, "h w c"] | None, what: str
) -> tuple[tuple[Float[np.ndarray, "h w 3"], ...], tuple[Float[np.ndarray, "h w"], ...]]:
    """The colours and the opacity, if any, of `texture`."""
    if texture is None:
        return (), ()
    picture = real_numbers(texture, f"texture of {what}", "linear values [h, w, 3]").astype(np.float32)
    if picture.ndim != 3 or picture.shape[2] not in (3, 4):
        raise ValueError(f"texture of {what} has the shape {picture.shape}; expected [h, w, 3] or [h, w, 4]")
    bad = ~(np.isfinite(picture) & (picture >= 0)).all(axis=2)
    if bad.any():
        row, column = np.argwhere(bad)[0]
        raise ValueError(
            f"texture of {what} has {int(bad.sum())} texels that are negative or not finite (the first in row"
            f" {row}, column {column}); expected linear values of at least 0"
        )
    if picture.shape[2] == 3:
        return (picture,), ()
    opacity = picture[..., 3]
    if not ((opacity >= 0) & (opacity <= 1)).all():
        raise ValueError(
            f"texture of {what} has opacities outside 0 to 1; expected 0 (not there) to 1 (opaque)"
        )
    return (fill_hidden(picture[..., :3], opacity),), (opacity,)


def assemble(
    name: str,
    parts: Sequence[Part],
    textures: tuple[Float[np.ndarray, "_ _ 3"], ...],
    opacities: tuple[Float[np.ndarray, "_ _"], ...],
    world_from_object: Float[np.ndarray, "4 4"],
    *,
    what: str,
    smooth_angle: float,
    keep_normals: bool,
) -> SceneObject:
    """Place checked `parts` in the world, give them normals, and join them. `what` names them in errors.

    Raises:
        ValueError: a `smooth_angle` outside 0 to 180 degrees; what has no area or size, or is out of reach.
    """
    expected = "0 (facets) to 180 (smooth)"
    if not 0.0 <= real_number(smooth_angle, "smooth angle in degrees", expected) <= 180.0:
        raise ValueError(f"smooth angle is {smooth_angle} degrees; expected {expected}")
    joined: dict[str, list[np.ndarray]] = {
        key: []
        for key in ("vertices", "faces", "normals", "uv", "colours", "opacity", "source", "face_material")
    }
    offset = before = 0
    for number, part in enumerate(parts):
        piece = _place(part, world_from_object, smooth_angle, keep_normals)
        piece["faces"] = piece["faces"] + offset
        piece["source"] = piece["source"] + before
        piece["face_material"] = np.full(len(part.faces), number)
        offset, before = offset + len(piece["vertices"]), before + len(part.vertices)
        for key, values in piece.items():
            joined[key].append(values)
    arrays = {key: np.concatenate(values) for key, values in joined.items()}
    check_size(parts, arrays["vertices"], world_from_object[:3, :3], what)
    check_placed(arrays["vertices"], arrays["faces"], what)
    return SceneObject(
        name=name,
        vertices=arrays["vertices"],
        faces=arrays["faces"].astype(np.int32),
        normals=arrays["normals"],
        uv=arrays["uv"],
        colours=arrays["colours"],
        face_material=arrays["face_material"].astype(np.int32),
        materials=tuple(part.material for part in parts),
        textures=textures,
        opacities=opacities,
        vertex_opacity=None if (arrays["opacity"] == 1.0).all() else arrays["opacity"],
        source=arrays["source"],
    )


def _place(
    part: Part, world_from_object: Float[np.ndarray, "4 4"], smooth_angle: float, keep_normals: bool
) -> dict[str, np.ndarray]:
    """The arrays of one part in world metres, its vertices split where corner normals differ."""
    linear = world_from_object[:3, :3]
    vertices = part.vertices @ linear.T + world_from_object[:3, 3]
    # A mirrored triangle runs clockwise; exchanging two corners turns its outside out again.
    faces = part.faces[:, ::-1] if np.linalg.det(linear) < 0 else part.faces
    given = np.zeros_like(vertices)
    if part.normals is not None and keep_normals:
        given = unit_rows(unit_rows(part.normals) @ np.linalg.inv(linear))
    there = directed(given)[faces]
    if there.all():
        source, normals = np.arange(len(vertices)), given
    else:
        corners = smooth_normals(vertices, faces, smooth_angle)
        if there.any():
            corners = np.where(there[..., None], given[faces], corners)
        source, faces, normals = _split(faces, corners, len(vertices))
    uv = np.zeros((len(part.vertices), 2)) if part.uv is None else part.uv
    colours = np.ones((len(part.vertices), 3)) if part.colours is None else part.colours
    opacity = np.ones(len(part.vertices)) if part.opacity is None else part.opacity
    return {
        "vertices": vertices[source],
        "faces": faces,
        "normals": normals,
        "uv": uv[source],
        "colours": colours[source],
        "opacity": opacity[source],
        "source": source,
    }


def _split(
    faces: Int[np.ndarray, "t 3"], corners: Float[np.ndarray, "t 3 3"], count: int
) -> tuple[Int[np.ndarray, "u"], Int[np.ndarray, "t 3"], Float[np.ndarray, "u 3"]]:
    """Old vertex of each new vertex, new faces and normals, so that each vertex has one normal."""
    flat = faces.ravel()
    rows = corners.reshape(-1, 3)
    first = np.full(count, -1)
    first[flat[::-1]] = np.arange(len(flat))[::-1]
    # A corner that agrees with the first corner of its vertex shares it; others get their own.
    shared = functools.reduce(np.logical_and, (np.abs(rows - rows[first[flat]]) < 1e-9).T)
    used = np.flatnonzero(first >= 0)
    number = np.full(count, -1)
    number[used] = np.arange(len(used))
    new = number[flat]
    new[~shared] = len(used) + np.arange(int((~shared).sum()))
    source = np.concatenate([used, flat[~shared]])
    normals = np.concatenate([rows[first[used]], rows[~shared]])
    return source, new.reshape(-1, 3), normals
