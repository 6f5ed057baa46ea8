"""Slow or simple ways to a picture that share no code with the tracer: to judge it by, and for previews."""

from focusjax.baselines._accumulation import accumulate as accumulate
from focusjax.baselines._denoise import denoised as denoised
from focusjax.baselines._gather import circle_radii as circle_radii
from focusjax.baselines._gather import gather as gather
from focusjax.baselines._gather import gradient_noise as gradient_noise
from focusjax.baselines._gather import in_chunks as in_chunks
from focusjax.baselines._gather import most_levels as most_levels
from focusjax.baselines._gather import tap_sample as tap_sample
from focusjax.baselines._mipmaps import block_means as block_means
from focusjax.baselines._mitsuba import SAMPLER as SAMPLER
from focusjax.baselines._mitsuba import UnlitScene as UnlitScene
from focusjax.baselines._mitsuba import counted_mitsuba_picture as counted_mitsuba_picture
from focusjax.baselines._mitsuba import load_unlit as load_unlit
from focusjax.baselines._mitsuba import mitsuba as mitsuba
from focusjax.baselines._mitsuba import mitsuba_picture as mitsuba_picture
from focusjax.baselines._mitsuba import render_thin_lens as render_thin_lens
from focusjax.baselines._mitsuba import unlit_scene as unlit_scene
from focusjax.baselines._mitsuba import without_gaps as without_gaps
from focusjax.baselines._multilayer import multilayer as multilayer
from focusjax.baselines._raycast import RayCaster as RayCaster
from focusjax.baselines._raycast import SurfaceHits as SurfaceHits
from focusjax.baselines._raycast import nearest_in_scene as nearest_in_scene
from focusjax.baselines._scatter import scatter as scatter
from focusjax.baselines._through_lens import RayScene as RayScene
from focusjax.baselines._through_lens import lens_picture as lens_picture
from focusjax.baselines._view import pinhole_view as pinhole_view
