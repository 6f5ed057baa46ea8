"""Lenses as sources of rays, and the shapes of their openings."""

from focusjax.lens._aperture import AbstractAperture as AbstractAperture
from focusjax.lens._aperture import Disk as Disk
from focusjax.lens._aperture import Polygon as Polygon
from focusjax.lens._aperture import polygon as polygon
from focusjax.lens._base import AbstractLens as AbstractLens
from focusjax.lens._control_points import FocalSurface as FocalSurface
from focusjax.lens._control_points import focal_surface as focal_surface
from focusjax.lens._focal_surface import FocalSurfaceLens as FocalSurfaceLens
from focusjax.lens._focal_surface import focal_surface_lens as focal_surface_lens
from focusjax.lens._kernels import AbstractKernel as AbstractKernel
from focusjax.lens._kernels import GaussianFade as GaussianFade
from focusjax.lens._kernels import InverseDistance as InverseDistance
from focusjax.lens._kernels import WendlandFade as WendlandFade
from focusjax.lens._moving_least_squares import Basis as Basis
from focusjax.lens._moving_least_squares import moving_least_squares as moving_least_squares
from focusjax.lens._thin import ThinLens as ThinLens
from focusjax.lens._thin import thin_lens as thin_lens
