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
from ema.core.edits import Edit
from ema.core.errors import FitError, InputError
from pipelines.results.edits_file import edits_of
from pipelines.review import curves
from pipelines.review.bench import Bench, StaleError
from pipelines.review.desk import Desk
from pipelines.review.guard import Guard
from pipelines.review.signing import replay_command, sign, signoff
from pipelines.review.state import refusal
from pipelines.review.why import evidence

_STATIC = Path(__file__).parent / "static"
_ALIVE_S = 10.0
_KINDS = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
}
_PAGES = {"/": "home", "/r/{name}": "review", "/compare": "compare", "/w/{name}": "watch"}

Answer = Callable[[Request], Awaitable[Response]]


class _MissingError(LookupError):
    """Something that a request names is not there."""


def application(desk: Desk, port: int, token: str) -> Guard:
    """The whole application: guard, pages and data."""
    routes = [Route(path, _page(name)) for path, name in _PAGES.items()]
    routes += [
        Route("/static/{name:path}", _static),
        Route("/api/events", _events(desk)),
        Route("/api/r/{name}/{what}", _told(_reading(desk)), methods=["GET"]),
        Route("/api/r/{name}/{what}", _told(_writing(desk)), methods=["POST"]),
    ]
    return Guard(Starlette(routes=routes), port, token)


def _page(name: str) -> Answer:
    async def page(_: Request) -> Response:
        return FileResponse(_STATIC / f"{name}.html", media_type="text/html")

    return page


async def _static(request: Request) -> Response:
    """One of the files of the pages; a name that is none of them leads nowhere."""
    wanted = request.path_params["name"]
    paths = {path.relative_to(_STATIC).as_posix(): path for path in _STATIC.rglob("*.*")}
    if wanted not in paths:
        return _refused(404, {"where": "page", "found": "not found", "rule": "", "remedy": ""})
    return FileResponse(paths[wanted], media_type=_KINDS.get(paths[wanted].suffix, "text/plain"))


def _told(answer: Callable[[Request], Awaitable[Response]]) -> Answer:
    """An answer, and what can go wrong with it as JSON."""

    async def told(request: Request) -> Response:
        try:
            return await answer(request)
        except _MissingError:
            return _refused(404, {"where": "page", "found": "not found", "rule": "", "remedy": ""})
        except FitError as error:
            return _refused(422, refusal(error))
        except InputError as error:
            return _refused(400, refusal(error))

    return told


def _reading(desk: Desk) -> Answer:
    async def reading(request: Request) -> Response:
        bench = _bench(desk, request)
        return await run_in_threadpool(
            _read, bench, request.path_params["what"], request.query_params
        )

    return reading


def _read(bench: Bench, what: str, query: Mapping[str, str]) -> Response:
    sight = bench.sight()
    if what == "state":
        return _json(bench.state())
    if what == "signoff":
        return _json(signoff(bench))
    if what in ("frf", "fit"):
        row = query.get("row", "0")
        if not row.isdecimal() or int(row) >= sight.measured.n_positions:
            raise _MissingError
        make = curves.frf_blob if what == "frf" else curves.fit_blob
        return _blob(make(sight, int(row)))
    if what in ("diagram", "orders", "shapes"):
        whole = getattr(curves, f"{what}_blob")(sight)
        if whole is None:
            raise _MissingError
        return _blob(whole)
    if what == "why" and (row_of := sight.mode_named(query.get("key", ""))) is not None:
        words = {True: "warning", False: "ok", None: ""}
        lines = [
            {"label": each.label, "value": each.value, "verdict": words[each.doubtful]}
            for each in evidence(row_of, sight)
        ]
        return _json({"key": row_of.key, "revision": sight.revision, "lines": lines})
    raise _MissingError


def _writing(desk: Desk) -> Answer:
    async def writing(request: Request) -> Response:
        bench = _bench(desk, request)
        content = await _content(request)
        try:
            return _json(
                await run_in_threadpool(_written, desk, bench, request.path_params["what"], content)
            )
        except StaleError as error:
            told = {"where": "revision", "found": str(error), "rule": "another page changed it"}
            told |= {"remedy": "Look at the new state"}
            return _json({"error": told, "state": bench.state()}, 409)

    return writing


def _written(desk: Desk, bench: Bench, what: str, content: Mapping[str, Any]) -> dict[str, Any]:
    revision = _whole(content, "revision")
    if what == "edit":
        return bench.applied(revision, _edit(content))
    if what == "try":
        return bench.tried(revision, _edit(content))
    if what == "cursor":
        return bench.moved(revision, _whole(content, "cursor"))
    if what == "reason":
        return bench.explained(revision, _whole(content, "index"), _text(content, "reason"))
    if what == "sign":
        by, note, name = (_text(content, each) for each in ("by", "note", "folder"))
        folder = sign(bench, revision, by, note, name)
        told = {"folder": folder.name, "id": desk.name_of(folder)}
        command = replay_command(bench.result, folder)
        bench.signed()
        return {**told, "command": command}
    raise _MissingError


def _edit(content: Mapping[str, Any]) -> Edit:
    return edits_of("request", [content.get("edit")])[0]


def _events(desk: Desk) -> Answer:
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


def _bench(desk: Desk, request: Request) -> Bench:
    bench = desk.bench(request.path_params["name"])
    if bench is None:
        raise _MissingError
    return bench


async def _content(request: Request) -> Mapping[str, Any]:
    try:
        content = json.loads(await request.body())
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        raise InputError("request", "no table", "it is a JSON object", "Reload the page")
    return content


def _whole(content: Mapping[str, Any], name: str) -> int:
    value = content.get(name)
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(name, repr(value)[:80], "it is a whole number", "Reload the page")
    return value


def _text(content: Mapping[str, Any], name: str) -> str:
    value = content.get(name)
    if not isinstance(value, str):
        raise InputError(name, repr(value)[:80], "it is a text", "Reload the page")
    return value


def _refused(status: int, error: Mapping[str, str]) -> Response:
    return _json({"error": dict(error)}, status)


def _json(content: Any, status: int = 200) -> Response:
    return JSONResponse(jsonable(content), status)


def _blob(content: bytes) -> Response:
    return Response(content, media_type="application/octet-stream")
