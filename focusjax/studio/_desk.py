"""What one server shows: the start page, or a studio; and what may be opened."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from focusjax.studio._gallery import Gallery
from focusjax.studio._kept_pictures import user_cache
from focusjax.studio._new_config import open_session
from focusjax.studio._session import Session
from focusjax.studio._studio import Studio


class Desk:
    """One studio at a time, or none.

    Attributes:
        studio: what is open; None on the start page.
        gallery: what the start page offers; None where a config was named to begin with.
        any_file: whether paths may be typed in, which only this machine's own user may do.
    """

    def __init__(
        self, session: Session | None = None, *, gallery: Gallery | None = None, any_file: bool = True
    ):
        """Begin with a session, or with the start page."""
        self.gallery, self.any_file = gallery, any_file
        self.studio: Studio | None = None
        if session is not None:
            self._take(session)

    def open(
        self, paths: Sequence[Path], *, root: Path | None = None, photo: Mapping[str, Any] | None = None
    ) -> None:
        """Open a config, meshes or a photograph in place of what is open.

        Raises:
            ConfigError: as `open_session`; what is open stays.
        """
        self._take(open_session(paths, root=root, photo=photo))

    def leave(self) -> None:
        """Go back to the start page; what is not saved is kept for the next time."""
        if self.studio is not None and self.gallery is not None:
            self.studio.close()
            self.studio = None

    def close(self) -> None:
        """End all threads."""
        if self.gallery is not None:
            self.gallery.close()
        if self.studio is not None:
            self.studio.close()

    def _take(self, session: Session) -> None:
        if self.studio is not None:
            self.studio.close()
        self.studio = Studio(session, pictures=user_cache())
        self.studio.warm_up()
