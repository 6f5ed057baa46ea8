"""Say what should be sharp; get the lens settings and the picture.

The names a script needs are here; each package below holds the rest of its own. A package is imported when
one of its names is first used, so that `import focusjax` is quick.
"""

import importlib
from typing import TYPE_CHECKING, Any

from focusjax import _begun as _begun

if TYPE_CHECKING:
    __version__: str
    from focusjax._show import show as show
    from focusjax.exchange import ExportError as ExportError
    from focusjax.exchange import export_camera as export_camera
    from focusjax.film import CameraSettings as CameraSettings
    from focusjax.film import LongExposure as LongExposure
    from focusjax.film import Zone as Zone
    from focusjax.film import camera_settings as camera_settings
    from focusjax.film import choose_settings as choose_settings
    from focusjax.film import develop as develop
    from focusjax.film import expose as expose
    from focusjax.film import expose_frames as expose_frames
    from focusjax.film import film_preset as film_preset
    from focusjax.film import fit_settings as fit_settings
    from focusjax.film import luminance_of_light_value as luminance_of_light_value
    from focusjax.film import meter as meter
    from focusjax.film import photograph as photograph
    from focusjax.film import settings_through as settings_through
    from focusjax.film import start_exposure as start_exposure
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
    from focusjax.focus import focus_by_rays as focus_by_rays
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
    from focusjax.job import ExposedSolution as ExposedSolution
    from focusjax.job import find_points as find_points
    from focusjax.job import solve_exposed as solve_exposed
    from focusjax.layers import Layers as Layers
    from focusjax.layers import decompose as decompose
    from focusjax.layers import disparity_map as disparity_map
    from focusjax.layers import load_layers as load_layers
    from focusjax.layers import missed_light as missed_light
    from focusjax.layers import peel as peel
    from focusjax.layers import save_layers as save_layers
    from focusjax.layers import umbra_saving as umbra_saving
    from focusjax.lens import Disk as Disk
    from focusjax.lens import FittedLens as FittedLens
    from focusjax.lens import FocalSurface as FocalSurface
    from focusjax.lens import FocalSurfaceLens as FocalSurfaceLens
    from focusjax.lens import LensSettings as LensSettings
    from focusjax.lens import PrescriptionLens as PrescriptionLens
    from focusjax.lens import ThinLens as ThinLens
    from focusjax.lens import TiltShiftLens as TiltShiftLens
    from focusjax.lens import close_focus_lens as close_focus_lens
    from focusjax.lens import depth_of_field_lens as depth_of_field_lens
    from focusjax.lens import fitted_lens as fitted_lens
    from focusjax.lens import focal_surface as focal_surface
    from focusjax.lens import focal_surface_lens as focal_surface_lens
    from focusjax.lens import lens_settings as lens_settings
    from focusjax.lens import polygon as polygon
    from focusjax.lens import prescription_lens as prescription_lens
    from focusjax.lens import spectral_lens as spectral_lens
    from focusjax.lens import thin_lens as thin_lens
    from focusjax.lens import tilt_shift_lens as tilt_shift_lens
    from focusjax.lens import tilted_lens as tilted_lens
    from focusjax.optics import lens_preset as lens_preset
    from focusjax.optics import load_lens as load_lens
    from focusjax.photo import Photo as Photo
    from focusjax.photo import load_photo as load_photo
    from focusjax.scene import Scene as Scene
    from focusjax.scene import constant_background as constant_background
    from focusjax.scene import directional_light as directional_light
    from focusjax.scene import gradient_background as gradient_background
    from focusjax.scene import image_background as image_background
    from focusjax.scene import load_mesh as load_mesh
    from focusjax.scene import make_object as make_object
    from focusjax.scene import make_scene as make_scene
    from focusjax.scene import point_light as point_light
    from focusjax.scene_files import SceneFileError as SceneFileError
    from focusjax.scene_files import read_camera as read_camera
    from focusjax.scene_files import read_scene as read_scene
    from focusjax.trace import estimate_quality as estimate_quality
    from focusjax.trace import nearest_in_layers as nearest_in_layers
    from focusjax.trace import plan_lens as plan_lens
    from focusjax.trace import plan_rays as plan_rays
    from focusjax.trace import render as render
    from focusjax.trace import render_pinhole as render_pinhole

