"""The window answers only the browser that opened its link, on its own address."""

import asyncio

import pytest

pytest.importorskip("nicegui")

from starlette.responses import PlainTextResponse

from eightpost.window.server import _Guard

_PORT, _TOKEN = 8000, "token-of-the-link"


def _answer(*, kind="http", query=b"", **headers):
    """Return the status and headers of the answer to a request, or the code that closes a websocket."""
    sent = []

    async def send(message):
        sent.append(message)

    async def app(scope, receive, send):
        if scope["type"] == "websocket":
            await send({"type": "websocket.accept"})
        else:
            await PlainTextResponse("the window")(scope, receive, send)

    given = {"host": f"127.0.0.1:{_PORT}", **headers}
    scope = {
        "type": kind, "method": "GET", "path": "/", "query_string": query,
        "headers": [(name.encode(), value.encode()) for name, value in given.items()],
    }  # fmt: skip
    asyncio.run(_Guard(app, _PORT, _TOKEN)(scope, None, send))
    first = sent[0]
    return first.get("status") or first["type"], {k.decode(): v.decode() for k, v in first.get("headers", [])}


_COOKIE = f"eightpost_{_PORT}={_TOKEN}"


@pytest.mark.parametrize(
    ("request_headers", "status"),
    [
        ({"cookie": _COOKIE}, 200),
        ({"cookie": _COOKIE, "host": f"localhost:{_PORT}"}, 200),
        ({"cookie": _COOKIE, "origin": f"http://127.0.0.1:{_PORT}"}, 200),
        ({}, 403),
        ({"cookie": f"eightpost_{_PORT}=another"}, 403),
        ({"cookie": f"eightpost_8001={_TOKEN}"}, 403),
        ({"cookie": _COOKIE, "host": f"evil.example:{_PORT}"}, 403),
        ({"cookie": _COOKIE, "origin": "http://evil.example"}, 403),
        ({"cookie": _COOKIE, "origin": "null"}, 403),
    ],
)
def test_a_request_needs_the_cookie_the_own_host_and_the_own_origin(request_headers, status):
    assert _answer(**request_headers)[0] == status


def test_the_link_is_turned_into_a_cookie_that_scripts_and_other_sites_do_not_get():
    status, headers = _answer(query=f"token={_TOKEN}".encode())
    assert status == 303
    assert headers["location"] == "/"
    assert _TOKEN in headers["set-cookie"]
    assert {"httponly", "samesite=strict"} <= set(headers["set-cookie"].lower().split("; "))


def test_a_link_with_another_token_is_refused():
    assert _answer(query=b"token=guess")[0] == 403
    assert _answer(query=f"token={_TOKEN}".encode(), host="evil.example")[0] == 403


@pytest.mark.parametrize(("cookie", "answer"), [(_COOKIE, "websocket.accept"), ("", "websocket.close")])
def test_the_live_connection_needs_the_cookie_too(cookie, answer):
    assert _answer(kind="websocket", cookie=cookie)[0] == answer
