"""From wishes about places in the scene to rows of image positions, disparities and targets."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int, Integer

from focusjax._arguments import (
    ArgumentError,
    about,
    real_number,
    real_numbers,
    require_kind,
    require_known,
)
from focusjax._device import device_array
from focusjax._words import did_you_mean, kind_of, shown
from focusjax.focus._framing import Row, ends, frames, framing_rows
from focusjax.focus._image_points import AT_LEAST, AT_MOST, BLUR, EQUAL, SAME, ImagePoints
from focusjax.focus._places import BEHIND, OUTSIDE, Finder, Place
from focusjax.focus._points import AtInfinity, AtPoint, FocusPoint
from focusjax.focus._units import pixels
from focusjax.focus._wishes import AtLeast, AtMost, Blur, SameBlur, Sharp, Wish
from focusjax.geometry import Camera


def locate(
    points: Sequence[FocusPoint],
    camera: Camera,
    *,
    vertices: Float[np.ndarray, "v 3"] | None = None,
    faces: Integer[np.ndarray, "t 3"] | None = None,
    objects: Mapping[str, range] | None = None,
    disparity_map: Float[np.ndarray, "h w"] | Float[Array, "h w"] | None = None,
    favour_near: float = 0.0,
    may_be_idle: bool = False,
) -> ImagePoints:
    """Where every wish is in the picture, and how far away (Lee10 §5).

    A pixel takes the disparity of the first surface at the nearest pixel centre. Of an object, those
    sampled surface points count that the camera sees: in the frame, and within `VISIBLE_WITHIN` of the
    disparity of the first surface at the nearest pixel centre. They share the wish's weight.

    A place outside the frame, or behind the camera, does not count unless the focus point says so; of one
    that is hidden the weight fades to 0, for points and triangles softly (`visibility`). `notes` says
    which wishes that happened to. Without a disparity map nothing is taken to be hidden. Wishes for where
    a place is shown count outside the frame and hidden, too, since they are to change that.

    Under `jax.jit` and `jax.grad` the numbers of wishes may be traced: diameters, margins, places in the
    picture, weights, tolerances, and the positions and directions of points that count in any case
    (`even_outside` and `even_hidden`). What shows has to be known: camera, scene and disparity map.

    Args:
        points: the wishes, at least one.
        camera: the pinhole that frames the picture.
        vertices: world metres; needed for triangles and objects.
        faces: rows of `vertices`; needed for triangles and objects.
        objects: object names and their ranges of faces; needed for objects.
        disparity_map: disparity of the first surface at every pixel centre in 1/m, 0 where there is
            only background; needed for pixels, masks and objects.
        favour_near: how much more near wishes count, to settle ambiguities: the weight is multiplied by
            1 + favour_near x disparity / (largest disparity of any wish). 0, for lenses and focal surfaces
            alike, takes weights as they are given; Lee10 section 5 lets near wishes count more, as 1 does.
        may_be_idle: whether it is fine that no wish counts, as in some frames of a shot.

    Raises:
        ArgumentError: (a `ValueError`) no points; none that counts, unless that is fine; a pixel that is
            off screen; a place that is not finite or not in the scene; a mask that is empty or of another
            size; an unknown name; a missing argument.

    Example:
        >>> from focusjax.focus import AtPoint, Sharp
        >>> from focusjax.geometry import make_camera
        >>> camera = make_camera(jnp.eye(4), width=64, height=48, focal_length=0.05)
        >>> found = locate([FocusPoint(AtPoint((0, 0, -2)), Sharp(), name="nose")], camera)
        >>> found.names, found.xy.tolist(), found.disparity.tolist()
        (('nose',), [[32.0, 24.0]], [0.5])
    """
    _check_wishes(points, camera)
    expected = "zero or a positive finite number"
    with about("favour_near"):
        if not 0 <= real_number(favour_near, "favour_near", expected) < np.inf:
            raise ValueError(f"favour_near is {shown(favour_near)}; expected {expected}")
    names = _names(points)
    finder = Finder(camera, vertices, faces, objects or {}, _checked_map(disparity_map, camera))
    places = []
    for index, (point, name) in enumerate(zip(points, names, strict=True)):
        # What is known is worked out now, also inside functions that JAX compiles.
        with about(f"points.{index}.where"), jax.ensure_compile_time_eval():
            places.append(_place(finder, point, name))
    counts = np.array([len(place.rows) for place in places])
    meanings = [_meaning(point.wish, camera) for point in points]
    targets, relations, signed, quantities = zip(*(row for rows in meanings for row in rows), strict=True)
    meaning = _meaning_of_rows(counts, meanings)
    tolerances = [pixels(point.tolerance, camera) for point in points]
    shares = np.array([_share(point, place) for point, place in zip(points, places, strict=True)])
    rows = _joined([place.rows for place in places])
    wish = np.repeat(np.arange(len(points)), counts)
    others = [_other(points[index].wish, index, names, places) for index in range(len(points))]
    shares = shares * [1.0 if other is None or other.trouble != BEHIND else 0.0 for other in others]
    if not may_be_idle:
        _check_some_count(points, names, places, shares)
    # A wish about blur shares its weight among its points; of one about the frame every row has all of it.
    part = np.where([len(each) > 1 for each in meanings], 1.0, 1.0 / counts)
    weight = _column([point.weight for point in points], wish) * (shares * part)[wish]
    if favour_near:
        weight = weight * (1.0 + favour_near * _nearness(rows[:, 2]))
    reference = _references(places, others)
    return ImagePoints(
        xy=device_array(rows[:, :2], dtype=float),
        disparity=device_array(rows[:, 2], dtype=float),
        target=device_array(_column(targets, meaning), dtype=float),
        signed=device_array(np.array(signed)[meaning]),
        weight=device_array(weight, dtype=float),
        tolerance=device_array(_column(tolerances, wish), dtype=float),
        wish=device_array(wish),
        names=names,
        relation=device_array(np.array(relations)[meaning]) if any(relations) or any(quantities) else None,
        reference=None if reference is None else device_array(reference, dtype=float),
        notes=tuple(_note(place, share) for place, share in zip(places, shares, strict=True)),
        quantity=device_array(np.array(quantities)[meaning]) if any(quantities) else None,
        partners=tuple(point.wish.other if isinstance(point.wish, SameBlur) else "" for point in points),
    )


def _meaning_of_rows(counts: Int[np.ndarray, "m"], meanings: Sequence[Sequence[Row]]) -> Int[np.ndarray, "n"]:
    """For every row which of all wishes' meanings it has: of a wish with one, all of its rows the same."""
    first, found = 0, []
    for count, rows in zip(counts, meanings, strict=True):
        found.append(first + (np.zeros(count, dtype=int) if len(rows) == 1 else np.arange(len(rows))))
        first += len(rows)
    return np.concatenate(found)


