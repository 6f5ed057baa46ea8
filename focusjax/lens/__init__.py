"""Lenses as sources of rays, and the shapes of their openings."""

from focusjax.lens._aperture import AbstractAperture as AbstractAperture
from focusjax.lens._aperture import Disk as Disk
from focusjax.lens._aperture import Polygon as Polygon
from focusjax.lens._aperture import polygon as polygon
from focusjax.lens._back import tilt_back as tilt_back
from focusjax.lens._base import AbstractLens as AbstractLens
from focusjax.lens._scheimpflug import MAX_TILT as MAX_TILT
from focusjax.lens._scheimpflug import Movements as Movements
from focusjax.lens._scheimpflug import focal_plane_through as focal_plane_through
from focusjax.lens._scheimpflug import lens_axis as lens_axis
from focusjax.lens._scheimpflug import movements_of as movements_of
from focusjax.lens._scheimpflug import view_tangents as view_tangents
from focusjax.lens._thin import ThinLens as ThinLens
from focusjax.lens._thin import thin_lens as thin_lens
from focusjax.lens._tilt_shift import TiltShiftLens as TiltShiftLens
from focusjax.lens._tilt_shift import as_tilt_shift as as_tilt_shift
from focusjax.lens._tilt_shift import lens_for_plane as lens_for_plane
from focusjax.lens._tilt_shift import tilt_shift_lens as tilt_shift_lens
