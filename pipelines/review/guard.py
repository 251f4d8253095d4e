"""What every request must fulfil before it is looked at: only this machine's own pages get data.

A page of another site can send requests to the loopback address, and a name that it controls can
lead there (DNS rebinding). So the host must be the loopback address itself, whatever the origin;
whoever asks for data needs the token, and whoever changes anything the right origin too.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from typing import Any

TOKEN_HEADER = "X-Ringmodal-Token"
MOST_BYTES = 2**18  # of a request
_READING, _WRITING = ("GET", "HEAD"), "POST"
_OWN_SITE = (None, b"same-origin", b"none")
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'; "
    "base-uri 'none'; form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Message, Receive, Send], Awaitable[None]]


@dataclass(frozen=True)
class _RefusedError(Exception):
    status: int
    found: str
    rule: str


@dataclass(frozen=True)
class Guard:
    """An ASGI application before the routes of another.

    Parameters
    ----------
    app : callable
    port : int
        Of this server: part of its host and origin.
    token : str
        What a page sends with every request for data.
    """

    app: App
    port: int
    token: str

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        try:
            self._require_own(scope)
            body = await _whole(receive) if scope["method"] == _WRITING else None
        except _RefusedError as refused:
            await _refuse(refused, send)
            return

        async def replayed() -> Message:
            nonlocal body
            if body is None:
                return await receive()
            content, body = body, None
            return {"type": "http.request", "body": content, "more_body": False}

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *_header_pairs()]
            await send(message)

        await self.app(scope, replayed, with_headers)

    def _require_own(self, scope: Message) -> None:
        if scope["type"] != "http":
            raise _RefusedError(400, str(scope["type"]), "only HTTP is spoken here")
        hosts = {f"{name}:{self.port}".encode() for name in ("127.0.0.1", "localhost")}
        host = _only(scope, b"host")
        if host not in hosts:
            raise _RefusedError(400, "a foreign host", "the address is 127.0.0.1 and the port")
        method, data = scope["method"], str(scope["path"]).startswith("/api/")
        if method not in (*_READING, _WRITING) or (method == _WRITING and not data):
            raise _RefusedError(405, str(method), "it is GET, or POST below /api/")
        origin, site = _only(scope, b"origin"), _only(scope, b"sec-fetch-site")
        if origin is not None and origin != b"http://" + host:
            raise _RefusedError(
                403, "a foreign origin", "requests come from the server's own pages"
            )
        if method == _WRITING and origin is None:
            raise _RefusedError(
                403, "no origin", "what changes anything states where it comes from"
            )
        if data:
            if site not in _OWN_SITE:
                raise _RefusedError(
                    403, "another site", "requests come from the server's own pages"
                )
            given = _only(scope, TOKEN_HEADER.lower().encode()) or b""
            if not secrets.compare_digest(given, self.token.encode()):
                raise _RefusedError(
                    401, "no valid token", "open the page through the file named at the start"
                )
        if method == _WRITING:
            kind = (_only(scope, b"content-type") or b"").split(b";")[0].strip().lower()
            if kind != b"application/json":
                raise _RefusedError(415, "other content", "it is application/json")
            length = _only(scope, b"content-length") or b"0"
            if not length.isdigit() or int(length) > MOST_BYTES:
                raise _RefusedError(413, "a large request", f"it has at most {MOST_BYTES} bytes")


def _only(scope: Message, name: bytes) -> bytes | None:
    """A header that is given once, None where it is missing."""
    found = [value for header, value in scope["headers"] if header.lower() == name]
    if len(found) > 1:
        raise _RefusedError(400, f"{name.decode()} given twice", "a header is given once")
    return found[0] if found else None


async def _whole(receive: Receive) -> bytes:
    """The body of a request, read no further than it may be long."""
    parts, size, more = [], 0, True
    while more:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise _RefusedError(400, "an incomplete request", "the browser sends it whole")
        parts.append(message.get("body", b""))
        size, more = size + len(parts[-1]), message.get("more_body", False)
        if size > MOST_BYTES:
            raise _RefusedError(413, "a large request", f"it has at most {MOST_BYTES} bytes")
    return b"".join(parts)


async def _refuse(refused: _RefusedError, send: Send) -> None:
    error = {"where": "request", "found": refused.found, "rule": refused.rule, "remedy": ""}
    body = json.dumps({"error": error}).encode()
    own = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
    headers = [*own, (b"connection", b"close"), *_header_pairs()]
    await send({"type": "http.response.start", "status": refused.status, "headers": headers})
    await send({"type": "http.response.body", "body": body})


def _header_pairs() -> list[tuple[bytes, bytes]]:
    return [(name.lower().encode(), value.encode()) for name, value in _HEADERS.items()]
