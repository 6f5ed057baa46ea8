"""The config file: its tables, how it is read, and what it builds."""

from focusjax.config._build import build_camera as build_camera
from focusjax.config._build import build_lens as build_lens
from focusjax.config._build import build_objects as build_objects
from focusjax.config._build import build_scene as build_scene
from focusjax.config._build_exposure import build_balance as build_balance
from focusjax.config._build_exposure import build_choices as build_choices
from focusjax.config._build_exposure import build_film as build_film
from focusjax.config._build_exposure import build_zones as build_zones
from focusjax.config._build_look import build_look as build_look
from focusjax.config._build_real import build_real_lens as build_real_lens
from focusjax.config._build_surface import build_control_points as build_control_points
from focusjax.config._build_surface import build_focal_surface as build_focal_surface
from focusjax.config._build_wishes import build_focus_points as build_focus_points
from focusjax.config._build_wishes import build_solve_options as build_solve_options
from focusjax.config._errors import ConfigError as ConfigError
from focusjax.config._errors import sentence_for as sentence_for
from focusjax.config._exposure import ExposureTable as ExposureTable
from focusjax.config._load import Config as Config
from focusjax.config._load import load_config as load_config
from focusjax.config._load import read_toml as read_toml
from focusjax.config._load import toml_value as toml_value
from focusjax.config._refusals import refusals_located as refusals_located
from focusjax.config._render import RenderTable as RenderTable
from focusjax.config._shot import ShotTable as ShotTable
from focusjax.config._shot import values_of as values_of
from focusjax.config._values import Table as Table
