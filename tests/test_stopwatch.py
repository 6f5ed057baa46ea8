"""Seconds are counted once, and compiling is counted apart from work."""

import time

import jax
import jax.numpy as jnp
import pytest

from focusjax._stopwatch import Stopwatch


def test_stages_compile_time_and_order():
    stages = []
    watch = Stopwatch(on_stage=stages.append)
    with watch.stage("sleep"):
        time.sleep(0.05)
    with watch.stage("compile"):
        jax.jit(lambda x: jnp.sin(x) + 41.5)(jnp.ones(17)).block_until_ready()
    assert stages == ["sleep", "compile"]
    assert watch.seconds["sleep"] >= 0.05
    assert watch.compile_seconds["sleep"] == 0.0
    assert watch.compile_seconds["compile"] > 0.0


def test_a_stage_that_fails_is_counted_and_listens_no_longer():
    watch = Stopwatch()
    with pytest.raises(RuntimeError, match="stop"), watch.stage("bad"):
        raise RuntimeError("stop")
    before = dict(watch.compile_seconds)
    jax.jit(lambda x: jnp.cos(x) + 43.5)(jnp.ones(23)).block_until_ready()
    assert watch.compile_seconds == before
    assert "bad" in watch.seconds