def _column(
    numbers: Sequence[Any], index: Int[np.ndarray, "n"]
) -> Float[np.ndarray, "n"] | Float[Array, "n"]:
    """The numbers of rows, of which some may be traced; by numpy if none is, which compiles nothing."""
    if any(isinstance(each, Tracer) for each in numbers):
        return jnp.stack([jnp.asarray(each, dtype=float) for each in numbers])[index]
    return np.array([float(each) for each in numbers])[index]


def _joined(
    parts: Sequence[Float[np.ndarray, "_ 3"] | Float[Array, "_ 3"]],
) -> Float[np.ndarray, "n 3"] | Float[Array, "n 3"]:
    traced = any(isinstance(each, Tracer) for each in parts)
    return jnp.concatenate(parts) if traced else np.concatenate(parts)


def _nearness(disparity: Float[np.ndarray, "n"] | Float[Array, "n"]) -> Any:
    """Disparities over the largest of them."""
    if isinstance(disparity, Tracer):
        largest = disparity.max()
        return jnp.where(largest > 0, disparity / jnp.where(largest > 0, largest, 1.0), 0.0)
    return disparity / max(disparity.max(), np.finfo(float).tiny)


def _check_wishes(points: object, camera: object) -> None:
    """Refuses what is no row of wishes, and no camera."""
    usage = "locate(points, camera)"
    if isinstance(points, FocusPoint):
        raise ArgumentError(f"points of {usage} is one FocusPoint; put it into a list: [point]", "points")
    require_kind(points, Sequence, usage, "a list of focus points", "points")
    assert isinstance(points, Sequence)
    if not points:
        raise ArgumentError("there are no focus points; give at least one wish", "points")
    for index, point in enumerate(points):
        if not isinstance(point, FocusPoint):
            raise ArgumentError(
                f"points.{index} of {usage} is {kind_of(point)}; expected a FocusPoint, which has a place and"
                " a wish",
                f"points.{index}",
            )
    require_kind(camera, Camera, usage, "`look_at` and `make_camera` make one", "camera")
    remedy = "it decides what shows; locate the wishes before, and trace the points that are found"
    require_known(camera, usage, remedy, "camera")


def _names(points: Sequence[FocusPoint]) -> tuple[str, ...]:
    """What reports call the wishes, each by a name of its own."""
    names = tuple(point.name or f"point {index + 1}" for index, point in enumerate(points))
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ArgumentError(
            f"several focus points are called {twice[0]!r}; give each a name of its own", "points"
        )
    return names


def _place(finder: Finder, point: FocusPoint, name: str) -> Place:
    """Where a wish is; of one about the frame, the ends of what is to be shown."""
    label = f"focus point {name!r}"
    if isinstance(point.where, AtPoint | AtInfinity) and finder.traced(point.where):
        if not (point.even_outside and point.even_hidden):
            raise ValueError(
                f"{label} has a place that is traced by JAX, so that nobody knows whether it is to be"
                " seen; let it count even_outside and even_hidden, or locate it before"
            )
        place = finder.unseen(point.where)
        # One row for every meaning of a wish about the frame.
        times = len(framing_rows(point.wish, finder.camera)) if frames(point.wish) else 1
        return Place(jnp.tile(place.rows, (times, 1)))
    if frames(point.wish):
        return ends(finder.extent(point.where, label), point.wish)
    return finder.find(point.where, label)


