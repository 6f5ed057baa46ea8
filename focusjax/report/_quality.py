"""What a run reports of the quality that was asked for, and of the ways to it."""

from typing import Any

from focusjax.job import Outcome


def quality_facts(outcome: Outcome) -> dict[str, Any] | None:
    """What was wanted, expected and reached; None where no quality was asked for.

    Under `weighed` is what was expected of each way where there was a choice. Of rays that were not planned,
    since even the fewest would take longer than post-processing, only their seconds are given.
    """
    picture = outcome.picture
    if picture is None or picture.way is None:
        return None
    way = picture.way
    taken = way.post if way.by_post else way.traced
    assert taken is not None
    facts: dict[str, Any] = {
        "wanted": outcome.config.render.quality,
        "expected_db": taken.decibels,
        "expected_seconds": taken.seconds,
        "reached_db": picture.decibels,
        "seconds": outcome.seconds["render"],
        "weighed": None,
    }
    if way.post is not None:
        fewest = {"rays": None, "expected_db": None, "expected_seconds": way.post.fewest_seconds}
        facts["weighed"] = {
            "chosen": picture.method,
            "post": {
                "places": way.post.taps,
                "expected_db": way.post.decibels,
                "at_least_db": way.post.at_least,
                "reaches": way.post.reaches,
                "expected_seconds": way.post.seconds,
            },
            "trace": fewest
            if way.traced is None
            else {
                "rays": way.traced.rays,
                "expected_db": way.traced.decibels,
                "expected_seconds": way.traced.seconds,
            },
        }
    return facts


def quality_sentence(facts: dict[str, Any]) -> str | None:
    """Which way was chosen, for people; None where there was no choice."""
    weighed = facts["weighed"]
    if weighed is None:
        return None
    post, trace = weighed["post"], weighed["trace"]
    taken = "Post-processed" if weighed["chosen"] == "post" else "Traced"
    blurring = (
        f"{post['expected_db']:.1f} dB, and {post['at_least_db']:.1f} dB at least, are expected of"
        f" post-processing in {post['expected_seconds']:.2g} s"
    )
    seconds = f"{trace['expected_seconds']:.2g} s"
    tracing = (
        f"even the fewest rays would take {seconds}"
        if trace["rays"] is None
        else f"{trace['expected_db']:.1f} dB of {trace['rays']} rays per pixel in {seconds}"
    )
    wanted = facts["wanted"] if isinstance(facts["wanted"], str) else f"{facts['wanted']:g} dB"
    return (
        f"{taken} for {wanted}: {blurring}; {tracing}."
        f" Reached: {facts['reached_db']:.1f} dB in {facts['seconds']:.2g} s."
    )
