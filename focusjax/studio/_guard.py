"""Who may talk to the studio's server: the page itself, and nobody else's page."""

import hmac
from http.cookies import SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

from starlette.types import ASGIApp, Message, Receive, Scope, Send

COOKIE = "focusjax_studio"


class Guard:
    """Lets requests through that come from the studio's own page; others get 403.

    A page of another site that a browser shows meanwhile has another origin. One that had its own name lead
    to this machine asks for another host. With a token, only who has opened the address with it is let in.
    """

    def __init__(self, app: ASGIApp, *, hosts: tuple[str, ...], token: str = ""):
        """Stand before `app`.

        Args:
            app: what is guarded.
            hosts: values of the Host header that are answered; all, if empty.
            token: what the address has to carry once; nothing, if empty.
        """
        self._app, self._hosts, self._token = app, hosts, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {key.decode("latin1").lower(): value.decode("latin1") for key, value in scope["headers"]}
        query = parse_qs(scope.get("query_string", b"").decode("latin1"))
        given = query.get("token", [""])[0]
        if not (self._own(headers) and self._admitted(headers, given)):
            await _refuse(scope, receive, send)
            return

        async def with_cookie(message: Message) -> None:
            if message["type"] == "http.response.start" and self._token and given:
                cookie = f"{COOKIE}={self._token}; Path=/; HttpOnly; SameSite=Strict"
                message["headers"] = [*message.get("headers", []), (b"set-cookie", cookie.encode())]
            await send(message)

        await self._app(scope, receive, with_cookie)

    def _own(self, headers: dict[str, str]) -> bool:
        """Whether host and origin are this server's."""
        host, origin = headers.get("host", ""), headers.get("origin")
        if self._hosts and host not in self._hosts:
            return False
        return origin is None or urlsplit(origin).netloc == host

    def _admitted(self, headers: dict[str, str], given: str) -> bool:
        """Whether the token is in the address or in a cookie."""
        if not self._token:
            return True
        cookies = SimpleCookie(headers.get("cookie", ""))
        known = cookies[COOKIE].value if COOKIE in cookies else ""
        return any(hmac.compare_digest(each.encode(), self._token.encode()) for each in (given, known))


async def _refuse(scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008})
        return
    text = b"This is not the studio's own page. Open the address that the command printed.\n"
    start: dict[str, Any] = {
        "type": "http.response.start",
        "status": 403,
        "headers": [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", b"%d" % len(text))],
    }
    await send(start)
    await send({"type": "http.response.body", "body": text})
