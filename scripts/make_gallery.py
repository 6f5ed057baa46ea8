"""The pictures of the gallery page, each by its name, into docs/gallery.

    python scripts/make_gallery.py conflict surface film gradient
    python scripts/make_gallery.py photo --photo pug_color.jpg --depth pug_disp.png --set ...

The photograph and its depth are given, with what their depth means as keys of `[scene.photo]`.
"""

import argparse
import json
import tempfile
from pathlib import Path

import imageio.v3 as iio
import jax
import jax.numpy as jnp
import numpy as np
from _command_line import make_parser
from _sheets import beside
from PIL import Image
from typer.testing import CliRunner

import focusjax as fj
from focusjax.cli import app
from focusjax.config import (
    build_camera,
    build_focus_points,
    build_lens,
    build_scene,
    build_solve_options,
    load_config,
)

ROOT = Path(__file__).parents[1]
CONFIGS = ROOT / "configs"


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("names", nargs="+", choices=list(PICTURES), help="which pictures")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "gallery", help="a folder")
    parser.add_argument("--rays", type=int, default=128, help="per pixel, on the average")
    parser.add_argument("--size", nargs=2, type=int, default=[480, 360], help="of a picture, in pixels")
    parser.add_argument("--photo", type=Path, help="a photograph, for the picture `photo`")
    parser.add_argument("--depth", type=Path, help="its depth")
    parser.add_argument("--sharp", action="append", help="X,Y of what is to be sharp in it")
    parser.add_argument("--name", default="photo", help="of the picture `photo`")
    parser.add_argument("--option", action="append", default=[], help="more of `focusjax refocus`")
    return parser.parse_args()


