"""Settings as a photographer writes them."""

import math


def metres(value: float | str) -> str:
    """A distance as a photographer writes it; a plane that meets the view axis behind the lens says so."""
    value = float(value)
    if math.isinf(value):
        return "∞"
    if value < 0:
        return f"{metres(-value)} behind the lens"
    if value < 1:
        return f"{100 * value:.3g} cm"
    return f"{value:.2f} m" if value < 100 else f"{value:.0f} m"


def f_number(value: float | str) -> str:
    """An f-number as engraved on a lens."""
    value = float(value)
    if math.isinf(value):
        return "pinhole"
    return f"f/{value:.2f}" if value < 1 else f"f/{value:.1f}" if value < 10 else f"f/{value:.0f}"


def angle(degrees: float) -> str:
    """A tilt or swing with its sign."""
    return f"{0.0 if abs(degrees) < 0.005 else degrees:+.2f}°"


def shutter(seconds: float) -> str:
    """A shutter time as it is engraved: 1/60 s, or 2.5 s."""
    if seconds >= 0.3:
        return f"{seconds:.3g} s"
    return f"1/{1 / seconds:.0f} s" if seconds < 0.01 else f"1/{1 / seconds:.3g} s"
