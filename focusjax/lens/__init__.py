"""Lenses as sources of rays, and the shapes of their openings."""

from focusjax.lens._aperture import AbstractAperture as AbstractAperture
from focusjax.lens._aperture import Disk as Disk
from focusjax.lens._aperture import Polygon as Polygon
from focusjax.lens._aperture import polygon as polygon
from focusjax.lens._base import AbstractLens as AbstractLens
from focusjax.lens._thin import ThinLens as ThinLens
from focusjax.lens._thin import thin_lens as thin_lens
