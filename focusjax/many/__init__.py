"""Many tasks on one machine or many: started, counted, done again where a process ends, and never twice."""

from focusjax.many._carry_out import Workers as Workers
from focusjax.many._carry_out import carry_out as carry_out
from focusjax.many._carry_out import check_workers as check_workers
from focusjax.many._console import chosen_workers as chosen_workers
from focusjax.many._console import failures as failures
from focusjax.many._console import progress_bar as progress_bar
from focusjax.many._journal import JOURNAL as JOURNAL
from focusjax.many._journal import Journal as Journal
from focusjax.many._journal import finished_folder as finished_folder
from focusjax.many._task import Ended as Ended
from focusjax.many._task import ManyError as ManyError
from focusjax.many._task import Task as Task
from focusjax.many._task import sentence as sentence
from focusjax.many._worker import warnings_kept as warnings_kept
