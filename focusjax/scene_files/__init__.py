"""Scenes and cameras in files of other programs: USD and glTF."""

from focusjax.scene_files._read_camera import read_camera as read_camera
from focusjax.scene_files._read_camera import read_camera_frames as read_camera_frames
from focusjax.scene_files._read_scene import read_scene as read_scene
from focusjax.scene_files._stored import CameraFrames as CameraFrames
from focusjax.scene_files._stored import SceneFileError as SceneFileError
from focusjax.scene_files._stored import StoredCamera as StoredCamera
from focusjax.scene_files._stored import StoredScene as StoredScene
