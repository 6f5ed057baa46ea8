"""Wishes after they have been found in the picture: all that the solve needs to know."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Bool, Float, Int, Shaped

from focusjax._device import device_array
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens

EQUAL, AT_MOST, AT_LEAST, SAME = range(4)
"""What a row of `ImagePoints` wishes of its blur: a value, a limit, or that of the row's reference."""

BLUR, ACROSS, DOWN = range(3)
"""What a row is about: its signed blur, or how far across or down the picture it is shown; all in pixels."""


class ImagePoints(eqx.Module):
    """One row per point; a wish about an object has several rows that share its weight.

    A pytree: solutions can be differentiated with respect to the float fields. Many problems at once
    (`stacked`) have a leading axis p.

    Attributes:
        xy: image positions in pixels.
        disparity: 1 / depth along the view axis, in 1/m; 0 at infinity.
        target: wished blur diameter in pixels, signed when `signed`, else not negative; or wished place.
        signed: whether the wish says on which side of the focus the point is to be; true of places.
        weight: factor of the squared error in pixels.
        tolerance: error in pixels up to which the wish is met.
        wish: which wish the row belongs to, as an index into `names`.
        names: one name per wish (static).
        relation: `EQUAL`, `AT_MOST`, `AT_LEAST` or `SAME` per row; all are `EQUAL` when None.
        reference: for `SAME` rows, image position and disparity of the point whose blur is to be had;
            None when there are no such rows.
        notes: for every wish what limits its weight, such as "hidden", or nothing (static).
        quantity: `BLUR`, `ACROSS` or `DOWN` per row; all are `BLUR` when None.
        partners: for every wish the name of the point whose blur is to be had, or nothing (static).
    """

    xy: Float[Array, "*p n 2"]
    disparity: Float[Array, "*p n"]
    target: Float[Array, "*p n"]
    signed: Bool[Array, "*p n"]
    weight: Float[Array, "*p n"]
    tolerance: Float[Array, "*p n"]
    wish: Int[Array, "*p n"]
    names: tuple[str, ...] = eqx.field(static=True)
    relation: Int[Array, "*p n"] | None = None
    reference: Float[Array, "*p n 3"] | None = None
    notes: tuple[str, ...] = eqx.field(static=True, default=())
    quantity: Int[Array, "*p n"] | None = None
    partners: tuple[str, ...] = eqx.field(static=True, default=())


def anonymous(points: ImagePoints) -> ImagePoints:
    """The points without words, which are static: other words would compile a solver again."""
    return dataclasses.replace(points, names=(), notes=(), partners=())


def named_like(points: ImagePoints, named: ImagePoints) -> ImagePoints:
    """The points with the words of others."""
    return dataclasses.replace(points, names=named.names, notes=named.notes, partners=named.partners)


def blurs(points: ImagePoints, camera: Camera, lens: AbstractLens) -> Float[Array, "n"]:
    """Signed blur diameter in pixels that `lens` gives to every point."""
    return jax.vmap(lambda xy, disparity: lens.blur(camera, xy, disparity))(points.xy, points.disparity)


def _about(points: ImagePoints, blur: Float[Array, "n"]) -> Float[Array, "n"]:
    """What every row is about, in pixels: signed blur, or the place across or down where it is shown."""
    if points.quantity is None:
        return blur
    across, down = points.xy.T
    return jnp.where(points.quantity == BLUR, blur, jnp.where(points.quantity == ACROSS, across, down))


def errors(points: ImagePoints, camera: Camera, lens: AbstractLens) -> Float[Array, "n"]:
    """How far each point's blur, or the place where it is shown, is from its wish, in pixels.

    The error is blur - target when the wish is signed and |blur| - target otherwise; positive means
    too much blur for an unsigned wish. A sharp wish is signed with target 0, so it is smooth. That
    of an `AT_MOST` row is not negative, and that of an `AT_LEAST` row not positive: their good side
    has no error. The target of a `SAME` row is the blur of its reference.
    """
    other = None
    if points.reference is not None:
        other = jax.vmap(lambda row: lens.blur(camera, row[:2], row[2]))(points.reference)
    return errors_of(points, blurs(points, camera, lens), other)


def errors_of(
    points: ImagePoints, blur: Float[Array, "n"], other: Float[Array, "n"] | None
) -> Float[Array, "n"]:
    """As `errors`, given the signed blur of every row and of its reference, if there are any."""
    value = _about(points, blur)
    excess = jnp.where(points.signed, value, jnp.abs(value)) - points.target
    if other is not None:
        excess = excess - jnp.where(points.signed, other, jnp.abs(other)) * (points.relation == SAME)
    return one_sided(excess, points.relation)


