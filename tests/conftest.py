"""Settings every test runs under: float64, no silent rank promotion, annotations checked."""

import os

# No GPU is assumed, and a test must not share compiled programs with another run of the suite.
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("MPLBACKEND", "Agg")

import jax

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")

from jaxtyping import install_import_hook

install_import_hook("focusjax", "annotation_checks.check")
