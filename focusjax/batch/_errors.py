"""What can be wrong with a batch as a whole, and how an error becomes a sentence."""

from focusjax import _console

_OURS = (ValueError, RuntimeError, OSError, MemoryError)


class BatchError(ValueError):
    """A batch that cannot be done as it was asked for; nothing of it was started."""


def sentence(error: Exception) -> str:
    """What a person is told of `error`: its first paragraph, on one line."""
    if not isinstance(error, _OURS):
        return f"internal error, please report it: {error!r}"
    return _console.sentence(error)
