"""What can be wrong with a batch as a whole."""


class BatchError(ValueError):
    """A batch that cannot be done as it was asked for; nothing of it was started."""
