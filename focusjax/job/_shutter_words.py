"""A shutter time in words."""


def shutter(seconds: float) -> str:
    """A shutter time as it is engraved: 1/60 s, or 2.5 s."""
    if seconds >= 0.3:
        return f"{seconds:.3g} s"
    return f"1/{1 / seconds:.0f} s" if seconds < 0.01 else f"1/{1 / seconds:.3g} s"
