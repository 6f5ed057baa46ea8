"""What changes over time: keyframes, cameras that move, objects that move and deform."""

from focusjax.motion._camera import Path as Path
from focusjax.motion._camera import camera_path as camera_path
from focusjax.motion._camera import moving_camera as moving_camera
from focusjax.motion._camera import pose_path as pose_path
from focusjax.motion._camera import solved_path as solved_path
from focusjax.motion._keyframes import Keyframes as Keyframes
from focusjax.motion._keyframes import Turns as Turns
from focusjax.motion._keyframes import keyframes as keyframes
from focusjax.motion._keyframes import turns as turns
from focusjax.motion._motion import Motion as Motion
from focusjax.motion._motion import MovingScene as MovingScene
from focusjax.motion._motion import Transforms as Transforms
from focusjax.motion._motion import transforms as transforms
from focusjax.motion._motion import transforms_of as transforms_of
from focusjax.motion._sequence import VertexSequence as VertexSequence
from focusjax.motion._sequence import load_vertex_sequence as load_vertex_sequence
