"""What a lens has to be before rays are traced through it, said in words where nobody checks types."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import AbstractArray, Array, Bool

from focusjax._arguments import ArgumentError, require_kind
from focusjax._words import kind_of, shown
from focusjax.lens._base import AbstractLens

_NOT_NEGATIVE = {
    "focus_disparity": "zero (infinity) or a positive finite number of dioptres",
    "aperture_radius": "zero (a pinhole) or a positive finite length in metres",
}
"""Settings of which every single number is not negative, by their names, and what to expect of them."""


def require_lens(lens: Any, usage: str, *, beyond_infinity: bool = False) -> None:
    """Refuse what is no lens, and a lens of which an array is none, has another shape, or is out of range.

    Args:
        lens: what was given.
        usage: the call with its arguments in order, such as "(layers, lens)".
        beyond_infinity: whether the focus disparity may be negative. No lens forms a picture so, but layers
            may be made for one whose rays go farthest (`widest_lens`).

    Raises:
        ArgumentError: naming the setting and its value. What is traced by JAX is not looked at.
    """
    require_kind(lens, AbstractLens, usage, "`thin_lens` makes one, as others do", "lens")
    for name, value, axes in _arrays(lens):
        if not _numeric(value):
            raise ArgumentError(f"{name} of the lens is {kind_of(value)}; expected numbers", "lens")
        if np.ndim(value) > axes:
            raise ArgumentError(
                f"{name} of the lens has the shape {np.shape(value)}, as of several lenses; expected one:"
                " `jax.vmap` over a stack of lenses takes one at a time",
                "lens",
            )
    for name, value in _single_settings(lens):
        if isinstance(value, Tracer):
            continue
        free = beyond_infinity and name.endswith("focus_disparity")
        if _out_of_range(abs(np.asarray(value)) if free else np.asarray(value)):
            expected = "a finite number of dioptres" if free else _expected(name)
            raise ArgumentError(f"{name} of the lens is {shown(value)}; expected {expected}", "lens")


def traced_faults(lens: AbstractLens) -> list[tuple[Bool[Array, ""], str]]:
    """For each setting that is traced by JAX, whether it is out of range, and the sentence to say so."""
    return [
        (_out_of_range(value), f"{name} of the lens is out of range; expected {_expected(name)}")
        for name, value in _single_settings(lens)
        if isinstance(value, Tracer)
    ]


def not_numbers(lens: AbstractLens) -> str | None:
    """Which known array of the lens holds NaN, in words; None where none does."""
    for name, value, _ in _arrays(lens):
        if not isinstance(value, Tracer) and np.isnan(np.asarray(value)).any():
            return (
                f"{name} of the lens is {shown(value) if np.ndim(value) == 0 else 'not a number in places'}"
            )
    return None


def _out_of_range(value: Any) -> Any:
    return ~((value >= 0.0) & (value < jnp.inf))


def _expected(name: str) -> str:
    return _NOT_NEGATIVE[name.rpartition(".")[2]]


def _single_settings(lens: AbstractLens) -> Iterator[tuple[str, Any]]:
    for name, value, axes in _arrays(lens):
        if axes == 0 and name.rpartition(".")[2] in _NOT_NEGATIVE:
            yield name, value


def _numeric(value: Any) -> bool:
    if isinstance(value, bool | int | float):
        return True
    kinds = (jnp.number, jnp.bool_)
    return eqx.is_array_like(value) and any(jnp.issubdtype(jnp.result_type(value), kind) for kind in kinds)


def _arrays(part: Any, name: str = "") -> Iterator[tuple[str, Any, int]]:
    """Every array that a module, and those in it, are declared to have: name, value, number of axes."""
    if isinstance(part, eqx.Module):
        for field in dataclasses.fields(part):
            value, kind = getattr(part, field.name), field.type
            path = f"{name}.{field.name}" if name else field.name
            if isinstance(kind, type) and issubclass(kind, AbstractArray):
                if kind.index_variadic is None:
                    yield path, value, len(kind.dims)
            elif not field.metadata.get("static", False):
                yield from _arrays(value, path)
    elif isinstance(part, tuple | list):
        for number, value in enumerate(part):
            yield from _arrays(value, f"{name}.{number}")
    elif isinstance(part, Mapping):
        for key, value in part.items():
            yield from _arrays(value, f"{name}.{key}")
