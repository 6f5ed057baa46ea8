"""How the error falls with the rays, away from silhouettes and near them, and with the layers.

Two errors are reported, each the root of the mean square. That of the rays is against a picture of very many
rays through the same layers; it has no floor. The whole error is against a ray cast of the triangles, which
shows what the layers leave. Every pixel gets as many rays, but for the last column, where they go where they
matter. Exponents are those of straight lines through all points, log against log.

    python scripts/convergence.py --out out/convergence
"""

import argparse
from pathlib import Path

import numpy as np
import scipy.ndimage
from _command_line import make_parser, write_json
from _special_scenes import SpecialCase, smooth_things

from focusjax.baselines import RayScene, lens_picture
from focusjax.bench import near_silhouettes
from focusjax.layers import disparity_map, peel
from focusjax.trace import render

WANTED = {"smooth": 0.75, "silhouettes": 0.5}
"""Exponents that the error should fall with at least."""


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the plot and the tables")
    parser.add_argument("--rays", nargs="+", type=int, default=[4, 8, 16, 32, 64, 128, 256, 512])
    parser.add_argument("--reference-rays", type=int, default=8192, help="through the same layers")
    parser.add_argument("--truth-rays", type=int, default=512, help="of the ray cast")
    parser.add_argument("--supersampling", type=int, default=2)
    return parser.parse_args()


def regions(case: SpecialCase) -> dict[str, np.ndarray]:
    """Masks [h, w] of pixels whose rays meet silhouettes, and of those that are two pixels from them."""
    near = near_silhouettes(disparity_map(case.scene, case.camera), case.camera, case.lens)
    return {"smooth": ~scipy.ndimage.binary_dilation(near, iterations=2), "silhouettes": near}


def exponent(numbers: list[int], errors: list[float]) -> float:
    """E of error ~ number ** -e, by least squares."""
    return -float(np.polyfit(np.log(numbers), np.log(errors), 1)[0])


def against_rays(case: SpecialCase, truth: np.ndarray, options: argparse.Namespace) -> dict:
    """Errors by region, for each number of rays."""
    lens, masks = case.lens, regions(case)
    layers = peel(case.scene, case.camera, lens, supersampling=options.supersampling)

    def picture(rays: int, seed: int, *, even: bool) -> np.ndarray:
        return np.asarray(
            render(layers, lens, rays=rays, seed=seed, even=even, smooth=False), dtype=np.float64
        )

    halves = [picture(options.reference_rays // 2, seed, even=True) for seed in (101, 102)]
    converged = np.mean(halves, axis=0)
    rows = []
    for rays in options.rays:
        even, chosen = (picture(rays, 0, even=which) for which in (True, False))
        row = {"rays": rays, "where they matter": rms(chosen - converged)}
        for name, mask in masks.items():
            row[name] = rms((even - converged)[mask])
            row[f"{name}, whole"] = rms((even - truth)[mask])
        rows.append(row)
    return {
        "share": {name: float(mask.mean()) for name, mask in masks.items()},
        # Half of what its halves differ by, at most.
        "reference": {name: rms((halves[0] - halves[1])[mask]) / 2 for name, mask in masks.items()},
        "floor": {name: rms((converged - truth)[mask]) for name, mask in masks.items()},
        "exponents": {
            name: exponent(options.rays, [row[name] for row in rows])
            for name in (*masks, "where they matter")
        },
        "rows": rows,
    }


def against_layers(case: SpecialCase, truth: np.ndarray, options: argparse.Namespace) -> list[dict]:
    """Whole error for each number of layers, up to all that there are."""
    rows: list[dict] = []
    for most in range(1, 17):
        layers = peel(
            case.scene, case.camera, case.lens, supersampling=options.supersampling, max_layers=most
        )
        if layers.filled < most:
            break
        picture = np.asarray(
            render(layers, case.lens, rays=max(options.rays), smooth=False), dtype=np.float64
        )
        rows.append({"layers": layers.filled, "error": rms(picture - truth), "complete": layers.complete})
    return rows


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def plot(rays: dict, layers: list[dict], file: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    numbers = [row["rays"] for row in rays["rows"]]
    for colour, (name, wanted) in zip(("C0", "C3"), WANTED.items(), strict=True):
        errors = [row[name] for row in rays["rows"]]
        label = f"{name}: rays$^{{-{rays['exponents'][name]:.2f}}}$"
        left.loglog(numbers, errors, "o-", color=colour, label=label)
        whole = [row[f"{name}, whole"] for row in rays["rows"]]
        left.loglog(numbers, whole, "x--", color=colour, alpha=0.6, label=f"{name}, against the ray cast")
        line = errors[0] * (np.array(numbers) / numbers[0]) ** -wanted
        left.loglog(numbers, line, ":", color=colour, label=f"rays$^{{-{wanted}}}$")
    left.set_xlabel("rays per pixel")
    left.set_ylabel("error (root of the mean square)")
    right.semilogy([row["layers"] for row in layers], [row["error"] for row in layers], "o-")
    right.set_xlabel("layers")
    right.set_xticks([row["layers"] for row in layers])
    for axes in (left, right):
        axes.grid(alpha=0.3, which="both")
    left.legend(fontsize=8)
    figure.savefig(file, dpi=130)


def markdown(rays: dict, layers: list[dict]) -> str:
    names = ("smooth", "silhouettes", "where they matter", "smooth, whole", "silhouettes, whole")
    lines = ["| Rays | " + " | ".join(names) + " |", "| --- " * (len(names) + 1) + "|"]
    for row in rays["rows"]:
        lines.append(f"| {row['rays']} | " + " | ".join(f"{row[name]:.5f}" for name in names) + " |")
    listed = ", ".join(f"{name} {value:.2f}" for name, value in rays["exponents"].items())
    lines += ["", f"Exponents: {listed} (wanted: {', '.join(f'{n} {v}' for n, v in WANTED.items())})."]
    lines += ["", "| Layers | Error |", "| --- | --- |"]
    lines += [f"| {row['layers']}{'' if row['complete'] else '+'} | {row['error']:.5f} |" for row in layers]
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments()
    options.out.mkdir(parents=True, exist_ok=True)
    case = smooth_things()
    truth = lens_picture(RayScene(case.scene), case.camera, case.lens, rays=options.truth_rays)
    rays, layers = against_rays(case, truth, options), against_layers(case, truth, options)
    print(markdown(rays, layers))
    (options.out / "convergence.md").write_text(markdown(rays, layers))
    write_json(options.out / "convergence.json", {"rays": rays, "layers": layers})
    plot(rays, layers, options.out / "convergence.png")


if __name__ == "__main__":
    main()
