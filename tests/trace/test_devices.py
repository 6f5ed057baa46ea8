"""Devices and processes that share a picture make the same one."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
from small_scenes import varied_layers

from focusjax.trace import render

PROGRAM = """
import sys
import jax

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_num_cpu_devices", 2)
file, rank, port = sys.argv[1], int(sys.argv[2]), sys.argv[3]
jax.distributed.initialize(f"localhost:{port}", num_processes=2, process_id=rank)

import numpy as np
from small_scenes import front_camera, patch, wide_lens

from focusjax.layers import peel
from focusjax.scene import make_scene
from focusjax.trace import _devices, render

assert len(jax.devices()) == 4 and len(jax.local_devices()) == 2
# So few that there are several parts for all.
_devices.at_once = lambda **_: 1024
camera = front_camera(32, 24)
lens = wide_lens(camera, pixels_per_dioptre=14.0)
lamp = patch("lamp", camera, (20, 9, 22, 11), 1.6, (60, 40, 20))
wall = patch("wall", camera, (-60, -60, 90, 90), 0.25, (0.2, 0.3, 0.2))
layers = peel(make_scene([lamp, wall], unlit=True), camera, lens, supersampling=1)
kinds = {"one": jax.local_devices()[:1], "two": jax.local_devices(), "all": jax.devices()}
np.savez(file, **{name: render(layers, lens, rays=16, devices=some) for name, some in kinds.items()})
"""


@pytest.mark.slow
def test_two_processes_of_two_devices_each_make_the_picture_of_one(tmp_path: Path):
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    files = [tmp_path / f"{rank}.npz" for rank in range(2)]
    roots = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2])]
    around = os.environ | {
        "PYTHONPATH": os.pathsep.join(roots),
        "JAX_PLATFORMS": "cpu",
        "JAX_COMPILATION_CACHE_DIR": jax.config.jax_compilation_cache_dir or "",
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.1",
    }
    running = [
        subprocess.Popen(
            [sys.executable, "-c", PROGRAM, str(file), str(rank), str(port)],
            env=around,
            stderr=subprocess.PIPE,
            text=True,
        )
        for rank, file in enumerate(files)
    ]
    for process in running:
        _, errors = process.communicate(timeout=240)
        assert process.returncode == 0, errors
    first, second = (np.load(file) for file in files)
    # The wall has 0.3, and the lamp is seen before it.
    assert first["one"].max() > 0.5
    for file in (first, second):
        for kind in ("two", "all"):
            # Observed: 4e-16; light is added up in another order.
            np.testing.assert_allclose(file[kind], first["one"], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("count", [0, 2])
def test_no_device_and_one_named_twice_are_refused(count: int):
    layers = varied_layers()
    with pytest.raises(ValueError, match="expected at least one, each named once, such as jax"):
        render(layers, layers.lens, rays=4, devices=jax.devices()[:1] * count)
