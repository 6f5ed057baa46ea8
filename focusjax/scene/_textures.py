"""The pictures of a scene file, each once."""

import io
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from PIL import Image

from focusjax.scene._images import brightness_of, fill_hidden, opacity_of, open_picture, texture_of
from focusjax.scene._material import UNTEXTURED
from focusjax.scene._sizes import check_pixels


@dataclass
class TextureTable:
    """Collects each picture once, however many materials use it.

    Attributes:
        source: the file they belong to, for messages.
        find: reads a file that the source refers to by name; raises if it cannot.
        pictures: linear colours [h, w, 3].
        opacities: opacity pictures [h, w].
    """

    source: str
    find: Callable[[str], bytes]
    pictures: list[Float[np.ndarray, "_ _ 3"]] = field(default_factory=list)
    opacities: list[Float[np.ndarray, "_ _"]] = field(default_factory=list)
    _numbers: dict[tuple[int, bool], tuple[int, int]] = field(default_factory=dict)
    _images: list[Image.Image] = field(default_factory=list)

    def numbers(self, image: Image.Image, *, opaque: bool) -> tuple[int, int]:
        """The numbers of the colours and of the opacity of `image`, -1 for an opacity that it lacks.

        Args:
            image: a picture, maybe not yet read.
            opaque: its alpha channel means nothing.

        Returns:
            -1 twice, with a warning, when the data are damaged.
        """
        key = (id(image), opaque)
        if key not in self._numbers:
            try:
                check_pixels(image.size)
                picture = texture_of(image)
                opacity = None if opaque else opacity_of(image)
            except (OSError, SyntaxError, ValueError) as error:
                warnings.warn(
                    f"a texture in {self.source} cannot be decoded ({error}); using the material colour",
                    stacklevel=2,
                )
                return UNTEXTURED, UNTEXTURED
            # The image is kept so that its id stays its own.
            self._images.append(image)
            shown = picture if opacity is None else fill_hidden(picture, opacity)
            self.pictures.append(shown)
            self._numbers[key] = len(self.pictures) - 1, self.add_opacity(opacity)
        return self._numbers[key]

    def add_opacity(self, opacity: Float[np.ndarray, "_ _"] | None) -> int:
        """The number of an opacity picture, -1 for none."""
        if opacity is None:
            return UNTEXTURED
        self.opacities.append(opacity)
        return len(self.opacities) - 1

    def opacity_file(self, name: str) -> int:
        """The number of the opacity map in the file `name`, or -1 with a warning when it cannot be used."""
        try:
            with open_picture(io.BytesIO(self.find(name))) as image:
                alpha = opacity_of(image)
                return self.add_opacity(brightness_of(image) if alpha is None else alpha)
        except Exception as error:
            warnings.warn(
                f"{self.source} refers to the opacity map {name}, which cannot be read"
                f" ({type(error).__name__}); the material is taken as opaque",
                stacklevel=2,
            )
            return UNTEXTURED
