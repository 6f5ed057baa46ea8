"""Solving from pictures: the lens that made a picture, and the focus that makes one sharp."""

from focusjax.inverse._autofocus import autofocus as autofocus
from focusjax.inverse._fit_image import fit_image as fit_image
from focusjax.inverse._fit_surface import SurfaceFit as SurfaceFit
from focusjax.inverse._fit_surface import fit_focal_surface as fit_focal_surface
from focusjax.inverse._image_fit import ImageFit as ImageFit
from focusjax.inverse._image_fit import Level as Level
from focusjax.inverse._scan import Scan as Scan
from focusjax.inverse._scan import scan_lenses as scan_lenses
from focusjax.inverse._widest_lens import widest_lens as widest_lens
