"""Learns from pictures that focusjax made how blurred a patch of 16 x 16 pixels is.

As it stands it prints, after about three minutes on two busy cores:

    the network is off by 1.20 px on pictures it never saw
    a constant is off by 1.80 px on pictures it never saw
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import optax

from focusjax.dataset import load_dataset, make_dataset, spec_of

SIZE, COUNT, SEEN, STEPS = 128, 240, 200, 2000
spec = spec_of({"camera": {"resolution": [SIZE, SIZE]}, "lens": {"f_number": {"log_uniform": [0.5, 4]}}})
make_dataset(spec, COUNT, "blur_pictures", resume=True)


def patches(plane):
    return plane.reshape(SIZE // 16, 16, SIZE // 16, 16).swapaxes(1, 2).reshape(-1, 16, 16)


def spectra(picture):
    power = np.abs(
        np.fft.rfft2(patches(picture["defocused"].mean(-1)) * np.outer(np.hanning(16), np.hanning(16)))
    )
    return np.log(power + 1e-3).reshape(len(power), -1)


pictures = list(load_dataset("blur_pictures"))
x = np.stack([spectra(picture) for picture in pictures])
y = np.stack([np.log1p(patches(np.abs(picture["coc_px"])).mean((1, 2))) for picture in pictures])
x = np.float32((x - x[:SEEN].mean((0, 1))) / x[:SEEN].std((0, 1)))
(x, new_x), (y, new_y) = ((np.concatenate(a[:SEEN]), np.concatenate(a[SEEN:])) for a in (x, y))


def network(layers, x):
    for matrix, shift in layers[:-1]:
        x = jnp.tanh(x @ matrix + shift)
    return (x @ layers[-1][0] + layers[-1][1])[:, 0]


@jax.jit
def step(layers, state, x, y):
    slope = jax.grad(lambda layers: jnp.mean((network(layers, x) - y) ** 2))(layers)
    change, state = optimizer.update(slope, state, layers)
    return optax.apply_updates(layers, change), state


random, sizes = np.random.default_rng(0), itertools.pairwise([x.shape[1], 64, 32, 1])
layers = [(random.normal(size=(a, b)) / a**0.5, np.zeros((1, b))) for a, b in sizes]
layers = jax.tree.map(jnp.float32, layers)
optimizer = optax.adamw(optax.cosine_decay_schedule(3e-3, STEPS), weight_decay=1e-2)
state = optimizer.init(layers)
for _ in range(STEPS):
    rows = random.integers(len(x), size=512)
    layers, state = step(layers, state, x[rows], y[rows])

for name, guess in (("the network", network(layers, new_x)), ("a constant", np.median(y))):
    off = np.abs(np.expm1(guess) - np.expm1(new_y)).mean()
    print(f"{name} is off by {off:.2f} px on pictures it never saw")