def _meaning(wish: Wish, camera: Camera) -> list[Row]:
    """Target in pixels, relation, whether the side of the focus matters, and quantity.

    One for all rows of a wish about blur, one for each row of a wish about places.
    """
    match wish:
        case Blur(diameter, signed):
            return [(pixels(diameter, camera), EQUAL, signed, BLUR)]
        case AtMost(diameter):
            return [(pixels(diameter, camera), AT_MOST, False, BLUR)]
        case AtLeast(diameter):
            return [(pixels(diameter, camera), AT_LEAST, False, BLUR)]
        case SameBlur(_, same_side):
            return [(0.0, SAME, same_side, BLUR)]
        case Sharp():
            return [(0.0, EQUAL, True, BLUR)]
        case _:
            return framing_rows(wish, camera)


def _share(point: FocusPoint, place: Place) -> float:
    """Factor of a wish's weight for what is to be seen of its place."""
    if place.trouble == BEHIND:
        return 0.0
    if frames(point.wish):
        return 1.0
    if place.trouble == OUTSIDE:
        return 1.0 if point.even_outside else 0.0
    return 1.0 if point.even_hidden else place.shown


def _note(place: Place, share: float) -> str:
    if share > 0 and place.trouble:
        return f"counts although {place.trouble}"
    return place.trouble if share == 0 else "" if share == 1 else f"{100 * (1 - share):.0f} % hidden"


def _other(wish: Wish, index: int, names: tuple[str, ...], places: Sequence[Place]) -> Place | None:
    """The place of the point whose blur the wish of that index refers to."""
    if not isinstance(wish, SameBlur):
        return None
    name = names[index]
    found = [index for index, known in enumerate(names) if known == wish.other]
    if len(found) != 1:
        hint = did_you_mean(wish.other, names, f"the focus points are {list(names)}")
        problem = "does not exist" if not found else "is not the only one of that name"
        raise ArgumentError(
            f"focus point {name!r} is to be as blurred as {wish.other!r}, which {problem}; {hint}",
            f"points.{index}.wish",
        )
    if wish.other == name:
        raise ArgumentError(
            f"focus point {name!r} is to be as blurred as itself; name another focus point",
            f"points.{index}.wish",
        )
    return places[found[0]]


def _references(
    places: Sequence[Place], others: Sequence[Place | None]
) -> Float[np.ndarray, "n 3"] | Float[Array, "n 3"] | None:
    """For every row the middle of the place whose blur it is to have; its own where it is to have none's.

    None when no wish refers to another point.
    """
    if all(other is None for other in others):
        return None
    return _joined(
        [
            place.rows if other is None else other.rows.mean(axis=0)[None].repeat(len(place.rows), axis=0)
            for place, other in zip(places, others, strict=True)
        ]
    )


def _check_some_count(
    points: Sequence[FocusPoint], names: tuple[str, ...], places: Sequence[Place], shares: np.ndarray
) -> None:
    """Refuses wishes that all have no say, in the words of the first that would have one."""
    wanted = np.array([1.0 if isinstance(each.weight, Tracer) else float(each.weight) for each in points])
    if (wanted * shares).max() > 0:
        return
    for index, (name, place) in enumerate(zip(names, places, strict=True)):
        if place.trouble and wanted[index] > 0:
            many = "" if len(points) == 1 else ", and no other focus point counts"
            remedy = {
                BEHIND: "move it, or turn the camera",
                OUTSIDE: "move it or the camera, or let it count even_outside",
            }.get(
                place.trouble,
                "move the camera, or let it count even_hidden, as what is less than half opaque must",
            )
            x, y = place.rows.mean(axis=0)[:2]
            where = f" around pixel ({x:.6g}, {y:.6g})" if place.trouble != BEHIND else ""
            raise ArgumentError(
                f"focus point {name!r} is {place.trouble}{where}{many}; {remedy}", f"points.{index}.where"
            )


def _checked_map(
    disparity_map: Float[np.ndarray, "h w"] | Float[Array, "h w"] | None, camera: Camera
) -> Float[np.ndarray, "h w"] | None:
    if disparity_map is None:
        return None
    array = real_numbers(disparity_map, "the disparity map", "numbers of dioptres, one for each pixel")
    if array.shape != (camera.height, camera.width):
        raise ValueError(
            f"the disparity map has shape {array.shape}; expected one value per pixel,"
            f" {(camera.height, camera.width)}"
        )
    if not np.all(np.isfinite(array) & (array >= 0)):
        raise ValueError("the disparity map has negative values or values that are not finite")
    return array