_NAMES = {
    "_show": ("show",),
    "exchange": (
        "ExportError",
        "export_camera",
    ),
    "film": (
        "CameraSettings",
        "LongExposure",
        "Zone",
        "camera_settings",
        "choose_settings",
        "develop",
        "expose",
        "expose_frames",
        "film_preset",
        "fit_settings",
        "luminance_of_light_value",
        "meter",
        "photograph",
        "settings_through",
        "start_exposure",
    ),
    "focus": (
        "AtInfinity",
        "AtLeast",
        "AtMost",
        "AtPixel",
        "AtPoint",
        "Blur",
        "FocusPoint",
        "InDepthRange",
        "InFrame",
        "OfHeight",
        "OnMask",
        "OnObject",
        "OnSensor",
        "OnTriangle",
        "Prior",
        "SameBlur",
        "Sharp",
        "ShownAt",
        "Solution",
        "diagnose",
        "focus_by_rays",
        "locate",
        "solve",
        "solve_focal_surface",
        "solve_frames",
        "solve_many",
    ),
    "geometry": (
        "Camera",
        "look_at",
        "make_camera",
    ),
    "inverse": (
        "ImageFit",
        "autofocus",
        "fit_focal_surface",
        "fit_image",
        "scan_lenses",
        "widest_lens",
    ),
    "io": (
        "load_exr",
        "save_exr",
        "save_png",
    ),
    "job": (
        "ExposedSolution",
        "find_points",
        "solve_exposed",
    ),
    "layers": (
        "Layers",
        "decompose",
        "disparity_map",
        "load_layers",
        "missed_light",
        "peel",
        "save_layers",
        "umbra_saving",
    ),
    "lens": (
        "Disk",
        "FittedLens",
        "FocalSurface",
        "FocalSurfaceLens",
        "LensSettings",
        "PrescriptionLens",
        "ThinLens",
        "TiltShiftLens",
        "close_focus_lens",
        "depth_of_field_lens",
        "fitted_lens",
        "focal_surface",
        "focal_surface_lens",
        "lens_settings",
        "polygon",
        "prescription_lens",
        "spectral_lens",
        "thin_lens",
        "tilt_shift_lens",
        "tilted_lens",
    ),
    "optics": (
        "lens_preset",
        "load_lens",
    ),
    "photo": (
        "Photo",
        "load_photo",
    ),
    "scene": (
        "Scene",
        "constant_background",
        "directional_light",
        "gradient_background",
        "image_background",
        "load_mesh",
        "make_object",
        "make_scene",
        "point_light",
    ),
    "scene_files": ("SceneFileError", "read_camera", "read_scene"),
    "trace": (
        "estimate_quality",
        "nearest_in_layers",
        "plan_lens",
        "plan_rays",
        "render",
        "render_pinhole",
    ),
}
"""The public names by the package that holds each; the imports above are the same for type checkers."""

_PACKAGE_OF = {name: package for package, names in _NAMES.items() for name in names}

if not TYPE_CHECKING:
    # Type checkers know the names from the imports above.
    __all__ = ["__version__", *sorted(_PACKAGE_OF)]

_ROOMS = (
    "baselines",
    "bench",
    "config",
    "dataset",
    "exchange",
    "film",
    "focus",
    "geometry",
    "inverse",
    "io",
    "job",
    "layers",
    "lens",
    "metrics",
    "optics",
    "photo",
    "post",
    "report",
    "scene",
    "scene_files",
    "shot",
    "shutter",
    "solvers",
    "trace",
)
"""Packages that are attributes without an import of their own, as `focusjax.lens`."""


def __getattr__(name: str) -> Any:
    """A public name or package at its first use (PEP 562)."""
    if name == "__version__":
        return _version()
    if name in _ROOMS:
        return importlib.import_module(f"focusjax.{name}")
    if name not in _PACKAGE_OF:
        raise AttributeError(f"module 'focusjax' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"focusjax.{_PACKAGE_OF[name]}"), name)
    globals()[name] = value
    return value


def _version() -> str:
    """That of the installed package, which is made from the repository's tags."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("focusjax")
    except PackageNotFoundError:
        return "0+not.installed"


def __dir__() -> list[str]:
    own = (name for name in globals() if name.startswith("__"))
    return sorted({*own, "__version__", *_PACKAGE_OF, *_ROOMS})
