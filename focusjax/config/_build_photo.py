"""From `[scene.photo]` to a photograph, and to the camera that took it."""

from focusjax.config._errors import ConfigError
from focusjax.config._load import Config
from focusjax.photo import Photo, load_photo

_NO_ARGUMENTS = {"file", "depth", "widest_f_number"}


def build_photo(config: Config) -> Photo:
    """The photograph of `[scene.photo]` with its depth.

    Raises:
        ConfigError: a file that cannot be used, or a unit or focal length that is missing.
    """
    table = config.scene.photo
    assert table is not None
    settings = table.model_dump(exclude=_NO_ARGUMENTS)
    try:
        depth = None if table.depth is None else config.reach.file(table.depth, "scene.photo.depth")
        return load_photo(config.reach.file(table.file, "scene.photo.file"), depth=depth, **settings)
    except ValueError as error:
        raise ConfigError(str(error)) from error
