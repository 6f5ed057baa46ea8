"""Fits of small pictures take longer to compile than to run."""

from collections.abc import Iterator

import jax
import pytest


@pytest.fixture(autouse=True, scope="package")
def compiled_in_haste() -> Iterator[None]:
    """As `compilations.IN_HASTE`, for programs of the package itself."""
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", False)
