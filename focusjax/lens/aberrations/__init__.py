"""What keeps rays from meeting where an ideal lens would have them meet."""

from focusjax.lens.aberrations._base import AberratedLens as AberratedLens
from focusjax.lens.aberrations._base import AbstractAberration as AbstractAberration
from focusjax.lens.aberrations._base import Bounds as Bounds
from focusjax.lens.aberrations._chromatic import ChromaticLens as ChromaticLens
from focusjax.lens.aberrations._chromatic import Magnification as Magnification
from focusjax.lens.aberrations._chromatic import chromatic_lens as chromatic_lens
from focusjax.lens.aberrations._chromatic import thin_lens_dispersion as thin_lens_dispersion
from focusjax.lens.aberrations._focus_offsets import FieldCurvature as FieldCurvature
from focusjax.lens.aberrations._focus_offsets import FocusOffset as FocusOffset
from focusjax.lens.aberrations._focus_offsets import PowerProfile as PowerProfile
from focusjax.lens.aberrations._focus_offsets import field_curvature as field_curvature
from focusjax.lens.aberrations._focus_offsets import power_profile as power_profile
from focusjax.lens.aberrations._seidel import Seidel as Seidel
from focusjax.lens.aberrations._seidel import pixels_per_wave as pixels_per_wave
from focusjax.lens.aberrations._seidel import seidel as seidel
from focusjax.lens.aberrations._seidel import seidel_of_wavefront as seidel_of_wavefront
from focusjax.lens.aberrations._tabulated import TabulatedAberrations as TabulatedAberrations
from focusjax.lens.aberrations._tabulated import tabulated_aberrations as tabulated_aberrations
