"""The server of `ringmodal review`: start and end, the guard in front, and the routes."""

from __future__ import annotations

import asyncio
import json
import os
import re
import secrets
import socket
import tempfile
import webbrowser
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping, MutableMapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from ema.core.display import jsonable
from ema.core.errors import InputError
from pipelines import report

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
Event = Mapping[str, Any] | None  # None ends a stream
Answered = tuple[Mapping[str, Any] | bytes, int]  # JSON or arrays, and the status


class Answering(Protocol):
    """Who answers. It takes as long to load as the pages do, and they do not wait for it."""

    def page(self, name: str) -> str:
        """Path of the page to begin with, for a folder that has a name."""

    def read(self, place: list[str], query: Mapping[str, str]) -> Answered:
        """Answer to a request that changes nothing, by the parts of its path below ``/api``."""

    def write(self, place: list[str], content: Mapping[str, Any]) -> Answered:
        """Answer to a request that changes something."""

    def listening(
        self, loop: asyncio.AbstractEventLoop
    ) -> AbstractContextManager[asyncio.Queue[Event]]:
        """Yield a queue of the events from now on."""

    def tell(self, event: Event) -> None:
        """Pass an event on to all pages."""

    def close(self) -> None:
        """End what goes on beside the pages."""

    @property
    def is_busy(self) -> bool:
        """Whether a thread goes on after `close`."""


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


_STATIC = Path(__file__).parent / "static"
_ALIVE_S = 10.0
_KINDS = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
_COLOURS = Path(report.__file__).with_name("colours.css")  # those of the report
# Script of each page; the review has a frame of its own, the others share one.
_PAGES = {"/": "landing", "/r/{name}": "app", "/compare": "compare", "/w/{name}": "watch"}
_IMPORTED = re.compile(r'^(?:import|export)\b.* from "\./(.+?)";$', re.MULTILINE)
_PRELOADED = '<link rel="modulepreload" href="/static/{}">'


def application(office: Future[Answering], port: int, token: str) -> Guard:
    """The whole application: guard, pages and data."""
    files = {path.name: path.read_bytes() for path in (*_STATIC.glob("*.*"), _COLOURS)}
    routes = [Route(path, _page(name, files)) for path, name in _PAGES.items()]
    routes += [
        Route("/static/{name:path}", _static(files)),
        Route("/api/events", _events(office)),
        Route("/api/{place:path}", _reading(office), methods=["GET"]),
        Route("/api/{place:path}", _writing(office), methods=["POST"]),
    ]
    return Guard(Starlette(routes=routes), port, token)


def _page(script: str, files: Mapping[str, bytes]) -> Callable[[Request], Awaitable[Response]]:
    frame = files["review.html" if script == "app" else "page.html"].decode("utf-8")
    preloaded = map(_PRELOADED.format, sorted(_modules(f"{script}.js", files)))
    content = frame.replace("PRELOADED", "\n".join(preloaded)).replace("SCRIPT", script)

    async def page(_: Request) -> Response:
        return HTMLResponse(content)

    return page


def _modules(script: str, files: Mapping[str, bytes]) -> set[str]:
    """All modules that a script needs: a browser that knows them asks for all at once."""
    found, new = set[str](), {script}
    while new:
        found |= new
        new = {name for each in new for name in _IMPORTED.findall(files[each].decode())} - found
    return found - {script}


def _static(files: Mapping[str, bytes]) -> Callable[[Request], Awaitable[Response]]:
    async def static(request: Request) -> Response:
        """One of the files of the pages; a name that is none of them leads nowhere."""
        wanted = request.path_params["name"]
        if wanted not in files or wanted.endswith(".html"):
            error = {"where": "page", "found": "not found", "rule": "", "remedy": ""}
            return _json({"error": error}, 404)
        return Response(files[wanted], media_type=_KINDS[Path(wanted).suffix])

    return static


def _reading(office: Future[Answering]) -> Callable[[Request], Awaitable[Response]]:
    async def reading(request: Request) -> Response:
        there = await asyncio.wrap_future(office)
        query = dict(request.query_params)
        return _told(await run_in_threadpool(there.read, _place(request), query))

    return reading


