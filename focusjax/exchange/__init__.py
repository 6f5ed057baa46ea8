"""Cameras for other programs: USD, Blender, Mitsuba, pbrt and glTF."""

from focusjax.exchange._export import TARGETS as TARGETS
from focusjax.exchange._export import Exported as Exported
from focusjax.exchange._export import export_camera as export_camera
from focusjax.exchange._export import target_named as target_named
from focusjax.exchange._fitting import ExportError as ExportError
from focusjax.exchange._fitting import features as features
from focusjax.exchange._mitsuba import mitsuba_dict as mitsuba_dict
from focusjax.exchange._record import Frame as Frame
from focusjax.exchange._record import Record as Record
from focusjax.exchange._record import record_of as record_of
from focusjax.exchange._solved import export_config as export_config
