"""What the server answers, request by request, without anything of the web in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from typing import Any

from ema.core.edits import Edit
from ema.core.errors import InputError
from pipelines.results.edits_file import edits_of
from pipelines.results.result import Result
from pipelines.review import compare, curves
from pipelines.review.bench import Bench
from pipelines.review.desk import Desk
from pipelines.review.signing import replay_command, sign, signoff
from pipelines.review.why import evidence

Content = Mapping[str, Any]
Answer = Mapping[str, Any] | bytes  # bytes are arrays

_RELOAD = "Reload the page"
_BLOBS: dict[str, Callable[..., bytes | None]] = {
    "diagram": curves.diagram_blob,
    "orders": curves.orders_blob,
    "shapes": curves.shapes_blob,
}
_OF_ROW = {"frf": curves.frf_blob, "fit": curves.fit_blob}


class MissingError(LookupError):
    """Something that a request names is not there."""


def read(desk: Desk, place: Sequence[str], query: Mapping[str, str]) -> Answer:
    """Answer to a request that changes nothing.

    Parameters
    ----------
    desk : Desk
    place : sequence of str
        Parts of the path below ``/api``.
    query : mapping of str to str
    """
    match list(place):
        case ["home"]:
            return desk.landing()
        case ["compare"]:
            results, names = _compared(desk, query)
            return compare.compared(results, names)
        case ["compare", "frf"]:
            results, names = _compared(desk, query)
            return compare.frf_blob(results, names, _angle(query))
        case ["w", name] if (watch := desk.watch(name)) is not None:
            return watch.record()
        case ["r", name, what] if (bench := desk.bench(name)) is not None:
            return _of_bench(bench, what, query)
    raise MissingError


def write(desk: Desk, place: Sequence[str], content: Content) -> Content:
    """Answer to a request that changes something; `StaleError` where it is outdated."""
    match list(place):
        case ["home", "process"]:
            return desk.process(_text(content, "id")) or _missing()
        case ["r", name, what] if (bench := desk.bench(name)) is not None:
            return _changed(desk, bench, what, content)
    raise MissingError


def _of_bench(bench: Bench, what: str, query: Mapping[str, str]) -> Answer:
    if what == "state":
        return bench.state()
    if what == "signoff":
        return signoff(bench)
    sight = bench.sight()
    if what in _OF_ROW:
        row = query.get("row", "0")
        if not (row.isascii() and row.isdecimal()) or int(row) >= sight.measured.n_positions:
            raise MissingError
        return _OF_ROW[what](sight, int(row))
    if what in _BLOBS:
        return _BLOBS[what](sight) or _missing()
    if what == "why" and (mode := sight.mode_named(query.get("key", ""))) is not None:
        words = {True: "warning", False: "ok", None: ""}
        lines = [
            {"label": each.label, "value": each.value, "verdict": words[each.doubtful]}
            for each in evidence(mode, sight)
        ]
        return {"key": mode.key, "revision": sight.revision, "lines": lines}
    raise MissingError


def _changed(desk: Desk, bench: Bench, what: str, content: Content) -> Content:
    revision = _whole(content, "revision")
    match what:
        case "edit":
            return bench.applied(revision, _edit(content))
        case "try":
            return bench.tried(revision, _edit(content))
        case "cursor":
            return bench.moved(revision, _whole(content, "cursor"))
        case "reason":
            return bench.explained(revision, _whole(content, "index"), _text(content, "reason"))
        case "sign":
            return _signed(desk, bench, revision, content)
    raise MissingError


def _signed(desk: Desk, bench: Bench, revision: int, content: Content) -> Content:
    by, note, name = (_text(content, each) for each in ("by", "note", "folder"))
    folder = sign(bench, revision, by, note, name)
    command = replay_command(bench.result, folder)
    bench.signed()
    desk.tell({"kind": "home"})
    return {"folder": folder.name, "id": desk.name_of(folder), "command": command}


def _compared(desk: Desk, query: Mapping[str, str]) -> tuple[list[Result], list[str]]:
    names = [name for name in query.get("ids", "").split(",") if name]
    compare.require_few(names)
    results = [desk.result(name) for name in names]
    found = [result for result in results if result is not None]
    return (found, names) if len(found) == len(names) else _missing()


def _angle(query: Mapping[str, str]) -> float:
    try:
        angle = float(query.get("position_deg", "0"))
    except ValueError:
        angle = float("nan")
    if not isfinite(angle):
        raise InputError("position_deg", "no number", "it is an angle in degrees", _RELOAD)
    return angle


def _missing() -> Any:
    raise MissingError


def _edit(content: Content) -> Edit:
    return edits_of("request", [content.get("edit")])[0]


def _whole(content: Content, name: str) -> int:
    value = content.get(name)
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(name, repr(value)[:80], "it is a whole number", _RELOAD)
    return value


def _text(content: Content, name: str) -> str:
    value = content.get(name)
    if not isinstance(value, str):
        raise InputError(name, repr(value)[:80], "it is a text", _RELOAD)
    return value
