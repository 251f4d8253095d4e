"""What the server answers, request by request, without anything of the web; the sign-off."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path
from typing import Any

from ema.core.display import value_with_std
from ema.core.edits import OF_CHANNELS, OF_POLES, Edit, EditKind
from ema.core.errors import FitError, InputError
from ema.core.modes import Mode
from pipelines import report, review
from pipelines.process.refit import of_blocks, refit
from pipelines.results.edits_file import EDITS_NAME, edits_of
from pipelines.results.result import Result
from pipelines.review import curves
from pipelines.review.bench import Bench, Desk, StaleError
from pipelines.review.curves import evidence
from pipelines.review.sight import ModeRow, Sight, edit_text, refusal
from pipelines.review.worker import recordings_of, replayed
from pipelines.storage.atomic import MARKER

_FAR_SIGMA = 3.0  # a change that is worth a warning
_WORSE = 1.05  # ratio of the reduced χ² above which a fit got worse
_MOST_LETTERS = 200  # of a name
_REVIEWED = "reviewed"
_RELOAD = "Reload the page"
_BLOBS: dict[str, Callable[..., bytes | None]] = {
    "diagram": curves.diagram_blob,
    "orders": curves.orders_blob,
    "shapes": curves.shapes_blob,
}
_OF_ROW = {"frf": curves.frf_blob, "fit": curves.fit_blob}


def signoff(bench: Bench) -> dict[str, Any]:
    """What there is to sign."""
    sight = bench.sight()
    target = proposed(bench.folder)
    return {
        "ready": bench.is_final,
        "revision": sight.revision,
        "edits": [
            {"text": edit_text(edit, sight), "reason": edit.reason, "by": edit.by}
            for edit in sight.session.edits
        ],
        "modes": [_mode(row) for row in sight.modes],
        "chi2": sight.model.misfit,
        "chi2_automatic": sight.automatic.misfit,
        "warnings": list(_warnings(sight)),
        "folder": target.name,
        "command": replay_command(bench.result, target),
    }


def sign(bench: Bench, revision: int, by: str, note: str, name: str) -> Path:
    """Write the result with its edits, signed, as a new folder beside the one that was opened.

    Raises
    ------
    InputError
        If nobody signs, or the name is none for a new folder.
    StaleError
        If the numbers shown are not final, or not those of this revision.
    """
    if not by.strip() or len(by) > _MOST_LETTERS:
        rule = f"a result is signed by a name of up to {_MOST_LETTERS} letters"
        raise InputError("by", repr(by)[:80], rule, "Type your name")
    target = _beside(bench.folder, name)
    bench.require(revision)
    if not bench.is_final:
        raise StaleError("the final fit is not done")
    edits = bench.session.edits
    again = (replayed if of_blocks(edits) else refit)(bench.result, edits)
    at = datetime.now(UTC).isoformat(timespec="seconds")
    signed = {"by": by.strip(), "at": at, **({"note": note} if note else {})}
    bench.require(revision)
    report.write.save(replace(again, provenance={**again.provenance, "signed": signed}), target)
    return target


def proposed(result: Path) -> Path:
    """A free name beside a result."""
    number, first = 1, result.with_name(f"{result.name}_{_REVIEWED}")
    place = first
    while place.exists():
        number += 1
        place = first.with_name(f"{first.name}_{number}")
    return place


def replay_command(result: Result, target: Path) -> str:
    """The command that gives the signed result again."""
    sources = [str(path) for path in recordings_of(result)] or ["CAMPAIGN"]
    again = target.with_name(f"{target.name}_again")
    command = ["ringmodal", "process", *sources, "--edits", str(target / EDITS_NAME)]
    return shlex.join([*command, "--out", str(again)])


def _beside(result: Path, name: str) -> Path:
    """The new folder; the page gives a name, never a path."""
    plain = name == Path(name).name and not name.startswith(".") and name.isprintable()
    if not name or not plain or "\\" in name or len(name) > _MOST_LETTERS:
        rule = f"it is a plain name of up to {_MOST_LETTERS} letters"
        raise InputError("folder", repr(name)[:80], rule, "Type another one")
    return result.with_name(name)


def _mode(row: ModeRow) -> dict[str, Any]:
    before = row.automatic
    shift, _ = row.shift_in_std()
    return {
        "name": row.name,
        "automatic": "" if before is None else _in_words(before),
        "signed": _in_words(row.mode) if row.listed else row.chosen,
        "delta_sigma": shift,
        "chosen": row.chosen,
    }


def _in_words(mode: Mode) -> str:
    frequency = value_with_std(mode.frequency_hz, mode.frequency_std_hz)
    return f"{frequency} Hz, {100 * mode.damping_ratio:#.3g} %"


def _warnings(sight: Sight) -> Iterator[str]:
    now, before = sight.model.misfit, sight.automatic.misfit
    if now > _WORSE * before:
        yield (
            f"The fit is worse than the automatic one: χ² {before:.3g} → {now:.3g}. You may sign; "
            "the report will say so."
        )
    for row in sight.modes:
        if abs(row.shift_in_std()[0]) > _FAR_SIGMA:
            shift = row.shift_in_std()[0]
            yield f"{row.called} moved by {shift:+.0f} σ against the automatic result."
    yield from _without_reason(sight)


def _without_reason(sight: Sight) -> Iterator[str]:
    counted: Sequence[EditKind] = (*OF_POLES, *OF_CHANNELS, EditKind.RUN_OUT)
    bare = [edit for edit in sight.session.edits if edit.kind in counted and not edit.reason]
    if bare:
        yield f"{len(bare)} of {len(sight.session.edits)} edits have no reason."


Content = Mapping[str, Any]
Answer = Mapping[str, Any] | bytes  # bytes are arrays


class MissingError(LookupError):
    """Something that a request names is not there."""


class Office(Desk):
    """A desk that answers, whatever goes wrong: what the server wants."""

    @classmethod
    def opened(cls, place: Path, name: str) -> Office:
        """With a result, a campaign or a folder of them, which has a name in addresses."""
        is_result = (place / MARKER).is_file()
        office = cls(place.parent if is_result else place, {name: place})
        if is_result:
            with suppress(InputError):  # the page learns of it
                office.bench(name)
        return office

    def page(self, name: str) -> str:
        """Path of the page to begin with, for a folder that has a name."""
        place = self.place(name)
        if place is None:
            return "/"
        if (place / MARKER).is_file():
            return f"/r/{name}"
        return f"/w/{name}" if review.folder.is_at_rig(place) else "/"

    def read(self, place: Sequence[str], query: Mapping[str, str]) -> tuple[Answer, int]:
        """Answer to a request that changes nothing, with its status."""
        return _answered(lambda: read(self, place, query))

    def write(self, place: Sequence[str], content: Content) -> tuple[Answer, int]:
        """Answer to a request that changes something, with its status."""
        try:
            return _answered(lambda: write(self, place, content))
        except StaleError as error:
            told = {"where": "revision", "found": str(error), "rule": "another page changed it"}
            told |= {"remedy": "Look at the new state"}
            bench = self.bench(place[1])
            return {"error": told, "state": bench and bench.state()}, 409


def _answered(answer: Callable[[], Answer]) -> tuple[Answer, int]:
    try:
        return answer(), 200
    except MissingError:
        return {"error": {"where": "page", "found": "not found", "rule": "", "remedy": ""}}, 404
    except FitError as error:
        return {"error": refusal(error)}, 422
    except InputError as error:
        return {"error": refusal(error)}, 400


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
            return review.folder.compared(results, names)  # type: ignore[no-any-return]
        case ["compare", "frf"]:
            results, names = _compared(desk, query)
            return review.folder.frf_blob(results, names, _angle(query))  # type: ignore[no-any-return]
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
        if not _is_number(row) or not sight.has_row(int(row)):
            raise MissingError
        return _OF_ROW[what](sight, int(row))
    if what == "force":
        return curves.force_blob(sight, query.get("run", "")) or _missing()
    if what in _BLOBS:
        force = query.get("force", "1")
        if not _is_number(force) or not 0 < int(force) <= len(sight.of_forces):
            raise MissingError
        return _BLOBS[what](sight, int(force) - 1) or _missing()
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
    desk.tell({"kind": "signed", "id": bench.name, "folder": folder.name})
    bench.signed()
    desk.tell({"kind": "home"})
    return {"folder": folder.name, "id": desk.name_of(folder), "command": command}


def _compared(desk: Desk, query: Mapping[str, str]) -> tuple[list[Result], list[str]]:
    names = [name for name in query.get("ids", "").split(",") if name]
    review.folder.require_few(names)
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


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdecimal() and len(text) < _MOST_LETTERS


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
