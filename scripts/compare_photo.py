"""A photograph with depth against the scene that it shows: quality of refocusing, and what was guessed.

Scenes of configs are rendered sharp, with their depth at pixel centres. That picture alone is refocused: as
a photograph, by `multilayer` and by `gather`; the truth is the lens in the real scene. "Seen" are pixels of
which less than 1 % of the light was guessed, "inner" those farther from the frame than the widest blur
reaches, both for the three in turn. Values are cut to 0 to 1, as a display shows them; highlights are kept
in the sharp picture, or cut with `--display`, as a photograph has them.

`--oracle` adds a second table that says what limits the photograph, by PSNR over the whole picture and over
what is seen. A part of the truth at a time takes the place of what the photograph has to estimate:

- hidden: what was not photographed, behind foregrounds and beyond the frame, is the real scene;
- beyond: what is beyond the frame alone is;
- twice: the picture and its depth have twice the pixels along each side, as have the layers;
- scene: all is the real scene, with as many layer samples as the photograph has pixels: what is left is the
  error of the layers, which have one sample per pixel, and of the rays.

    python scripts/compare_photo.py
    python scripts/compare_photo.py --oracle --focus 1 --configs configs/still_life.toml
"""

import dataclasses
from pathlib import Path

import numpy as np
from _command_line import make_parser, make_table
from _photo_oracle import with_real_scene
from rich.console import Console

from focusjax.baselines import multilayer
from focusjax.config import build_camera, build_scene, load_config
from focusjax.layers import disparity_map, peel
from focusjax.lens import thin_lens
from focusjax.metrics import psnr, ssim
from focusjax.photo import GUESS, HOLES, Photo
from focusjax.post import gather
from focusjax.trace import render, render_pinhole

CONFIGS = [Path("configs") / f"{name}.toml" for name in ("still_life", "town", "tilted_row", "bars")]
SEEN = 0.01


def guessed_picture(scene, camera, lens, rays):
    """Light of guesses alone [h, w]."""
    kept = (
        set(np.unique(scene.face_material[list(scene.objects[GUESS])])) if GUESS in scene.objects else set()
    )
    dark = tuple(
        each if k in kept else dataclasses.replace(each, base_colour=np.zeros(3))
        for k, each in enumerate(scene.materials)
    )
    layers = peel(dataclasses.replace(scene, materials=dark), camera, lens)
    return np.asarray(render(layers, lens, rays=rays)).sum(axis=2)


def distances_at(disparity, shares):
    """Focus distances at shares of the range of disparity."""
    low, high = np.percentile(disparity[disparity > 0], [2, 98])
    return [1.0 / (low + share * (high - low)) for share in shares]


def photo_of(scene, camera, lens, path, display):
    """The photograph, with exact depth, that `camera` takes of `scene`."""
    sharp = np.asarray(render_pinhole(peel(scene, camera, lens, supersampling=2)))
    disparity = np.asarray(disparity_map(scene, camera))
    sharp = np.clip(sharp, 0.0, 1.0 if display else None)
    return Photo(sharp, disparity, np.ones(disparity.shape, dtype=bool), camera, 1, path)


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("--configs", nargs="*", type=Path, default=CONFIGS)
    parser.add_argument("--size", default="320x240", help="in pixels")
    parser.add_argument("--f-number", type=float, help="in place of the config's widest")
    parser.add_argument("--focus", type=float, nargs="+", default=[0.0, 1.0], help="0 far, 1 near")
    parser.add_argument("--rays", type=int, default=64)
    parser.add_argument("--truth-rays", type=int, default=256)
    parser.add_argument("--display", action="store_true", help="cut highlights of the sharp picture")
    parser.add_argument("--oracle", action="store_true", help="also what parts of the truth would gain")
    options = parser.parse_args()
    size = [int(side) for side in options.size.split("x")]
    style = {"box": None, "header_style": "dim"}
    headings = ("scene", "focus", "guessed", "photo", "multilayer", "gather", "seen", "guessed part", "inner")
    table = make_table("PSNR in dB, SSIM", *headings, **style)
    title = "PSNR in dB, whole / seen, with a part of the truth known"
    headings = ("scene", "focus", "photo", "hidden", "beyond", "twice", "scene")
    known = make_table(title, *headings, **style)
    for path in options.configs:
        config = load_config(path, [f"camera.resolution={size}"])
        scene, camera = build_scene(config), build_camera(config)
        length = float(camera.focal_length)
        number = options.f_number or min(config.widest_f_number, config.lens.f_number or np.inf)
        focus = {"focal_length": length, "f_number": number}
        widest = thin_lens(focus_distance=1.0, **focus)
        photo = photo_of(scene, camera, widest, path, options.display)
        sharp, disparity = photo.light, photo.disparity
        guess = photo.scene(f_number=number)
        assert HOLES not in guess.objects
        if options.oracle:
            doubled = load_config(path, [f"camera.resolution={[2 * side for side in size]}"])
            finer = photo_of(scene, build_camera(doubled), widest, path, options.display)
            finer = finer.scene(f_number=number)
        reach = int(float(camera.focal_px) * float(widest.aperture_radius) * np.ptp(disparity)) + 1
        inner = np.zeros(disparity.shape, dtype=bool)
        inner[reach:-reach, reach:-reach] = True
        for distance in distances_at(disparity, options.focus):
            lens = thin_lens(focus_distance=distance, **focus)
            truth, layers = peel(scene, camera, lens, supersampling=2), peel(guess, camera, lens)
            real = np.clip(np.asarray(render(truth, lens, rays=options.truth_rays)), 0.0, 1.0)
            raw = np.asarray(render(layers, lens, rays=options.rays))
            share = guessed_picture(guess, camera, lens, 16) / np.maximum(raw.sum(axis=2), 1e-9)
            ours = np.clip(raw, 0.0, 1.0)
            filtered = (
                multilayer(sharp, disparity, camera, lens, layers=32),
                np.asarray(gather(sharp, disparity, camera, lens, taps=128)),
            )
            shown = [ours, *(np.clip(each, 0.0, 1.0) for each in filtered)]
            seen = share < SEEN
            masks = (seen, ~seen, inner)
            table.add_row(
                path.stem,
                f"{distance:.3g} m",
                f"{100 * (share * raw.sum(axis=2)).sum() / raw.sum():.1f} %",
                *(f"{psnr(each, real):.2f} {ssim(each, real):.4f}" for each in shown),
                *(
                    " / ".join(f"{psnr(each, real, mask=mask):.1f}" if mask.any() else "-" for each in shown)
                    for mask in masks
                ),
            )
            if options.oracle:
                pictures = [ours]
                for each in (
                    with_real_scene(scene, guess, camera, lens),
                    with_real_scene(scene, guess, camera, lens, behind=False),
                    peel(finer, camera, lens, supersampling=2),
                    peel(scene, camera, lens),
                ):
                    pictures.append(np.clip(np.asarray(render(each, lens, rays=options.rays)), 0.0, 1.0))
                known.add_row(
                    path.stem,
                    f"{distance:.3g} m",
                    *(f"{psnr(each, real):.1f} / {psnr(each, real, mask=seen):.1f}" for each in pictures),
                )
    console = Console(width=200)
    console.print(table)
    if options.oracle:
        console.print(known)


if __name__ == "__main__":
    main()
