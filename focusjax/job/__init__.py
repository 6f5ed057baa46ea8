"""One run from a config to a picture."""

from focusjax.job._exposed import ExposedLens as ExposedLens
from focusjax.job._exposed import ExposedSolution as ExposedSolution
from focusjax.job._exposed import open_for_light as open_for_light
from focusjax.job._exposed import solve_exposed as solve_exposed
from focusjax.job._glass import ThroughGlass as ThroughGlass
from focusjax.job._glass import left_to_quality as left_to_quality
from focusjax.job._guessed import Guessed as Guessed
from focusjax.job._photograph import Development as Development
from focusjax.job._photograph import Photograph as Photograph
from focusjax.job._photograph import find_development as find_development
from focusjax.job._photograph import take_photograph as take_photograph
from focusjax.job._picture import Examined as Examined
from focusjax.job._picture import Picture as Picture
from focusjax.job._picture import Progress as Progress
from focusjax.job._picture import make_layers as make_layers
from focusjax.job._picture import room_for_more as room_for_more
from focusjax.job._run import Outcome as Outcome
from focusjax.job._run import blur_map as blur_map
from focusjax.job._run import find_points as find_points
from focusjax.job._run import run as run
from focusjax.job._shutter_words import shutter as shutter
from focusjax.job._way import Way as Way
from focusjax.job._weigh import metered_before as metered_before
