"""Files that a run leaves behind."""

from focusjax.io._folder import staged_folder as staged_folder
from focusjax.io._images import load_exr as load_exr
from focusjax.io._images import save_exr as save_exr
from focusjax.io._images import save_png as save_png
from focusjax.io._json import for_json as for_json
