"""Wishes about what is sharp and what is blurred, and the lens that meets them best."""

from focusjax.focus._image_points import ImagePoints as ImagePoints
from focusjax.focus._image_points import blurs as blurs
from focusjax.focus._image_points import errors as errors
from focusjax.focus._image_points import residuals as residuals
from focusjax.focus._locate import locate as locate
from focusjax.focus._plane import PlaneFit as PlaneFit
from focusjax.focus._plane import fit_focal_plane as fit_focal_plane
from focusjax.focus._points import AtInfinity as AtInfinity
from focusjax.focus._points import AtPixel as AtPixel
from focusjax.focus._points import AtPoint as AtPoint
from focusjax.focus._points import Blur as Blur
from focusjax.focus._points import FocusPoint as FocusPoint
from focusjax.focus._points import OnObject as OnObject
from focusjax.focus._points import OnTriangle as OnTriangle
from focusjax.focus._points import Sharp as Sharp
from focusjax.focus._solution import Result as Result
from focusjax.focus._solution import Solution as Solution
from focusjax.focus._solution import WishResult as WishResult
from focusjax.focus._solve import solve as solve
from focusjax.focus._solve_surface import SurfaceSolution as SurfaceSolution
from focusjax.focus._solve_surface import solve_focal_surface as solve_focal_surface
