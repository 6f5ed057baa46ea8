"""Settings every test runs under: float64, no silent rank promotion, annotations checked."""

import gc
import os
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

# No GPU is assumed.
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("MPLBACKEND", "Agg")
# Most programs here take longer to compile than to run, so that they are compiled in haste; by XLA_FLAGS that
# are set, be it to nothing, as these say.
_HASTE = ["--xla_backend_optimization_level=0", "--xla_cpu_parallel_codegen_split_count=1"]
if tuple(map(int, version("jaxlib").split(".")[:2])) < (0, 11):
    # XLA ends the process at a flag that it has no longer.
    _HASTE.append("--xla_cpu_use_fusion_emitters=false")
os.environ.setdefault("XLA_FLAGS", " ".join(_HASTE))

import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
# Where in the sources each operation comes from is nowhere looked at, and takes XLA time.
jax.config.update("jax_traceback_in_locations_limit", 0)

from jaxtyping import install_import_hook

install_import_hook("focusjax", "annotation_checks.check")

# Tracing makes millions of objects that stay: looking through them as often as usual is a fifth of its time.
gc.set_threshold(50_000, 20, 50)

_MOST_MEMORY = 2 << 30
"""Bytes of a process after which its programs are let go: most of its memory is what compiling left."""
_MOST_ON_DISK = 2 << 30
"""Bytes of programs that are kept for the next run."""
_PROGRAMS = "FOCUSJAX_TESTS_PROGRAMS"
"""The variable that gives the processes of one run the folder of the programs that they share."""


@pytest.fixture(autouse=True, scope="module")
def programs_within_limits() -> Iterator[None]:
    """Compiled programs are let go before they take more memory than two processes have room for."""
    yield
    from focusjax._freed import return_freed, return_programs
    from focusjax._programs import forget_programs

    if _resident() > _MOST_MEMORY:
        forget_programs()
        gc.collect()
        return_freed(_MOST_MEMORY)
    return_programs()


@pytest.fixture(autouse=True)
def programs_of_their_own(request: pytest.FixtureRequest) -> None:
    """Tests that replace parts of focusjax neither keep programs nor use those of others.

    Where nothing of what is compiled is replaced, `contextlib.chdir` and `pytest.MonkeyPatch.context` do.
    """
    if "monkeypatch" in request.fixturenames:
        from focusjax import _program_files

        request.getfixturevalue("monkeypatch").setattr(_program_files, "kept_in", lambda: None)


def pytest_configure(config: pytest.Config) -> None:
    """Every program is compiled once, whichever process and test ask for it, and whichever run.

    Programs lie in pytest's own folder, which `--cache-clear` empties; none is found again when what it is
    made of has changed. Without such a folder every process compiles what it needs.
    """
    if not _is_worker(config):
        os.environ[_PROGRAMS] = ""
        with suppress(OSError, AttributeError):
            os.environ[_PROGRAMS] = str(config.cache.mkdir("programs"))
    folder = os.environ[_PROGRAMS]
    if folder:
        # Each process clears the folder where it is to be cleared.
        Path(folder).mkdir(parents=True, exist_ok=True)
    jax.config.update("jax_compilation_cache_dir", folder or None)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def pytest_unconfigure(config: pytest.Config) -> None:
    """What was not used for longest goes where there is too much."""
    if not _is_worker(config) and (folder := os.environ.pop(_PROGRAMS, "")):
        from focusjax._program_files import forget_the_oldest

        forget_the_oldest(Path(folder), "*", _MOST_ON_DISK)


def _resident() -> int:
    """Bytes of memory that this process holds; 0 where the system does not say."""
    statm = Path("/proc/self/statm")
    return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGESIZE") if statm.exists() else 0


def _is_worker(config: pytest.Config) -> bool:
    """Whether this is one of several processes that run the tests."""
    return hasattr(config, "workerinput")
