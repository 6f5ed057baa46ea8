"""Settings every test runs under: float64, no silent rank promotion, annotations checked."""

import gc
import os
from collections.abc import Iterator
from pathlib import Path

# No GPU is assumed, and a test must not share compiled programs with another run of the suite.
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("MPLBACKEND", "Agg")

import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")

from jaxtyping import install_import_hook

install_import_hook("focusjax", "annotation_checks.check")

_MOST_MAPPINGS = 24000
"""Of memory, well below the 65530 that Linux allows a process: each compiled program takes some."""


@pytest.fixture(autouse=True, scope="module")
def programs_within_limits() -> Iterator[None]:
    """Compiled programs are let go before there are more of them than a process can map into memory."""
    yield
    mappings = Path("/proc/self/maps")
    if mappings.exists() and mappings.read_bytes().count(b"\n") > _MOST_MAPPINGS:
        jax.clear_caches()
        gc.collect()
