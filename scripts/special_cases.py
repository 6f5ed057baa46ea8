"""The hard cases of the papers as pictures and numbers: ours, a ray cast, and filters of one sharp view.

The truth of the highlights is their closed form, as a ray cast of them would be too noisy to judge by.

For every case, folder OUT gets the picture and a sheet: above, the pinhole view, the ray cast (the truth) and
ours; below, four times the error of ours, multilayer and gather. results.json and results.md hold PSNR in dB
and SSIM against the truth, of linear radiance up to white; how many surfaces lie behind one another at the
deepest place and the layers that ours has; and what is special: how the two branches part, and the energy and
shape of highlights.

    python scripts/special_cases.py --out out/special
    python scripts/special_cases.py --out out/special --only branches highlights --rays 64
"""

import argparse
import math
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import scipy.signal
from _command_line import kept, make_parser, write_json
from _special_scenes import (
    BLADES,
    CASES,
    LAMP_DISPARITY,
    LAMP_SIZE,
    LAMPS,
    SHARP_LAMP,
    TURN,
    WALL,
    SpecialCase,
)

from focusjax.baselines import RayScene, lens_picture, multilayer, pinhole_view
from focusjax.io import save_png
from focusjax.layers import peel, umbra_saving
from focusjax.metrics import psnr, ssim
from focusjax.post import gather, post_process, view_in_layers
from focusjax.trace import render

METHODS = ("ours", "post", "multilayer", "gather")


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for pictures and tables")
    parser.add_argument("--only", nargs="+", choices=list(CASES), default=list(CASES), help="some cases")
    parser.add_argument("--rays", type=int, default=100, help="of ours, per pixel on the average")
    parser.add_argument("--supersampling", type=int, default=2)
    parser.add_argument("--truth-rays", type=int, default=512, help="of the ray cast, per pixel")
    return parser.parse_args()


def study(case: SpecialCase, options: argparse.Namespace) -> tuple[dict, dict[str, np.ndarray]]:
    """All numbers of one case, and its pictures by name."""
    scene, camera, lens = case.scene, case.camera, case.lens
    ready = RayScene(scene)
    truth = kept(
        options.out / "truth" / f"{case.name} {options.truth_rays}.npy",
        lambda: (
            highlights_truth(case)
            if case.name == "highlights"
            else lens_picture(ready, camera, lens, rays=options.truth_rays)
        ),
    )
    layers = peel(scene, camera, lens, supersampling=options.supersampling, max_layers=case.max_layers)
    sharp, disparity = pinhole_view(ready, camera)
    view = view_in_layers(layers, scene)
    pictures = {
        "pinhole": sharp,
        "truth": truth,
        "ours": np.asarray(render(layers, lens, rays=options.rays), dtype=np.float64),
        "post": np.asarray(post_process(view, camera, lens), dtype=np.float64),
        "multilayer": np.asarray(multilayer(sharp, disparity, camera, lens, layers=16)),
        "gather": np.asarray(gather(sharp, disparity, camera, lens, taps=256), dtype=np.float64),
    }
    blurs = [float(lens.blur(camera, camera.principal_point, w)) for w in layers.ranges.overall]
    result = {
        "case": case.name,
        "what": case.what,
        "size": [camera.width, camera.height],
        "rays": options.rays,
        "surfaces behind one another": len(umbra_saving(scene, camera, lens, supersampling=1).plain),
        "layers": layers.filled,
        "complete": layers.complete,
        "blur px": blurs,
        "psnr": {name: psnr(shown(pictures[name]), shown(truth)) for name in METHODS},
        "ssim": {name: ssim(shown(pictures[name]), shown(truth)) for name in METHODS},
        **special(case, pictures),
    }
    return result, pictures


def highlights_truth(case: SpecialCase, fine: int = 8) -> np.ndarray:
    """Every lamp's square, spread over the opening's outline; all in `fine` steps per pixel and axis.

    No lamp's light crosses another or the thing in focus.
    """
    camera, steps = case.camera, np.array([case.camera.height, case.camera.width]) * fine
    radius = abs(float(case.lens.blur(camera, camera.principal_point, jnp.asarray(LAMP_DISPARITY)))) / 2
    edge = 2 * math.ceil(radius + 2)
    y, x = (np.mgrid[: edge * fine, : edge * fine] + 0.5) / fine - edge / 2
    opening = (beyond_opening(x, y, radius) < 0).astype(float)
    out = np.broadcast_to(np.array(WALL), (camera.height, camera.width, 3)).copy()
    for place, radiance in LAMPS:
        square = np.zeros(steps)
        left, top = (round((at - LAMP_SIZE / 2) * fine) for at in place)
        square[top : top + round(LAMP_SIZE * fine), left : left + round(LAMP_SIZE * fine)] = 1.0
        share = scipy.signal.fftconvolve(square, opening / opening.sum(), mode="same")
        share = share.reshape(camera.height, fine, camera.width, fine).mean(axis=(1, 3))
        out += np.maximum(share, 0.0)[..., None] * (np.array(radiance) - WALL)
    (x, y), size = SHARP_LAMP[0], SHARP_LAMP[1]
    half = int(size / 2)
    out[y - half : y + half, x - half : x + half] = SHARP_LAMP[2]
    return out


