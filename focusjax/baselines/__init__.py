"""Slow, simple and independent renderers that tell whether the fast one is right."""

from focusjax.baselines._raycast import RayCaster as RayCaster
from focusjax.baselines._raycast import SurfaceHits as SurfaceHits
from focusjax.baselines._raycast import lens_picture as lens_picture
from focusjax.baselines._raycast import nearest_in_scene as nearest_in_scene
