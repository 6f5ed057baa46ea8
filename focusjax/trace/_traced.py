"""What the rays of a picture have brought, and the picture it makes, smoothed or not."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array

from focusjax.trace._known_light import KnownLight, evened
from focusjax.trace._reconstruct import reconstruct


@dataclasses.dataclass(frozen=True)
class Traced:
    """Means over the rays of each pixel, row-major.

    Attributes:
        sums: of weight times radiance, up to white, 1, in red, green and blue, and of weight, once or in each
            colour; for one class of blur [p, k c] after the other.
        over: of what is brighter than white, what is beyond that. A kernel that is right for a thing of its
            own brightness may be off by 1 % of it beside, which is much beside a lamp; so that is left as
            the rays have it.
        aimed: what rays aimed at small highlights bring beside; 0 where there are none.
        least: least blur of each class, as `BlurClasses` has it.
        width: pixels per row.
        rays: per pixel on the average.
        known: the light that is known to get through the lens; None where all passes.
    """

    sums: csr_array
    over: Float[np.ndarray, "p 3"]
    aimed: Float[np.ndarray, "p 3"] | float
    least: tuple[float, ...]
    width: int
    rays: int
    known: KnownLight | None

    def raw(self) -> Float[np.ndarray, "p 3"]:
        """Each pixel by its own rays."""
        return self._evened(self._of_all_classes(slice(3)) + self.over) + self.aimed

    def smooth(self) -> Float[np.ndarray, "p 3"]:
        """With those of the pixels around, as far as what they meet is blurred."""
        if len(self.least) == 1:
            return self.raw()
        light = self._light()
        share = light if self.known is None else np.asarray(self.known.of(light))
        means = reconstruct(self.sums, self.width, self.least, self.rays) * share
        return means + self._evened(self.over) + self.aimed

    def _evened(self, brought: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p 3"]:
        return brought if self.known is None else np.asarray(evened(brought, self._light(), self.known))

    def _light(self) -> Float[np.ndarray, "p 3"]:
        return np.broadcast_to(self._of_all_classes(slice(3, None)), self.over.shape)

    def _of_all_classes(self, numbers: slice) -> Float[np.ndarray, "p n"]:
        """Some of the `numbers` told of each class, added up."""
        told = self.sums.shape[1] // len(self.least)  # pyright: ignore[reportOptionalSubscript]
        chosen = np.eye(told, dtype=self.over.dtype)[:, numbers]
        return self.sums @ np.tile(chosen, (len(self.least), 1))
