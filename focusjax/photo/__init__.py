"""Photographs with depth: read from files, and as scenes for any lens."""

from focusjax.photo._errors import PhotoError as PhotoError
from focusjax.photo._errors import check_file as check_file
from focusjax.photo._photo import Photo as Photo
from focusjax.photo._photo import load_photo as load_photo
from focusjax.photo._photo import photo_camera as photo_camera
from focusjax.photo._scene import EDGES as EDGES
from focusjax.photo._scene import GUESS as GUESS
from focusjax.photo._scene import HOLES as HOLES
from focusjax.photo._scene import SEEN as SEEN
