"""Make the lens profiles in focusjax/lens/data from the prescriptions that come with focusjax.

Every number is computed from traced rays, but for the ranges, which prescriptions do not state: the smallest
opening is f/16, and the nearest focus is ten focal lengths away, where the profile is compared with the rays
once more. What the profile leaves of the rays stands in the file's head.

    python scripts/make_lens_profiles.py --out focusjax/lens/data
"""

import argparse
import dataclasses
from pathlib import Path

import jax
import numpy as np
from _command_line import make_parser

from focusjax.lens import ProfileFit, profile_of, save_profile
from focusjax.optics import PRESETS, converging_length, lens_preset

NAMES = {
    "planar_f4.5": "planar_us583336_f4.5_1897",
    "gauss_f1.8": "gauss_jp62087922_f1.8_1987",
    "retrofocus_f2": "retrofocus_35mm_f2",
    "triplet_f4": "cooke_triplet_50mm_f4",
    "biogon_f4.5": "biogon_us2721499_f4.5_1955",
    "gauss_f2": "gauss_us2673491_f2_1954",
    "sonnar_f2": "sonnar_us1998704_f2_1935",
}
FOCUS, NEAREST = 50.0, 10.0
"""Focal lengths: where the tables are made, and the near end of the range."""


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the files")
    parser.add_argument("--only", nargs="+", choices=list(NAMES), default=list(NAMES))
    return parser.parse_args()


def comment(fit: ProfileFit, at: str) -> str:
    """The RMS distances on the film, on the axis, half-way and at the end, in micrometres."""
    some = [0, len(fit.heights) // 2, len(fit.heights) - 1]
    rows = [
        f"  {1e3 * fit.heights[k]:5.2f} mm from the axis: {1e6 * fit.ideal_rms[k]:.1f} um without,"
        f" {1e6 * fit.rms[k]:.1f} um with it"
        for k in some
    ]
    return "\n".join([f"RMS distance of rays from those of an ideal lens, {at}:", *rows])


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    options = arguments()
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.only:
        prescription = lens_preset(NAMES[name])
        focal = 1e-3 * converging_length(prescription)
        source = (
            f"traced through {NAMES[name]} (focusjax/optics/data/CREDITS.md), focused at {FOCUS:g} focal"
            " lengths, by scripts/make_lens_profiles.py"
        )
        fit = profile_of(prescription, focus_distance=FOCUS * focal, nearest=NEAREST * focal, source=source)
        near = profile_of(prescription, focus_distance=NEAREST * focal)
        changed = [
            f"  {key}: {1e3 * abs(np.asarray(curve.values) - np.asarray(other.values)).max():.3g} thousandths"
            for (key, curve), (_, other) in zip(fit.profile.curves(), near.profile.curves(), strict=True)
            if key in ("distortion", "sagittal_focus", "tangential_focus", "spherical")
        ]
        head = "\n".join(
            [
                "Made by scripts/make_lens_profiles.py. Ranges are chosen: f/16, and ten focal lengths.",
                comment(fit, f"focused at {FOCUS * focal:.3g} m"),
                f"Largest change of tables (share, or dioptres) when focused at {NEAREST * focal:.3g} m:",
                *changed,
            ]
        )
        titled = dataclasses.replace(fit.profile, title=PRESETS[NAMES[name]].title)
        save_profile(options.out / f"{name}.toml", titled, comment=head)
        print(head, flush=True)


if __name__ == "__main__":
    main()
