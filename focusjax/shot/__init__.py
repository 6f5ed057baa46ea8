"""Shots: keyframes, moving and deforming objects, all frames solved together, rendered to files and films."""

from focusjax.shot._build import build_settings as build_settings
from focusjax.shot._build import build_shot as build_shot
from focusjax.shot._camera import camera_path as camera_path
from focusjax.shot._camera import pose_path as pose_path
from focusjax.shot._film import film as film
from focusjax.shot._keyframes import Keyframes as Keyframes
from focusjax.shot._keyframes import Turns as Turns
from focusjax.shot._keyframes import keyframes as keyframes
from focusjax.shot._keyframes import turns as turns
from focusjax.shot._motion import Motion as Motion
from focusjax.shot._motion import MovingScene as MovingScene
from focusjax.shot._motion import Transforms as Transforms
from focusjax.shot._motion import transforms as transforms
from focusjax.shot._render import FrameSettings as FrameSettings
from focusjax.shot._render import RenderedFrames as RenderedFrames
from focusjax.shot._render import render_frames as render_frames
from focusjax.shot._sequence import VertexSequence as VertexSequence
from focusjax.shot._sequence import load_vertex_sequence as load_vertex_sequence
from focusjax.shot._solve import Shot as Shot
from focusjax.shot._solve import SolvedShot as SolvedShot
from focusjax.shot._solve import solve_shot as solve_shot
from focusjax.shot._video import save_mp4 as save_mp4
from focusjax.shot._wishes import FoundWishes as FoundWishes
from focusjax.shot._wishes import TimedWish as TimedWish
from focusjax.shot._wishes import faded as faded
from focusjax.shot._wishes import find_wishes as find_wishes
