"""Work for other processes to do in tests; it lies in a module that they can import."""

import os
import signal
import time

from focusjax.io import json_text
from focusjax.many import finished_folder


def write(task, journal):
    """A folder with a file, after a while; the argument is how long, or "kill"."""
    if (journal.folder / task.name).exists():
        return os.getpid()
    if task.argument == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if task.argument == "wrong":
        raise ValueError("the task is wrong; mend it")
    time.sleep(task.argument)
    with finished_folder(journal, task.name) as stage:
        (stage / "result.json").write_text(json_text({"name": task.name}))
    return os.getpid()
