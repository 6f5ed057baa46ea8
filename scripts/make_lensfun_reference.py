"""Shares of light by lensfun itself, for tests/lens/test_profile.py.

Needs lensfunpy (`pip install lensfunpy`), which focusjax does not.

    python scripts/make_lensfun_reference.py
"""

import tempfile
from pathlib import Path

import lensfunpy  # type: ignore[import-not-found]
import numpy as np

DATABASE = """<lensdatabase version="1">
<mount><name>Mount</name></mount>
<camera><maker>M</maker><model>Camera</model><mount>Mount</mount><cropfactor>1.5</cropfactor></camera>
<lens><maker>M</maker><model>One 50mm</model><mount>Mount</mount><cropfactor>1.5</cropfactor>
<calibration>
<vignetting model="pa" focal="50" aperture="2" distance="1000" k1="-0.9" k2="0.5" k3="-0.2"/>
<vignetting model="pa" focal="50" aperture="4" distance="1000" k1="-0.3" k2="0.1" k3="-0.05"/>
<vignetting model="pa" focal="50" aperture="2" distance="1" k1="-0.7" k2="0.3" k3="-0.1"/>
</calibration></lens></lensdatabase>"""
WIDTH, HEIGHT = 601, 401
SETTINGS = ((2.0, 1000.0), (2.8, 10.0), (4.0, 1.0))
"""f-number and focus distance in metres."""
PLACES = {"half-way": (200, 450), "edge": (200, 600), "corner": (0, 0)}
"""Row and column."""


def main() -> None:
    """Prints a line for each setting."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "database.xml"
        path.write_text(DATABASE)
        database = lensfunpy.Database(paths=[str(path)], load_common=False, load_bundled=False)
        camera = database.find_cameras("M", "Camera")[0]
        lens = database.find_lenses(camera, "M", "One 50mm")[0]
        for aperture, distance in SETTINGS:
            corrections = lensfunpy.Modifier(lens, camera.crop_factor, WIDTH, HEIGHT)
            corrections.initialize(50, aperture, distance, pixel_format=np.float32)
            picture = np.ones((HEIGHT, WIDTH, 3), dtype=np.float32)
            corrections.apply_color_modification(picture)
            shares = {name: 1.0 / float(picture[place][0]) for name, place in PLACES.items()}
            print(f"f/{aperture:g}, {distance:g} m: {shares}")


if __name__ == "__main__":
    main()