def focusjax(*words: str | Path) -> str:
    """What a command prints; it may miss wishes, and may not fail."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    if result.exit_code not in (0, 3):
        raise SystemExit(result.output)
    return result.output


def sized(options: argparse.Namespace) -> list[str]:
    return [f"camera.resolution={list(options.size)}", f"render.rays={options.rays}"]


def set_all(keys: list[str]) -> list[str]:
    return [word for key in keys for word in ("--set", key)]


def save(path: Path, picture: np.ndarray) -> None:
    iio.imwrite(path, picture, quality=90)
    print(f"{path}: {path.stat().st_size // 1024} KiB")


def conflict(options: argparse.Namespace) -> None:
    """Three wishes that no lens can meet: the best compromise, and what is reported of it."""
    height = options.size[1] / 480
    wishes = (
        "focus=[{object='spot', sharp=true, tolerance_px=1}, {object='jug', sharp=true, tolerance_px=1},"
        f" {{object='lamp', at_least_px={20 * height:g}, tolerance_px=1}}]"
    )
    with tempfile.TemporaryDirectory() as folder:
        focusjax("run", CONFIGS / "still_life.toml", "--out", folder, *set_all([*sized(options), wishes]))
        save(options.out / "conflict.jpg", iio.imread(Path(folder) / "image.png")[..., :3])
    config = load_config(CONFIGS / "still_life.toml", [*sized(options), wishes])
    camera, scene = build_camera(config), build_scene(config)
    points = fj.find_points(build_focus_points(config, scene), scene, camera)
    lens = build_lens(config, camera, solved=True)
    solution = fj.solve(points, camera, lens, **build_solve_options(config))
    (options.out / "conflict.txt").write_text(f"{solution}\n", "utf-8")


def surface(options: argparse.Namespace) -> None:
    """A focal surface beside the plane that is focused on Spot."""
    config = CONFIGS / "focal_surface.toml"
    with tempfile.TemporaryDirectory() as folder:
        focusjax("run", config, "--out", folder, *set_all(sized(options)))
        curved = iio.imread(Path(folder) / "image.png")
    read = load_config(config, sized(options))
    camera, scene = build_camera(read), build_scene(read)
    lens = fj.thin_lens(focus_distance=0.73, f_number=2.8, focal_length=float(camera.focal_length))
    flat = fj.render(fj.peel(scene, camera, lens), lens, rays=options.rays)
    with tempfile.TemporaryDirectory() as folder:
        fj.save_png(Path(folder) / "flat.png", flat)
        save(options.out / "focal_surface.jpg", beside(iio.imread(Path(folder) / "flat.png"), curved))


def film(options: argparse.Namespace) -> None:
    """A rack focus: every second frame, forth and back, as an animated WebP."""
    numbers = range(1, 49, 2)
    with tempfile.TemporaryDirectory() as folder:
        focusjax(
            "shot", CONFIGS / "rack_focus.toml", "--out", folder, "--frames",
            ",".join(map(str, numbers)), *set_all(sized(options)),
        )  # fmt: skip
        frames = [Image.open(Path(folder) / "frames" / f"frame_{n:04d}.png").convert("RGB") for n in numbers]
    path = options.out / "rack_focus.webp"
    there = [frames[0]] * 6 + frames + [frames[-1]] * 6
    there[0].save(
        path, save_all=True, append_images=[*there[1:], *frames[-2:0:-1]], duration=83, loop=0, quality=78
    )
    print(f"{path}: {path.stat().st_size // 1024} KiB")


def three(options: argparse.Namespace, config: str, numbers: tuple[int, int, int], name: str) -> None:
    """Three frames of a shot, which is solved whole."""
    with tempfile.TemporaryDirectory() as folder:
        focusjax(
            "shot", CONFIGS / config, "--out", folder, "--frames", ",".join(map(str, numbers)),
            *set_all(sized(options)),
        )  # fmt: skip
        frames = [iio.imread(Path(folder) / "frames" / f"frame_{number:04d}.png") for number in numbers]
    save(options.out / f"{name}.jpg", beside(*frames))


def glass(options: argparse.Namespace) -> None:
    """A rack focus through a double Gauss."""
    three(options, "rack_focus_glass.toml", (1, 28, 48), "glass_film")


def actors(options: argparse.Namespace) -> None:
    """A focal surface that follows two actors."""
    three(options, "two_actors.toml", (1, 20, 40), "two_actors")


def photo(options: argparse.Namespace) -> None:
    """A photograph beside itself refocused; where several places are to be sharp in turn, these alone."""
    if not (options.photo and options.depth and options.sharp):
        raise SystemExit("photo needs --photo FILE, --depth FILE and --sharp X,Y")
    made = []
    for place in options.sharp:
        with tempfile.TemporaryDirectory() as folder:
            focusjax(
                "refocus", options.photo, "--depth", options.depth, "--sharp", place, "--out", folder,
                "--set", f"render.rays={options.rays}", *options.option,
            )  # fmt: skip
            made.append(iio.imread(Path(folder) / "image.png"))
            print(json.loads((Path(folder) / "report.json").read_text())["picture"])
    if len(made) == 1:
        size = made[0].shape[1], made[0].shape[0]
        made.insert(0, np.asarray(Image.open(options.photo).convert("RGB").resize(size)))
    save(options.out / f"{options.name}.jpg", beside(*made))


def gradient(options: argparse.Namespace) -> None:
    """The still life, and its derivative by the focus: red gets brighter as the focus comes nearer."""
    config = load_config(CONFIGS / "still_life.toml", sized(options))
    camera, scene = build_camera(config), build_scene(config)
    points = fj.find_points(build_focus_points(config, scene), scene, camera)
    lens = fj.solve(
        points, camera, build_lens(config, camera, solved=True), **build_solve_options(config)
    ).lens
    layers = fj.peel(scene, camera, lens, supersampling=2)
    direction = jax.tree.map(jnp.zeros_like, lens)
    direction = type(lens)(**{**vars(direction), "focus_disparity": jnp.ones_like(lens.focus_disparity)})
    picture, slope = jax.jvp(
        lambda lens: fj.render(layers, lens, rays=4 * options.rays), (lens,), (direction,)
    )
    slope = np.asarray(slope.mean(axis=-1))
    most = np.quantile(np.abs(slope), 0.99)
    share = np.clip(slope / most, -1, 1)[..., None]
    # From white to a red and to a blue, as bright as each other.
    coloured = 255 * (1 - np.abs(share) * np.where(share > 0, [0.2, 0.8, 0.85], [0.85, 0.6, 0.15]))
    with tempfile.TemporaryDirectory() as folder:
        fj.save_png(Path(folder) / "picture.png", picture)
        shown = iio.imread(Path(folder) / "picture.png")
    save(options.out / "gradient.jpg", beside(shown, coloured.astype(np.uint8)))


PICTURES = {
    "conflict": conflict,
    "surface": surface,
    "film": film,
    "glass": glass,
    "actors": actors,
    "photo": photo,
    "gradient": gradient,
}


def main() -> None:
    options = arguments()
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.names:
        PICTURES[name](options)


if __name__ == "__main__":
    main()
