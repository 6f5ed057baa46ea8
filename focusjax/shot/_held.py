"""Which settings of a shot's lens are free in which frames."""

from focusjax.config import SETTINGS, Config, ShotTable, values_of
from focusjax.shot._lens_track import LensTrack


def held_frames(config: Config, table: ShotTable, track: LensTrack) -> dict[str, tuple[bool, ...]]:
    """By the names of settings that are free in some frames only: in which frames they are held.

    Raises:
        ValueError: a setting that is keyed and free in one frame, or free in none.
    """
    free, keyed = config.solve.free, {}
    for key, name in SETTINGS.items():
        frames = list(track.keyed.get(key, ()))
        if key == "focal_length_mm":
            frames += list(values_of(table.camera, key))
        keyed[name] = frames
    for each in table.free:
        if each.name not in free:
            raise ValueError(
                f"free: {each.name} has frames in which it is free, and is not in solve.free, which is"
                f" {list(free)}; add it there, or leave them out"
            )
    if table.keep_size_of is not None and "focal_length" in free:
        raise ValueError(
            "keep_size_of sets the focal length, and solve.free has focal_length; leave one of them out"
        )
    found = {}
    ranges = {each.name: each for each in table.free}
    for name in free:
        frames, range_ = keyed[name], ranges.get(name)
        if frames and range_ is None:
            raise ValueError(
                f"{name} has a keyframe at frame {frames[0]:g} and is in solve.free, so that it is keyed and"
                f' free at once; leave one of them out, or say with [[shot.free]] name = "{name}" in which'
                " frames it is free"
            )
        if range_ is None:
            continue
        both = [frame for frame in frames if range_.has(frame)]
        if both:
            raise ValueError(
                f"{name} has a keyframe at frame {both[0]:g}, in which [[shot.free]] has it free"
                f" ({range_.frames}); move the keyframe or the frames"
            )
        held = tuple(not range_.has(frame) for frame in range(1, table.frames + 1))
        if all(held):
            raise ValueError(
                f"{name} is free {range_.frames}, which is none of the shot's frames 1 to {table.frames};"
                " change them, or leave it out of solve.free"
            )
        if any(held) and not frames and name == "focus" and config.lens.focus_distance_m is None:
            raise ValueError(
                f"{name} is free {range_.frames} alone and has no value in other frames; give"
                " lens.focus_distance_m, or keyframes of focus_distance_m"
            )
        if any(held):
            found[name] = held
    return found
