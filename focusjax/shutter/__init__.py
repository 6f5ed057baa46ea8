"""Motion while the shutter is open: lens rays that each have a time, shutter curves, rolling shutters."""

from focusjax.shutter._motion import Body as Body
from focusjax.shutter._motion import MovingWorld as MovingWorld
from focusjax.shutter._motion import StillWorld as StillWorld
from focusjax.shutter._render import MovingPicture as MovingPicture
from focusjax.shutter._render import render_moving as render_moving
from focusjax.shutter._shutter import Shutter as Shutter
from focusjax.shutter._shutter import make_shutter as make_shutter
from focusjax.shutter._velocity import middle_of as middle_of
from focusjax.shutter._velocity import velocity_map as velocity_map
