"""Files that a run leaves behind."""

from focusjax._whole_file import replace_file as replace_file
from focusjax.io._folder import UNFINISHED as UNFINISHED
from focusjax.io._folder import FolderInUseError as FolderInUseError
from focusjax.io._folder import sole_use as sole_use
from focusjax.io._folder import staged_folder as staged_folder
from focusjax.io._folder import whole_folder as whole_folder
from focusjax.io._images import load_exr as load_exr
from focusjax.io._images import save_exr as save_exr
from focusjax.io._images import save_png as save_png
from focusjax.io._json import differing_keys as differing_keys
from focusjax.io._json import for_json as for_json
from focusjax.io._json import json_text as json_text
from focusjax.io._json import load_json as load_json
