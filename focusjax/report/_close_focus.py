"""What a model of close focus says of a lens, in numbers and in words."""

from typing import Any

from focusjax._settings import f_number
from focusjax.job import Outcome


def close_focus_facts(outcome: Outcome) -> dict[str, Any] | None:
    """Image distance, magnification and the light near the lens; None where close focus is ignored."""
    model, settings = outcome.config.lens.close_focus, outcome.settings
    if model == "ignored":
        return None
    return {
        "model": model,
        "image_distance_mm": 1000 * float(settings.image_distance),
        "magnification": float(settings.magnification),
        "working_f_number": float(settings.working_f_number()),
        "sentence": close_focus_sentence(outcome),
    }


def close_focus_sentence(outcome: Outcome) -> str | None:
    """The facts in a sentence; None where close focus is ignored."""
    model, settings = outcome.config.lens.close_focus, outcome.settings
    if model == "ignored":
        return None
    length, distance = (1000 * float(each) for each in (settings.focal_length, settings.image_distance))
    stays = (
        f"the framing stays that of {distance:.3g} mm, and the focal length is {length:.3g} mm"
        if model == "framing"
        else f"the focal length stays {length:.3g} mm, and the framing is that of {distance:.3g} mm"
    )
    return (
        f"Focused there, at magnification {float(settings.magnification):.2g}, {stays}; the light is that of"
        f" {f_number(float(settings.working_f_number()))}."
    )
