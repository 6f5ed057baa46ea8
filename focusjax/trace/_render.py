"""The picture."""

from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._arguments import require_switches
from focusjax._counts import require_counts, require_seed
from focusjax.layers import Layers
from focusjax.lens import AbstractLens
from focusjax.trace._allot import FEWEST
from focusjax.trace._devices import Device
from focusjax.trace._tracer import ready_tracer


def render(
    layers: Layers,
    lens: AbstractLens,
    *,
    rays: int = 64,
    even: bool = False,
    smooth: bool | None = None,
    pixel_filter: str | None = None,
    seed: int = 0,
    devices: Sequence[Device] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Float[Array, "h w 3"]:
    """The picture that `lens` forms of `layers`: linear radiance, mean over the rays of each pixel.

    Args:
        layers: peeled for this lens or for one whose rays go farther.
        lens: any lens.
        rays: rays per pixel on the average; each has its own place in the pixel and on the lens. They go
            where what they may meet differs, up to eight times as many, and four where it is all alike; see
            `_allot`. Fewer than four are the same for all. Up to half of them are aimed at small highlights
            out of focus, where there are such; see `_highlights`.
        even: give just `rays` to every pixel, be it plain or not, those that are aimed apart.
        smooth: take the noise out of what is blurred, by averaging over a few tenths of its blur with the
            pixels around, less the more rays there are; see `_reconstruct`. Otherwise each pixel is the mean
            of its own rays, as it is with `even` unless this says otherwise.
        pixel_filter: "box", "tent" or "gaussian", how the light around a pixel's centre counts: its rays are
            spread with that density. The one that the layers were peeled for if not given.
        seed: chooses the rays; the same seed gives the same picture.
        devices: what traces it, all devices of this process if not given. With `jax.devices()` the processes
            of `jax.distributed`, of which each has the layers and calls this, share the work, and each gets
            the whole picture.
        progress: called with the share done, 0 to 1, now and then.

    Raises:
        ValueError: no rays, no such filter, a lens or filter whose rays leave what the layers were peeled
            for, or devices of some other processes only.
    """
    require_counts(rays=rays)
    require_seed(seed)
    smooth = not even if smooth is None else smooth
    require_switches(even=even, smooth=smooth)
    tracer, camera = ready_tracer(layers, lens, pixel_filter, devices), layers.camera
    alike = even or rays < FEWEST
    counts = np.full(camera.width * camera.height, rays) if alike else tracer.counts(rays)
    traced = tracer.trace(counts, rays, seed, progress, classes=tracer.classes if smooth else None)
    means = traced.smooth()
    return jnp.asarray(means.reshape(camera.height, camera.width, 3))
