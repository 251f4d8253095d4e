"""The routes of `ringmodal review`, behind the guard."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from ema.core.display import jsonable
from ema.core.errors import FitError, InputError
from pipelines.review.answers import Answer, MissingError, read, write
from pipelines.review.bench import StaleError
from pipelines.review.desk import Desk
from pipelines.review.guard import Guard
from pipelines.review.state import refusal

_STATIC = Path(__file__).parent / "static"
_ALIVE_S = 10.0
_KINDS = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
}
_PAGES = {"/": "home", "/r/{name}": "review", "/compare": "compare", "/w/{name}": "watch"}
_NOT_FOUND = {"where": "page", "found": "not found", "rule": "", "remedy": ""}


def application(desk: Desk, port: int, token: str) -> Guard:
    """The whole application: guard, pages and data."""
    routes = [Route(path, _page(name)) for path, name in _PAGES.items()]
    routes += [
        Route("/static/{name:path}", _static),
        Route("/api/events", _events(desk)),
        Route("/api/{place:path}", _reading(desk), methods=["GET"]),
        Route("/api/{place:path}", _writing(desk), methods=["POST"]),
    ]
    return Guard(Starlette(routes=routes), port, token)


def _page(name: str) -> Callable[[Request], Awaitable[Response]]:
    async def page(_: Request) -> Response:
        return FileResponse(_STATIC / f"{name}.html", media_type="text/html")

    return page


async def _static(request: Request) -> Response:
    """One of the files of the pages; a name that is none of them leads nowhere."""
    wanted = request.path_params["name"]
    paths = {path.relative_to(_STATIC).as_posix(): path for path in _STATIC.rglob("*.*")}
    if wanted not in paths:
        return _json({"error": _NOT_FOUND}, 404)
    return FileResponse(paths[wanted], media_type=_KINDS.get(paths[wanted].suffix, "text/plain"))


def _reading(desk: Desk) -> Callable[[Request], Awaitable[Response]]:
    async def reading(request: Request) -> Response:
        query = dict(request.query_params)
        return await _answered(lambda: read(desk, _place(request), query))

    return reading


def _writing(desk: Desk) -> Callable[[Request], Awaitable[Response]]:
    async def writing(request: Request) -> Response:
        try:
            content = json.loads(await request.body())
        except (ValueError, RecursionError):
            content = None
        if not isinstance(content, dict):
            error = {"where": "request", "found": "no table", "rule": "it is a JSON object"}
            return _json({"error": {**error, "remedy": "Reload the page"}}, 400)
        place = _place(request)
        try:
            return await _answered(lambda: write(desk, place, content))
        except StaleError as error:
            told = {"where": "revision", "found": str(error), "rule": "another page changed it"}
            told |= {"remedy": "Look at the new state"}
            bench = desk.bench(place[1])
            return _json({"error": told, "state": bench and bench.state()}, 409)

    return writing


def _place(request: Request) -> list[str]:
    return str(request.path_params["place"]).split("/")


async def _answered(answer: Callable[[], Answer]) -> Response:
    """The answer of a thread, and what can go wrong with it as JSON."""
    try:
        content = await run_in_threadpool(answer)
    except MissingError:
        return _json({"error": _NOT_FOUND}, 404)
    except FitError as error:
        return _json({"error": refusal(error)}, 422)
    except InputError as error:
        return _json({"error": refusal(error)}, 400)
    if isinstance(content, bytes):
        return Response(content, media_type="application/octet-stream")
    return _json(content)


def _events(desk: Desk) -> Callable[[Request], Awaitable[Response]]:
    async def events(_: Request) -> Response:
        return StreamingResponse(_stream(desk), media_type="application/x-ndjson")

    return events


async def _stream(desk: Desk) -> AsyncIterator[bytes]:
    """Events as lines, from now on, and a sign of life where nothing happens."""
    with desk.listening(asyncio.get_running_loop()) as queue:
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