def beyond_opening(x: np.ndarray, y: np.ndarray, radius: float) -> np.ndarray:
    """How far places lie outside the outline of the blades, whose corners are at `radius`; below 0 inside."""
    sides = TURN + (2 * np.arange(BLADES) + 1) * np.pi / BLADES
    across = np.max([x * np.cos(side) + y * np.sin(side) for side in sides], axis=0)
    return across - radius * np.cos(np.pi / BLADES)


def shown(picture: np.ndarray) -> np.ndarray:
    """A picture as far as a screen could show it: highlights cut to white."""
    return np.clip(picture, 0.0, 1.0)


def special(case: SpecialCase, pictures: dict[str, np.ndarray]) -> dict:
    """What only one case is about."""
    if case.name == "branches":
        return {"parting": {name: parting(pictures[name]) for name in ("truth", *METHODS)}}
    if case.name == "highlights":
        return {"highlights": {name: lights(case, pictures[name]) for name in ("truth", *METHODS)}}
    return {}


def parting(picture: np.ndarray) -> float:
    """How much darker the branches are beside their crossing than in its middle; 1 and less: no parting.

    Light that is missing from the sky, along the row through the crossing: the more of the two sides' peaks
    over what is missing in the middle.
    """
    row = picture[86:95].mean(axis=(0, 2))
    missing = row[[5, -6]].mean() - row
    middle = len(row) // 2
    sides = missing[middle - 16 : middle - 2].max(), missing[middle + 2 : middle + 16].max()
    return float(min(sides) / missing[middle - 1 : middle + 1].mean())


def lights(case: SpecialCase, picture: np.ndarray) -> dict[str, list[float]]:
    """Of each blurred lamp: its energy, what of it lies outside the opening's outline, unevenness inside.

    Energy is over what the lamp's square sends. The outline is the opening's, as large as the blur, with half
    the diagonals of the lamp and of a pixel around it; inside is as far within it, and unevenness is the
    standard deviation there over the mean.
    """
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]] + 0.5
    blur = float(case.lens.blur(case.camera, case.camera.principal_point, jnp.asarray(LAMP_DISPARITY)))
    soft = (LAMP_SIZE + 1.0) / np.sqrt(2.0)
    out: dict[str, list[float]] = {"energy": [], "outside": [], "unevenness": []}
    for place, radiance in LAMPS:
        light = ((picture - WALL) / (np.array(radiance) - WALL)).mean(axis=-1)
        dx, dy = x - place[0], y - place[1]
        near = np.maximum(np.abs(dx), np.abs(dy)) < blur / 2 + soft + 1
        beyond = beyond_opening(dx, dy, blur / 2)
        out["energy"].append(float(light[near].sum() / LAMP_SIZE**2))
        out["outside"].append(float(np.abs(light[near & (beyond > soft)]).sum() / light[near].sum()))
        out["unevenness"].append(float(light[beyond < -soft].std() / light[beyond < -soft].mean()))
    return out


def sheet(pictures: dict[str, np.ndarray]) -> np.ndarray:
    """Pinhole, truth and ours; below them four times the error of ours about grey, multilayer, gather."""
    error = np.clip(0.21 + 4.0 * (shown(pictures["ours"]) - shown(pictures["truth"])), 0.0, 1.0)
    rows = [
        [pictures["pinhole"], pictures["truth"], pictures["ours"]],
        [error, pictures["multilayer"], pictures["gather"]],
    ]
    gap = 4
    return np.concatenate(
        [
            np.concatenate(
                [np.pad(p, ((0, gap), (0, gap), (0, 0)), constant_values=1.0) for p in row], axis=1
            )
            for row in rows
        ]
    )


def markdown(results: list[dict]) -> str:
    """The tables."""
    lines = [
        "| Case | Size | Rays | Surfaces | Layers | Blur px | Ours | Post | Multilayer | Gather |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in results:
        low, high = sorted(abs(blur) for blur in row["blur px"])
        scores = (f"{row['psnr'][name]:.1f} dB, {row['ssim'][name]:.3f}" for name in METHODS)
        lines.append(
            f"| {row['case']} | {row['size'][0]} x {row['size'][1]} | {row['rays']}"
            f" | {row['surfaces behind one another']} | {row['layers']}{'' if row['complete'] else '+'}"
            f" | {low:.0f}, {high:.0f} | {' | '.join(scores)} |"
        )
    for row in results:
        if "parting" in row:
            listed = ", ".join(f"{name} {value:.2f}" for name, value in row["parting"].items())
            lines += ["", f"Branches, darkness beside the crossing over that in its middle: {listed}."]
        for name, found in row.get("highlights", {}).items():
            energy = ", ".join(f"{100 * (value - 1):+.2f} %" for value in found["energy"])
            lines += ["", f"Highlights, {name}: energy {energy}; outside the outline"]
            lines[-1] += (
                f" {100 * max(found['outside']):.2f} %; unevenness {100 * max(found['unevenness']):.1f} %."
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments()
    options.out.mkdir(parents=True, exist_ok=True)
    results = []
    for name in options.only:
        case = CASES[name]()
        result, pictures = study(case, options)
        results.append(result)
        file = name.replace(" ", "_")
        save_png(options.out / f"{file}.png", pictures["ours"])
        save_png(options.out / f"{file}_sheet.png", sheet(pictures))
        print(f"{name}: {result['psnr']}", flush=True)
    print(markdown(results))
    (options.out / "results.md").write_text(markdown(results))
    write_json(options.out / "results.json", results)


if __name__ == "__main__":
    main()
