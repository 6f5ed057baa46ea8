"""Write a config of 600 000 triangles: lumpy balls before a painted wall, for `focusjax bench`.

python scripts/make_boulders.py out/boulders
focusjax bench speed-error out/boulders/boulders.toml --out out/bench
"""

from pathlib import Path

import numpy as np
import trimesh
from _command_line import make_parser
from _procedural import boulders, wall

CONFIG = """title = "Boulders"
[scene]
unlit = true
objects = [{ file = "boulders.ply", name = "boulders" }, { file = "wall.ply", name = "wall" }]
[camera]
position = [0, 0, 0]
look_at = [0, 0, -1]
field_of_view_deg = 39.3
resolution = [800, 600]
[lens]
aperture_radius_mm = 50
focus_distance_m = 5.0
"""


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("folder", type=Path, help="made if need be")
    parser.add_argument("--balls", type=int, default=120, help="of 5120 triangles each")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    boulders(options.balls).export(options.folder / "boulders.ply")
    surface = wall()
    # Colours of files are sRGB in bytes.
    paint = np.round(255 * np.clip(surface.colours, 0, 1) ** (1 / 2.2)).astype(np.uint8)
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, vertex_colors=paint, process=False)
    mesh.export(options.folder / "wall.ply")
    (options.folder / "boulders.toml").write_text(CONFIG)


if __name__ == "__main__":
    main()
