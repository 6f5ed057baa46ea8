"""What a run reports of the real lens that its picture was made with."""

from typing import Any

from focusjax._settings import metres
from focusjax.job import Outcome
from focusjax.lens import level_glass


def glass_facts(outcome: Outcome) -> dict[str, Any] | None:
    """The real lens in plain values; None where there is none. Errors are the largest of all colours."""
    found = outcome.glass
    if found is None:
        return None
    lens, glass = found.middle, level_glass(found.middle)
    facts: dict[str, Any] = {
        "name": glass.prescription.name,
        "focus_distance_m": float(lens.focus_distance()),
        "f_number": float(lens.f_number(outcome.camera)),
        "film_distance_mm": float(glass.film_place),
        "spectral": outcome.config.lens.spectral,
        "fit": None,
        "poor_fit": found.poor_fit,
    }
    if found.errors:
        facts["fit"] = {
            "worst_px": max(float(error.worst.max()) for error in found.errors),
            "rms_px": max(float(error.rms.max()) for error in found.errors),
            "outline_px": max(float(error.outline.max()) for error in found.errors),
            "light_misplaced": max(float(error.light) for error in found.errors),
            "nearest_m": 1.0 / float(found.errors[0].disparities.max()),
            "expected_db": found.decibels,
        }
    return facts


def glass_sentences(facts: dict[str, Any]) -> list[str]:
    """What `glass_facts` says, for people."""
    colours = ", each colour for itself" if facts["spectral"] else ""
    sentences = [
        f"Through the glass of {facts['name']}{colours}: focused at {metres(facts['focus_distance_m'])},"
        f" the film {facts['film_distance_mm']:.2f} mm behind it."
    ]
    if facts["fit"] is not None:
        fit = facts["fit"]
        sentences.append(
            f"Rays are by polynomials, {fit['worst_px']:.2g} px off at most, {fit['rms_px']:.2g} px RMS down"
            f" to {metres(fit['nearest_m'])}, outlines {fit['outline_px']:.2g} px."
        )
        if fit["expected_db"] is not None:
            sentences.append(
                f"They were chosen for the quality: {fit['expected_db']:.0f} dB are expected of them alone."
            )
    if facts["poor_fit"]:
        sentences.append(f"Rays are traced exactly: {facts['poor_fit']}.")
    return sentences