def one_sided(excess: Float[Array, "n"], relation: Int[Array, "n"] | None) -> Float[Array, "n"]:
    """`excess`, without the sign that a row's `relation` allows; its square has a slope everywhere."""
    if relation is None:
        return excess
    allowed = ((relation == AT_MOST) & (excess <= 0)) | ((relation == AT_LEAST) & (excess >= 0))
    return jnp.where(allowed, 0.0, excess)


def residuals(points: ImagePoints, camera: Camera, lens: AbstractLens) -> Float[Array, "n"]:
    """sqrt(weight) x error in pixels: the solve minimises half the sum of their squares.

    The slope of an unsigned wish at blur 0, where it has a peak, is taken as 0, and so is that of a
    limit at the limit.
    """
    return root_weight(points.weight) * errors(points, camera, lens)


def root_weight(weight: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The square root; its slope is infinite at weight 0, where 0 is reported instead."""
    counts = weight > 0
    return jnp.where(counts, jnp.sqrt(jnp.where(counts, weight, 1.0)), 0.0)


def room_for(count: int, least: int = 8) -> int:
    """The rows that are made of `count`, so that few counts compile anew: 8, 12, 16, 24, 32, 48, ...

    `least` is the fewest, a power of 2.
    """
    power = max(least, 1 << (count - 1).bit_length())
    return power * 3 // 4 if count <= power * 3 // 4 and power > least else power


def padded(points: ImagePoints, size: int) -> ImagePoints:
    """The points with their last row repeated, without weight, up to `size` rows."""
    longest = jax.tree.map(lambda leaf: repeated(leaf, size), points)
    return dataclasses.replace(longest, weight=filled_up(points.weight, size))


def repeated(rows: Array, size: int) -> Array:
    """The rows with the last one repeated, up to `size`."""
    return device_array(_repeated(rows, size))


def filled_up(rows: Shaped[ArrayLike, "n *r"], size: int, fill: Any = 0) -> Shaped[Array, "m *r"]:
    """The rows and then `fill`, up to `size`."""
    return device_array(_filled_up(rows, size, fill))


# By numpy where values are known, which compiles nothing.
def _repeated(rows: Any, size: int) -> Any:
    extra = size - rows.shape[0]
    if extra == 0:
        return rows
    xp = jnp if isinstance(rows, Tracer) else np
    rows = xp.asarray(rows)
    return xp.concatenate([rows, xp.repeat(rows[-1:], extra, axis=0)])


def _filled_up(rows: Any, size: int, fill: Any = 0) -> Any:
    pad = jnp.pad if isinstance(rows, Tracer) else np.pad
    return pad(rows, ((0, size - len(rows)), *((0, 0) for _ in rows.shape[1:])), constant_values=fill)


def stacked(problems: Sequence[ImagePoints], size: int = 0) -> ImagePoints:
    """Several problems as one, with a leading axis on every array; the names are the first one's.

    Problems with fewer rows than another, or than `size`, are padded with rows without weight.

    Raises:
        ValueError: no problems.
    """
    if not problems:
        raise ValueError("there are no problems to stack; give at least one")
    size = max(size, *(each.disparity.shape[0] for each in problems))
    related = any(each.relation is not None for each in problems)
    referring = any(each.reference is not None for each in problems)
    placing = any(each.quantity is not None for each in problems)
    alike = [with_relations(each, related=related, referring=referring, placing=placing) for each in problems]

    def all_of(name: str) -> Array | None:
        leaves = [getattr(each, name) for each in alike]
        if leaves[0] is None:
            return None
        longer = _filled_up if name == "weight" else _repeated
        return together(*(longer(leaf, size) for leaf in leaves))

    names = [field.name for field in dataclasses.fields(ImagePoints) if not field.metadata.get("static")]
    return dataclasses.replace(alike[0], notes=(), **{name: all_of(name) for name in names})


def together(*leaves: Any) -> Array:
    """Arrays as one with a leading axis; by numpy where it can be, which compiles nothing."""
    if any(isinstance(leaf, Tracer) for leaf in leaves):
        return jnp.stack(leaves)
    return device_array(np.stack([np.asarray(leaf) for leaf in leaves]))


def with_relations(points: ImagePoints, *, related: bool, referring: bool, placing: bool) -> ImagePoints:
    """The points with `relation`, `reference` and `quantity` filled in, where they are wanted and None."""
    if related and points.relation is None:
        points = dataclasses.replace(points, relation=jnp.zeros(points.wish.shape, dtype=int))
    if referring and points.reference is None:
        own = jnp.concatenate([points.xy, points.disparity[..., None]], axis=-1)
        points = dataclasses.replace(points, reference=own)
    if placing and points.quantity is None:
        points = dataclasses.replace(points, quantity=jnp.zeros(points.wish.shape, dtype=int))
    return points
