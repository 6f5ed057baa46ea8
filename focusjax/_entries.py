"""Entries of short vectors, at places that are known when a program is traced.

An array as an index makes a gather or a scatter, which XLA makes into a loop on a processor; a solve has
dozens of these, and would compile for longer. Slices and one concatenation do the same.
"""

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, Shaped


def entries(vector: Shaped[Array, "n"], places: Sequence[int]) -> Shaped[Array, "m"]:
    """The entries at `places`, one of them at least.

    Example:
        >>> entries(jnp.array([5.0, 6.0, 7.0]), (2, 0)).tolist()
        [7.0, 5.0]
    """
    return jnp.stack([vector[place] for place in places])


def with_entries(
    vector: Shaped[Array, "n"],
    places: Sequence[int],
    values: Sequence[Shaped[Array, ""]] | Shaped[Array, "m"],
) -> Shaped[Array, "n"]:
    """`vector` with `values` at `places`.

    Example:
        >>> with_entries(jnp.zeros(3), (2, 0), jnp.array([7.0, 5.0])).tolist()
        [5.0, 0.0, 7.0]
    """
    new = {place: values[number].astype(vector.dtype) for number, place in enumerate(places)}
    return jnp.stack([new.get(place, vector[place]) for place in range(vector.size)])
