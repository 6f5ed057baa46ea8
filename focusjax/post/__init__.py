"""Pictures by post-processing: one sharp view, filtered as cameras blur (Kyaw 2013 section 7)."""

from focusjax.post._distortion import warped as warped
from focusjax.post._gather import gather as gather
from focusjax.post._motion import motion_blur as motion_blur
from focusjax.post._plan import PostPlan as PostPlan
from focusjax.post._plan import plan_post as plan_post
from focusjax.post._process import post_process as post_process
from focusjax.post._view import PinholeView as PinholeView
from focusjax.post._view import closed_lens as closed_lens
from focusjax.post._view import view_in_layers as view_in_layers
