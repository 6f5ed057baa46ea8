"""The server of the page: its routes, who may ask, and where it listens."""

import secrets
from collections.abc import Callable

from fastapi import Response
from nicegui import app, ui

from focusjax.studio._desk import Desk
from focusjax.studio._elements import add_style
from focusjax.studio._guard import Guard
from focusjax.studio._page import Page
from focusjax.studio._start_page import StartPage
from focusjax.studio._studio import KINDS, Studio

LOCAL = "127.0.0.1"
_NO_STORE = {"Cache-Control": "no-store"}


def add_routes(desk: Desk) -> Callable[[], None]:
    """Give NiceGUI's server the pictures of a desk; what builds its page."""

    @app.get("/studio/{kind}/{number}")
    def picture(kind: str, number: int) -> Response:
        if kind == "thumbnail":
            data = None if desk.gallery is None else desk.gallery.thumbnail(number)
            missing = Response(status_code=404)
            return missing if data is None else Response(data, media_type="image/jpeg", headers=_NO_STORE)
        return picture_of(desk.studio, kind, number)

    def page() -> None:
        add_style()
        if desk.studio is not None:
            Page(desk.studio, desk)
        else:
            StartPage(desk)

    return page


def picture_of(studio: Studio | None, kind: str, number: int) -> Response:
    """The picture of a kind that has that number, or a newer one that has taken its place; else 404."""
    shown = studio.shown.get(kind) if studio is not None and kind in KINDS else None
    if shown is None or number > shown.number:
        return Response(status_code=404)
    return Response(shown.data, media_type=shown.media, headers=_NO_STORE)


def serve(desk: Desk, *, host: str | None, port: int, show: bool, announce: Callable[[str], None]) -> None:
    """Serve the page until the command is stopped.

    Args:
        desk: what is shown.
        host: where to listen; this machine alone if None. Otherwise the address carries a token.
        port: of the server.
        show: open the page in a browser.
        announce: called with the page's address.
    """
    token = "" if host is None else secrets.token_urlsafe(16)
    own = tuple(f"{name}:{port}" for name in (LOCAL, "localhost")) if host is None else ()
    app.add_middleware(Guard, hosts=own, token=token)
    page = add_routes(desk)
    path = f"/?token={token}" if token else "/"
    app.on_startup(lambda: announce(f"http://{host or LOCAL}:{port}{path}"))
    app.on_shutdown(desk.close)
    ui.run(
        page,
        host=host or LOCAL,
        port=port,
        title="focusjax studio",
        favicon="🎯",
        dark=None,
        reload=False,
        show=path if show else False,
        show_welcome_message=False,
    )
