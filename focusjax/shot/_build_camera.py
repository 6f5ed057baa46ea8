"""From the camera's tables of a config with a shot to the camera at any frame."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from focusjax.config import Config, ShotTable, about_key, values_of
from focusjax.geometry import Camera
from focusjax.job import camera_between
from focusjax.motion import Keyframes, MovingScene, Path, keyframes
from focusjax.shot._lens_track import LensTrack


def build_path(
    config: Config, table: ShotTable, camera: Camera, track: LensTrack, scene: MovingScene
) -> Path:
    """The camera of a shot's config at any frame.

    Raises:
        ValueError: keyframes that contradict the camera's, or each other.
    """
    view = config.camera
    size: dict[str, Any] = {
        "sensor_width": view.sensor_width_mm / 1000,
        "shift": _metres(track.value("shift_mm")) or view.shift_mm / 1000,
        "rise": _metres(track.value("rise_mm")) or view.rise_mm / 1000,
    }
    length: float | Keyframes = float(camera.focal_length)
    lengths = table_keys(table, values_of(table.camera, "focal_length_mm")) or track.value("focal_length_mm")
    if lengths is not None:
        length = Keyframes(lengths.frames, lengths.values / 1000, lengths.between)
        if table.keep_field_of_view:
            wide = size["sensor_width"] / float(camera.focal_length)
            size["sensor_width"] = Keyframes(length.frames, wide * length.values, length.between)
            for name, value in (("shift", view.shift_mm), ("rise", view.rise_mm)):
                if value or isinstance(size[name], Keyframes):
                    raise ValueError(
                        f"there is a {name} of the lens and keep_field_of_view, with which the sensor's size"
                        " changes; leave one of them out"
                    )
    if table.keep_size_of is not None:
        size["keep_size_at"] = _kept_point(table.keep_size_of, scene)
    return camera_between(
        view,
        camera,
        table_keys(table, values_of(table.camera, "position")),
        table_keys(table, values_of(table.camera, "look_at")),
        values_of(table.camera, "matrix"),
        between=table.between,
        focal_length=length,
        **size,
    )


def _metres(keys: Keyframes | None) -> Keyframes | None:
    return None if keys is None else Keyframes(keys.frames, keys.values / 1000, keys.between)


def _kept_point(
    which: str | Sequence[float], scene: MovingScene
) -> Callable[[float], Float[np.ndarray, "3"]]:
    """A point, or the middle of an object wherever it goes, by frame."""
    if not isinstance(which, str):
        return _Fixed(np.asarray(which, dtype=float))
    still = scene.at(1)
    with about_key("keep_size_of"):
        faces = still.face_range(which)
    return _Middle(scene, np.unique(still.faces[faces.start : faces.stop]))


@dataclasses.dataclass(frozen=True)
class _Fixed:
    """A point that stays where it is."""

    point: Float[np.ndarray, "3"]

    def __call__(self, frame: float) -> Float[np.ndarray, "3"]:
        return self.point


@dataclasses.dataclass(frozen=True)
class _Middle:
    """The middle of what vertices of a scene span, by frame."""

    scene: MovingScene
    rows: Int[np.ndarray, " v"]

    def __call__(self, frame: float) -> Float[np.ndarray, "3"]:
        corners = self.scene.at(frame).vertices[self.rows]
        return 0.5 * (corners.min(axis=0) + corners.max(axis=0))


def table_keys(table: ShotTable, values: Mapping[float, Any]) -> Keyframes | None:
    """The keyframes of `values` by frame, interpolated as `[shot]` says; None where there are none."""
    return keyframes(values, between=table.between) if values else None
