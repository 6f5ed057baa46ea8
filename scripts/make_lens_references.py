"""Reference numbers for tests/optics by Optiland: rays, first-order data, Seidel sums, indices.

    python scripts/make_lens_references.py tests/data/lens_references.json

It needs Optiland 0.6.3 beside focusjax (`pip install optiland==0.6.3`), which is heavy and no dependency of
either focusjax or its tests. Optiland is given radii, distances and, for each wavelength, indices; it traces
and adds up by itself. Indices of glasses come from its own catalogue.
"""

import csv
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optiland
from _command_line import make_parser
from optiland.materials import IdealMaterial, MaterialFile
from optiland.optic import Optic
from optiland.rays import RealRays

from focusjax.optics import (
    PRESETS,
    Conic,
    EvenAsphere,
    Prescription,
    find_glass,
    first_order,
    lens_preset,
    make_prescription,
    singlet,
)

WAVELENGTHS = (475.0, 587.5618, 650.0)
FIELDS_DEG = (0.0, 7.0, 14.0, 20.0)
TABLE = Path(__file__).parents[1] / "focusjax/optics/data/glass_dispersion.csv"
PUPIL = ((0.0, 0.0), (0.0, 0.5), (0.4, -0.3), (0.0, -0.8), (0.7, 0.5), (-0.9, 0.0))


def lenses() -> dict[str, Prescription]:
    """The shipped lenses, three spherical singlets, and two with conic and aspheric surfaces."""
    glass = find_glass("N-BK7")

    def aspheric(front, name):
        back = Conic(jnp.asarray(-1 / 80.0), jnp.asarray(-2.0))
        return make_prescription(
            [front, back], [6.0, 0.0], [9.0, 9.0], [glass, find_glass("air")], stop=0, name=name
        )

    fourth = jnp.asarray([0.0, 2e-6, -3e-9, 1e-12])
    own = (
        singlet(50.0, -50.0, thickness=5.0, semi_diameter=9.0, glass=glass, name="biconvex"),
        singlet(float("inf"), -30.0, thickness=4.0, semi_diameter=9.0, glass=glass, name="planoconvex"),
        singlet(20.0, 45.0, thickness=4.0, semi_diameter=9.0, glass=find_glass("N-SF11"), name="meniscus"),
        aspheric(Conic(jnp.asarray(1 / 40.0), jnp.asarray(-0.6)), "conic"),
        aspheric(EvenAsphere(jnp.asarray(1 / 40.0), jnp.asarray(0.3), fourth), "asphere"),
    )
    return {**{name: lens_preset(name) for name in PRESETS}, **{lens.name: lens for lens in own}}


def in_optiland(lens: Prescription, wavelength: float) -> Optic:
    """The lens with the indices of one wavelength; the film is as far as the file says, or 50 mm."""
    indices = np.asarray(lens.indices(jnp.asarray(wavelength)))
    optic = Optic()
    optic.surfaces.add(index=0, thickness=np.inf)
    for number, surface in enumerate(lens.surfaces):
        gap = float(lens.thicknesses[number])
        last = number + 1 == len(lens.surfaces)
        more = {}
        if isinstance(surface, EvenAsphere):
            more = {"surface_type": "even_asphere", "coefficients": [float(c) for c in surface.coefficients]}
            # Its search stops within 1e-10 mm by default, which off the axis leaves more than that.
            more["tol"] = 1e-15
        optic.surfaces.add(
            index=number + 1,
            radius=1.0 / float(surface.curvature) if float(surface.curvature) else np.inf,
            conic=float(surface.conic),
            thickness=50.0 if last and gap == 0.0 else gap,
            material=IdealMaterial(n=float(indices[number + 1])),
            is_stop=number == lens.stop,
            **more,
        )
    optic.surfaces.add(index=len(lens.surfaces) + 1)
    optic.set_aperture("EPD", 2.0 * float(first_order(lens, jnp.asarray(wavelength)).entrance_pupil_radius))
    optic.fields.set_type("angle")
    optic.fields.add(y=0.0)
    optic.fields.add(y=FIELDS_DEG[-1])
    optic.wavelengths.add(value=wavelength * 1e-3, is_primary=True)
    return optic


def rays_of(lens: Prescription, optic: Optic, wavelength: float) -> list[dict]:
    """Rays from infinity through points of the paraxial entrance pupil, to the film."""
    seen = first_order(lens, jnp.asarray(wavelength))
    place, radius = float(seen.entrance_pupil), float(seen.entrance_pupil_radius)
    rows = []
    for field in FIELDS_DEG:
        direction = np.array([0.0, np.sin(np.radians(field)), np.cos(np.radians(field))])
        for u, v in PUPIL:
            point = np.array([u * radius, v * radius, place])
            start = point - direction * (place + 60.0)
            one = [np.array([value]) for value in (*start, *direction, 1.0, wavelength * 1e-3)]
            rays = RealRays(*one)
            optic.surfaces.trace(rays)
            end = [float(value[0]) for value in (rays.x, rays.y, rays.z, rays.L, rays.M, rays.N)]
            if np.isfinite(end).all():
                rows.append({"start": start.tolist(), "direction": direction.tolist(), "end": end})
    return rows


def references(lens: Prescription) -> dict:
    """All of one lens."""
    found = {"rays": {}}
    for wavelength in WAVELENGTHS:
        optic = in_optiland(lens, wavelength)
        found["rays"][str(wavelength)] = rays_of(lens, optic, wavelength)
    optic = in_optiland(lens, WAVELENGTHS[1])
    paraxial = optic.paraxial
    found["first_order"] = {
        "focal_length": float(np.squeeze(paraxial.f2())),
        "front_focal_distance": float(np.squeeze(paraxial.F1())),
        "image_focal_point": float(np.squeeze(paraxial.F2())),
        "entrance_pupil": float(np.squeeze(paraxial.EPL())),
        "exit_pupil": float(np.squeeze(paraxial.XPL())),
        "exit_pupil_diameter": float(np.squeeze(paraxial.XPD())),
        "f_number": float(np.squeeze(paraxial.FNO())),
    }
    found["seidel"] = [float(value) for value in np.squeeze(optic.aberrations.seidels())]
    return found


def indices() -> dict[str, list[float]]:
    """Of the glasses of the table, but for crystals and plastics, at the three wavelengths."""
    database = Path(optiland.__file__).parent / "database/data-nk/glass"
    found = {}
    for row in csv.DictReader(TABLE.read_text().splitlines()):
        if row["maker"] != "other":
            # By file: two names of its index lead to other glasses.
            glass = MaterialFile(str(database / row["maker"] / f"{row['glass']}.yml"))
            found[row["glass"]] = [float(np.squeeze(glass.n(wave * 1e-3))) for wave in WAVELENGTHS]
    return found


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    parser = make_parser(__doc__)
    parser.add_argument("out", type=Path)
    out = parser.parse_args().out
    content = {
        "made_by": "scripts/make_lens_references.py with optiland 0.6.3",
        "wavelengths_nm": WAVELENGTHS,
        "field_deg": FIELDS_DEG[-1],
        "lenses": {name: references(lens) for name, lens in lenses().items()},
        "indices": indices(),
    }
    out.write_text(json.dumps(content, indent=None, separators=(",", ":")) + "\n")
    for name, found in content["lenses"].items():
        print(
            name, {wavelength: len(rays) for wavelength, rays in found["rays"].items()}, found["first_order"]
        )
        print("   ", found["seidel"])


if __name__ == "__main__":
    main()
