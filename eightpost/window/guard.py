"""Who may talk to the window: the browser that opened its link, from this machine, on this window's own address."""

from __future__ import annotations

import secrets
from http.cookies import SimpleCookie
from urllib.parse import parse_qs

from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send


class Guard:
    """Middleware that refuses requests with another host, another origin, or without the token.

    A page of another site in the same browser could otherwise reach the window: by its own requests (origin), or under
    a name that it points to this machine (host).

    Args:
        app: Application behind it.
        port: Port of the window.
        token: Token of the link, which becomes a cookie.
    """

    def __init__(self, app: ASGIApp, port: int, token: str) -> None:
        self._app, self._token, self._cookie = app, token, f"eightpost_{port}"
        self._hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        host = headers.get("host", "")
        if host not in self._hosts or headers.get("origin", f"http://{host}") != f"http://{host}":
            await self._refuse(scope, receive, send, "This window serves its own address only.")
        elif self._is_token(self._in_cookie(headers.get("cookie", ""))):
            await self._app(scope, receive, send)
        elif scope["type"] == "http" and self._is_token(_in_link(scope)):
            answer = RedirectResponse("/", 303)
            answer.set_cookie(self._cookie, self._token, httponly=True, samesite="strict")
            await answer(scope, receive, send)
        else:
            await self._refuse(scope, receive, send, "Open the link that `eightpost app` printed; it has a token.")

    def _is_token(self, text: str) -> bool:
        return secrets.compare_digest(text.encode(), self._token.encode())

    def _in_cookie(self, header: str) -> str:
        morsel = SimpleCookie(header).get(self._cookie)
        return morsel.value if morsel else ""

    @staticmethod
    async def _refuse(scope: Scope, receive: Receive, send: Send, text: str) -> None:
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await PlainTextResponse(text, 403)(scope, receive, send)


def _in_link(scope: Scope) -> str:
    query: str = scope["query_string"].decode("latin-1")
    return parse_qs(query).get("token", [""])[0]
