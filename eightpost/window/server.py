"""The server of the window: its address, who may talk to it, its pages, and its end."""

from __future__ import annotations

import os
import secrets
import socket
import webbrowser
from collections.abc import Awaitable, Callable
from functools import partial
from http.cookies import SimpleCookie
from pathlib import Path
from types import FrameType
from typing import Any
from urllib.parse import parse_qs

from eightpost.errors import OutputError
from eightpost.extras import needs

with needs("app", "the window"):
    import uvicorn
    from fastapi import FastAPI
    from nicegui import app, events, ui
    from starlette.responses import FileResponse, PlainTextResponse, RedirectResponse, Response
    from starlette.types import ASGIApp, Receive, Scope, Send

from eightpost.window import parts, records, system
from eightpost.window.parts import Folder

_SCREENS: dict[str, Callable[[parts.Window], Awaitable[None]]] = {
    "Dyno": records.show_dyno, "Car": records.show_car, "Run": system.show_system, "Study": system.show_study,
}  # fmt: skip

#: Time for which a browser may be silent before its page is built again, without what was chosen in it [s]: commands
#: may take all processors.
_RECONNECT = 30.0

_STYLE = """
.screen { gap: 1rem } .side { width: 21rem; flex-shrink: 0 } .main { flex-grow: 1; min-width: 0 }
.drop .q-uploader__file { display: none } .drop .q-uploader__list { min-height: 3rem }
.product { color: #1a5a96 !important } .body--dark .product { color: #8ab4f8 !important }
.channel { min-width: 9rem; flex-grow: 1 } .figure { border-radius: 4px; overflow: hidden }
@media (max-width: 900px) { .screen { flex-wrap: wrap !important } .side, .main { width: 100% } }
"""


def serve(folder: Path, port: int, *, browser: bool, tell: Callable[[str], None]) -> None:
    """Serve the window until it is ended (Ctrl-C).

    Args:
        folder: Folder of work.
        port: Port on 127.0.0.1; 0 for a free one.
        browser: Whether to open a browser.
        tell: Function that takes the link, which has the token.

    Raises:
        InputError: The folder is a file.
        OutputError: Another program uses the port.
    """
    window = parts.Window(Folder.opened(folder))
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if os.name == "posix":  # a port is free again as soon as its last window has ended
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind(("127.0.0.1", port))
    except OSError as error:
        raise OutputError(f"port {port} is in use; give another --port, or none") from error
    token, port = secrets.token_urlsafe(24), listener.getsockname()[1]
    link = f"http://127.0.0.1:{port}/?token={token}"
    server = _Server(uvicorn.Config(_web(window, port, token), log_level="critical"))

    def opened() -> None:
        tell(link)
        if browser:
            webbrowser.open(link)

    app.on_startup(opened)
    app.timer(0.5, window.advance)
    app.on_exception(lambda error: tell(f"error in the window: {error!r}"))
    try:
        server.run(sockets=[listener])
    except KeyboardInterrupt:  # the way to end it
        pass
    finally:
        window.close()


class _Server(uvicorn.Server):
    """A server that ends at the first Ctrl-C: an open browser would hold it, and there is nothing to save."""

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End at once."""
        super().handle_exit(sig, frame)
        self.force_exit = True


def _web(window: parts.Window, port: int, token: str) -> FastAPI:
    """Return the application: one page with a tab for each screen, and the files of the folder."""
    ui.page("/", title="eightpost")(partial(_page, window))
    app.get("/file/{name:path}")(partial(_file, window))
    web = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    ui.run_with(
        web, dark=None, language="en-US", show_welcome_message=False, tailwind=False, unocss="mini",
        reconnect_timeout=_RECONNECT,
    )  # fmt: skip
    web.add_middleware(_Guard, port=port, token=token)
    return web


async def _page(window: parts.Window) -> None:
    ui.add_css(_STYLE)
    ui.colors(primary="#1a5a96")
    screen = window.chosen.setdefault("screen", "Dyno")

    async def change(event: events.ValueChangeEventArguments[Any]) -> None:
        window.chosen["screen"] = event.value
        content.clear()
        with content:  # built again, with what other screens have made
            await _SCREENS[event.value](window)

    with ui.header().classes("items-center bg-blue-grey-10 q-py-none"):
        ui.label("eightpost").classes("text-base text-bold")
        with ui.tabs(value=screen, on_change=change).props("no-caps dense"):
            for name in _SCREENS:
                ui.tab(name)
        ui.space()
        ui.label(str(window.folder.path)).classes("text-xs")
    with ui.column().classes("w-full content") as content:
        await _SCREENS[screen](window)


def _file(window: parts.Window, name: str) -> Response:
    """Return a file of the folder: a page to look at, or another file to save."""
    path = window.folder.served(name)
    if path is None:
        return PlainTextResponse(f"there is no file {name}", 404)
    if path.suffix == ".html":
        return FileResponse(path, media_type="text/html")
    return FileResponse(path, filename=path.name)


# ---- Who may talk to the window: the browser that opened its link, from this machine, on this address ----------------


class _Guard:
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
