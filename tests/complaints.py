"""What a command says on stderr beside how far it is."""

from focusjax._progress import STAGES


def complaints_in(stderr):
    """Warnings and errors, line by line, without the lines of progress."""
    lines = stderr.splitlines(keepends=True)
    return "".join(line for line in lines if line.rstrip("\n").partition(":")[0] not in STAGES.values())
