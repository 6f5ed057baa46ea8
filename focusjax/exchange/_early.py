"""What is known of an export before the solve, and refused then."""

from focusjax.config import Config, ConfigError, build_camera, build_lens, build_look
from focusjax.exchange._fitting import ExportError, Target, features, refusal
from focusjax.exchange._record import record_of


def refuse_a_shot(config: Config) -> None:
    """Refuse the frames of a lens that is exported for single pictures.

    Raises:
        ExportError: it has a focal surface, or is a real lens.
    """
    single = {
        "lens.focal_surface": (config.lens.focal_surface, "a focal surface"),
        f"lens.{config.lens.real}": (config.lens.real, "a real lens"),
    }
    for key, (given, what) in single.items():
        if given is not None and config.shot is not None and config.shot.frames > 1:
            raise ExportError(
                f"{config.source}: has {key}, and {what} is exported for a single picture, not for a shot;"
                " leave out --shot (shot=False), or the [shot] table"
            )


def refuse_tilted_glass(config: Config) -> None:
    """Refuse a real lens that is turned.

    Raises:
        ExportError: it is, or may be by what is solved for.
    """
    turned = [f"lens.{key}" for key in ("tilt_deg", "swing_deg") if getattr(config.lens, key)]
    if config.focus:
        turned += [f"{name!r} in solve.free" for name in ("tilt", "swing") if name in config.solve.free]
    if config.lens.real is not None and turned:
        glass = f"lens.{config.lens.real}"
        raise ExportError(
            f"{config.source}: has {glass} and {turned[0]}, and no target has a real lens that is tilted;"
            f" leave out {glass} for the ideal lens of these settings, or {turned[0]}"
        )


def early_features(config: Config, *, shot: bool) -> dict[str, str]:
    """Those `features` of a config's camera that a solve leaves as they are, as the config has them."""
    found: dict[str, str] = {}
    if config.lens.height_field is not None:
        found["odd glass"] = "a real lens with a height field"
    elif config.lens.prescription is not None:
        found["glass"] = f"a real lens ({config.lens.prescription})"
    if config.lens.focal_surface is not None:
        found["surface"] = "a focal surface"
    try:
        camera = build_camera(config)
        lens = build_lens(config, camera, solved=True)
        seen = lens if found or not config.lens.look else build_look(config, camera, lens)
    except ConfigError:
        # Keyframes may give what is missing here; if not, the solve says so.
        return found
    changing = set(config.solve.free) if config.focus else set()
    if shot and config.shot is not None:
        changing |= {key.rpartition("_")[0] for each in config.shot.lens for key in each.model_fields_set}
        # The sensor grows then, and with it what a pixel is.
        changing |= {"focal_length"} if config.shot.keep_field_of_view else set()
    may_change = {
        "tilt": {"tilt", "swing"},
        "shift": {"shift", "rise"},
        "fine shift": {"shift", "rise", "focal_length"},
    }
    known = features(record_of(camera, seen))
    return found | {key: words for key, words in known.items() if not changing & may_change.get(key, set())}


def refuse_early(config: Config, target: Target, targets: dict[str, Target], *, shot: bool) -> None:
    """Refuse what the target cannot have whatever is solved for.

    Raises:
        ExportError: there is something.
    """
    found = early_features(config, shot=shot)
    if found.keys() - set(target.has):
        raise ExportError(f"{config.source}: {refusal(found, target, targets)}")
