"""Many runs at once: configs, grids and tables, done side by side, gone on with, and summed up."""

from focusjax.batch._command import command as command
from focusjax.batch._description import is_batch_file as is_batch_file
from focusjax.batch._description import items_from_file as items_from_file
from focusjax.batch._errors import BatchError as BatchError
from focusjax.batch._grid import parse_grid as parse_grid
from focusjax.batch._items import Item as Item
from focusjax.batch._items import make_items as make_items
from focusjax.batch._results import BatchResults as BatchResults
from focusjax.batch._results import ItemResult as ItemResult
from focusjax.batch._run import run_batch as run_batch
from focusjax.batch._table import read_table as read_table
