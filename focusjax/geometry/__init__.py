"""Cameras, pixel filters, and lens rays as straight lines in image space and disparity."""

from focusjax.geometry._camera import FULL_FRAME_WIDTH as FULL_FRAME_WIDTH
from focusjax.geometry._camera import Camera as Camera
from focusjax.geometry._camera import look_at as look_at
from focusjax.geometry._camera import make_camera as make_camera
from focusjax.geometry._pixel_filter import film_offsets as film_offsets
from focusjax.geometry._pixel_filter import filter_radius as filter_radius
from focusjax.geometry._rays import LensRay as LensRay
