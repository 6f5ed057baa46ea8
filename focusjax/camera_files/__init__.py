"""Cameras in files of other programs: USD and glTF."""

from focusjax.camera_files._read import read_camera as read_camera
from focusjax.camera_files._stored import CameraFileError as CameraFileError
from focusjax.camera_files._stored import StoredCamera as StoredCamera
