"""What a command says on stderr beside how far it is."""

from focusjax._progress import STAGES


def complaints_in(stderr, *stages):
    """Warnings and errors, line by line, without the lines of progress, of whose stages `stages` are some."""
    lines = stderr.splitlines(keepends=True)
    known = {*STAGES.values(), *stages}
    return "".join(line for line in lines if line.rstrip("\n").partition(":")[0] not in known)
