"""What is refused of photographs and depth maps."""


class PhotoError(ValueError):
    """A photograph or its depth cannot be used as it is: one sentence with the file and the remedy."""