def _writing(office: Future[Answering]) -> Callable[[Request], Awaitable[Response]]:
    async def writing(request: Request) -> Response:
        try:
            content = json.loads(await request.body())
        except (ValueError, RecursionError):
            content = None
        if not isinstance(content, dict):
            error = {"where": "request", "found": "no table", "rule": "it is a JSON object"}
            return _json({"error": {**error, "remedy": "Reload the page"}}, 400)
        there = await asyncio.wrap_future(office)
        return _told(await run_in_threadpool(there.write, _place(request), content))

    return writing


def _place(request: Request) -> list[str]:
    return str(request.path_params["place"]).split("/")


def _told(answered: Answered) -> Response:
    content, status = answered
    if isinstance(content, bytes):
        return Response(content, media_type="application/octet-stream")
    return _json(content, status)


def _events(office: Future[Answering]) -> Callable[[Request], Awaitable[Response]]:
    async def events(_: Request) -> Response:
        stream = _stream(await asyncio.wrap_future(office))
        return StreamingResponse(stream, media_type="application/x-ndjson")

    return events


async def _stream(office: Answering) -> AsyncIterator[bytes]:
    """Events as lines, from now on, and a sign of life where nothing happens."""
    with office.listening(asyncio.get_running_loop()) as queue:
        yield _line({"kind": "hello"})
        while True:
            try:
                event = await asyncio.wait_for(queue.get(), _ALIVE_S)
            except TimeoutError:
                event = {"kind": "alive"}
            if event is None:
                return
            yield _line(event)


def _line(event: Mapping[str, Any]) -> bytes:
    return json.dumps(jsonable(dict(event))).encode() + b"\n"


def _json(content: Any, status: int = 200) -> Response:
    return JSONResponse(jsonable(content), status)


HOST = "127.0.0.1"
_TOKEN_BYTES = 32
_PAGE = """<!doctype html>
<meta charset="utf-8"><meta http-equiv="refresh" content="0; url={address}#token={token}">
<title>ringmodal review</title><p>Opening ringmodal review …
"""


def serve(
    office: Future[Answering], page: str, port: int, announce: Callable[[str, Path], None]
) -> None:
    """Serve until interrupted.

    Parameters
    ----------
    office : Future of Answering
        Pages do not wait for it, requests for data do.
    page : str
        Path of the page that is opened first.
    port : int
        0 for a free one.
    announce : callable
        Called with the address and the redirect file when pages are answered.
    """
    token = secrets.token_hex(_TOKEN_BYTES)
    with _listening(port) as listener:
        number = listener.getsockname()[1]
        address = f"http://{HOST}:{number}{page}"
        config = uvicorn.Config(
            application(office, number, token),
            log_config=None,
            access_log=False,
            lifespan="off",
            ws="none",
            server_header=False,
            date_header=False,
            timeout_graceful_shutdown=1,
        )
        with _redirect(address, token) as file:
            try:
                _Server(config, lambda: announce(address, file), office).run(sockets=[listener])
            finally:
                if office.done():
                    office.result().close()


def begun(opened: Callable[[], Answering]) -> Future[Answering]:
    """Who answers, from a function that is called in a thread of its own."""
    pool = ThreadPoolExecutor(1, "opening")
    office = pool.submit(opened)
    pool.shutdown(wait=False)
    return office


def open_browser(file: Path) -> None:
    """Open the redirect file; the token is in the file alone, in no argument."""
    webbrowser.open(file.as_uri())


class _Server(uvicorn.Server):
    """A server that says when it is ready, and ends its streams before it waits for their end."""

    def __init__(
        self, config: uvicorn.Config, ready: Callable[[], None], office: Future[Answering]
    ) -> None:
        super().__init__(config)
        self._ready, self._office = ready, office
        office.add_done_callback(self._opened)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self._ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        if self._office.done() and not self._office.exception():
            self._office.result().tell(None)
        await super().shutdown(sockets)

    def _opened(self, office: Future[Answering]) -> None:
        self.should_exit |= office.exception() is not None


@contextmanager
def _listening(port: int) -> Iterator[socket.socket]:
    with socket.socket() as listener:
        try:
            listener.bind((HOST, port))
        except OSError as error:
            rule, remedy = "the port must be free", "Leave out --port"
            raise InputError("--port", f"{port}: {error.strerror}", rule, remedy) from error
        listener.listen()
        yield listener


@contextmanager
def _redirect(address: str, token: str) -> Iterator[Path]:
    """A file that only this user can read, whose page leads to the server with the token."""
    with tempfile.TemporaryDirectory(prefix="ringmodal-") as folder:
        path = Path(folder) / "open.html"
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(_PAGE.format(address=address, token=token))
        yield path
