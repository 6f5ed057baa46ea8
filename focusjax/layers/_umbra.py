"""What a surface hides from every lens ray: the extended umbra of Lee10 section 3.1.

A sample of surface at depth d hides from a lens of radius E what lies within x = d s / (E - s) behind it, s
being the world width of a sample there. In disparity that is plain:

    w_cut = w - 1 / (f E),

the step that moves a ray by one sample at the lens rim (f E in samples per dioptre).

The paper widens each sample to the centres of its neighbours to gain that whole sample, and asks the
tracer to draw silhouettes wider too. We keep silhouettes where they are, so a lone sample is half a sample
wide to each side and hides half the umbra from rays to its centre, w_cut = w - 0.5 / (f E). In exchange we
use the surfaces that samples belong to: where all samples up to r away continue one another, a ray must
travel at least r under the surface to get here, starting at most at the nearest of them,

    w_cut = max over (2 r + 1)^2 of w  -  r / (f E),        r = 1, 2, 4, ...,

so that what a solid object hides is dropped but for a border as wide as the parallax.
"""

import numpy as np
from jaxtyping import Float

from focusjax._parallel import in_parallel, parts

SEPARATION = 1e-5
"""Relative step in disparity below which two surfaces count as one (coincident triangles)."""
_ROWS_AT_ONCE = 32
"""So few that what is made of them stays in the cache."""


def windows_within(parallax: float, nearest: float) -> int:
    """How many windows it takes to reach farther than rays move under a surface at disparity `nearest`."""
    return int(parallax * nearest).bit_length() + 1


def hidden_below(
    best: Float[np.ndarray, "h w"],
    parallax: float,
    *,
    windows: int = 1,
    solid: Float[np.ndarray, "h w"] | None = None,
) -> Float[np.ndarray, "h w"]:
    """Disparity that the next surface must stay below for a ray to reach it; infinite where nothing hides.

    Args:
        best: disparity of a surface at each sample; 0 where there is none.
        parallax: f E in samples per dioptre.
        windows: how many of the radii 1, 2, 4, ... to look at for solid surface.
        solid: the opaque surface that hides what lies farther, 0 where there is none; `best` if not given.
    """
    hiding = best if solid is None else solid
    real = best.dtype.type
    umbra = real(1.0) / real(max(parallax, 1e-30))
    cut, nearest = np.empty_like(best), np.empty_like(best)

    def start(band: slice) -> bool:
        if not (hiding[band].any() or best[band].any()):
            cut[band] = nearest[band] = np.inf
            return False
        near = _around(hiding, band, 1, np.maximum, out=nearest[band])
        far = _around(hiding, band, 1, np.minimum, out=np.empty_like(near))
        # Infinite where the surface ends within the window: there it hides nothing.
        near[(far <= 0) | (near - far > umbra)] = np.inf
        near = _ending_outside(near, band, len(best), 1)
        alone = hiding[band] - real(0.5) * umbra
        alone[hiding[band] <= 0] = np.inf
        below = best[band] * real(1.0 - SEPARATION)
        below[best[band] <= 0] = np.inf
        np.minimum(np.minimum(below, alone), near - umbra, out=cut[band])
        return bool(near.min(initial=np.inf) < np.inf)

    bands = parts(len(best), _ROWS_AT_ONCE)
    going_on = in_parallel(start, bands)
    # Windows grow by doubling: that of radius 2 r is nine of radius r, steps of r apart.
    # Continuity has to hold within one sample of every sample but the outermost.
    for reach in (1 << level for level in range(windows - 1)):
        bands = [band for band, on in zip(bands, going_on, strict=True) if on]
        wider = np.full_like(nearest, np.inf)

        def widen(band: slice, nearest=nearest, wider=wider, reach=reach) -> bool:
            near = _around(nearest, band, reach, np.maximum, out=wider[band])
            near = _ending_outside(near, band, len(best), reach)
            np.minimum(cut[band], near - real(2 * reach) * umbra, out=cut[band])
            return bool(near.min(initial=np.inf) < np.inf)

        going_on = in_parallel(widen, bands)
        nearest = wider
    return cut


def _around(a: np.ndarray, band: slice, reach: int, op: np.ufunc, *, out: np.ndarray) -> np.ndarray:
    """`op` over the nine places 0 and `reach` away in x and y, those of them on the grid, of some rows."""
    down = a[band].copy()
    for shift in (-reach, reach):
        begin, end = (min(max(row + shift, 0), len(a)) for row in (band.start, band.stop))
        there = down[begin - shift - band.start : end - shift - band.start]
        op(there, a[begin:end], out=there)
    out[:, :reach] = down[:, :reach]
    op(down[:, reach:], down[:, :-reach], out=out[:, reach:])
    op(out[:, :-reach], down[:, reach:], out=out[:, :-reach])
    return out


def _ending_outside(a: np.ndarray, band: slice, rows: int, reach: int) -> np.ndarray:
    """Values `a` of the rows `band` of so many, infinite within `reach` of the border."""
    a[: max(reach - band.start, 0)] = np.inf
    a[max(rows - reach - band.start, 0) :] = np.inf
    a[:, :reach] = np.inf
    a[:, max(a.shape[1] - reach, 0) :] = np.inf
    return a
