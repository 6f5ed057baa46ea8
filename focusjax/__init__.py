"""Say what should be sharp; get the lens settings and the picture.

The names a script needs are here; each package below holds the rest of its own.
"""

from focusjax.film import expose as expose
from focusjax.focus import AtInfinity as AtInfinity
from focusjax.focus import AtLeast as AtLeast
from focusjax.focus import AtMost as AtMost
from focusjax.focus import AtPixel as AtPixel
from focusjax.focus import AtPoint as AtPoint
from focusjax.focus import Blur as Blur
from focusjax.focus import FocusPoint as FocusPoint
from focusjax.focus import InDepthRange as InDepthRange
from focusjax.focus import InFrame as InFrame
from focusjax.focus import OfHeight as OfHeight
from focusjax.focus import OnMask as OnMask
from focusjax.focus import OnObject as OnObject
from focusjax.focus import OnSensor as OnSensor
from focusjax.focus import OnTriangle as OnTriangle
from focusjax.focus import Prior as Prior
from focusjax.focus import SameBlur as SameBlur
from focusjax.focus import Sharp as Sharp
from focusjax.focus import ShownAt as ShownAt
from focusjax.focus import Solution as Solution
from focusjax.focus import diagnose as diagnose
from focusjax.focus import locate as locate
from focusjax.focus import solve as solve
from focusjax.focus import solve_focal_surface as solve_focal_surface
from focusjax.focus import solve_frames as solve_frames
from focusjax.focus import solve_many as solve_many
from focusjax.geometry import Camera as Camera
from focusjax.geometry import look_at as look_at
from focusjax.geometry import make_camera as make_camera
from focusjax.inverse import ImageFit as ImageFit
from focusjax.inverse import autofocus as autofocus
from focusjax.inverse import fit_focal_surface as fit_focal_surface
from focusjax.inverse import fit_image as fit_image
from focusjax.inverse import scan_lenses as scan_lenses
from focusjax.inverse import widest_lens as widest_lens
from focusjax.io import load_exr as load_exr
from focusjax.io import save_exr as save_exr
from focusjax.io import save_png as save_png
from focusjax.job import find_points as find_points
from focusjax.layers import Layers as Layers
from focusjax.layers import decompose as decompose
from focusjax.layers import disparity_map as disparity_map
from focusjax.layers import missed_light as missed_light
from focusjax.layers import peel as peel
from focusjax.layers import prefilter as prefilter
from focusjax.layers import umbra_saving as umbra_saving
from focusjax.lens import Disk as Disk
from focusjax.lens import FocalSurface as FocalSurface
from focusjax.lens import FocalSurfaceLens as FocalSurfaceLens
from focusjax.lens import ThinLens as ThinLens
from focusjax.lens import TiltShiftLens as TiltShiftLens
from focusjax.lens import focal_surface as focal_surface
from focusjax.lens import focal_surface_lens as focal_surface_lens
from focusjax.lens import polygon as polygon
from focusjax.lens import thin_lens as thin_lens
from focusjax.lens import tilt_shift_lens as tilt_shift_lens
from focusjax.scene import Scene as Scene
from focusjax.scene import constant_background as constant_background
from focusjax.scene import directional_light as directional_light
from focusjax.scene import gradient_background as gradient_background
from focusjax.scene import image_background as image_background
from focusjax.scene import load_mesh as load_mesh
from focusjax.scene import make_scene as make_scene
from focusjax.scene import point_light as point_light
from focusjax.trace import nearest_in_layers as nearest_in_layers
from focusjax.trace import plan_rays as plan_rays
from focusjax.trace import quality_of as quality_of
from focusjax.trace import render as render
from focusjax.trace import render_differentiable as render_differentiable
from focusjax.trace import render_pinhole as render_pinhole

__version__ = "0.1.0"
