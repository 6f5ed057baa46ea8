"""Slow or simple ways to a picture that share no code with the tracer: to judge it by, and for previews."""

from focusjax.baselines._accumulation import accumulate as accumulate
from focusjax.baselines._denoise import denoised as denoised
from focusjax.baselines._mitsuba import SAMPLER as SAMPLER
from focusjax.baselines._mitsuba import UnlitScene as UnlitScene
from focusjax.baselines._mitsuba import counted_mitsuba_picture as counted_mitsuba_picture
from focusjax.baselines._mitsuba import load_unlit as load_unlit
from focusjax.baselines._mitsuba import mitsuba as mitsuba
from focusjax.baselines._mitsuba import mitsuba_picture as mitsuba_picture
from focusjax.baselines._mitsuba import thin_lens_sensor as thin_lens_sensor
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
