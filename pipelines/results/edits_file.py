"""``edits.toml``: what a person decided on a result, written, read and compared with an outcome."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from datetime import datetime
from enum import StrEnum
from math import isfinite
from pathlib import Path
from typing import Any

import tomlkit

from ema.core.edits import OF_CHANNELS, OF_POLES, ChannelName, Edit, EditKind, PoleName
from ema.core.errors import InputError, unknown
from ema.core.files import require_regular
from pipelines.results.options import SETTINGS
from pipelines.results.result import Result, automatic_modes, edit_records
from pipelines.storage.checksums import content_sha256

SCHEMA = 1
EDITS_NAME = "edits.toml"
_ABOUT = ("kind", "by", "at", "reason")
_KINDS = ", ".join(EditKind)


class Replayed(StrEnum):
    """How an outcome compares with that of the record it was made from."""

    EXACT = "exact"
    OTHER_INPUTS = "other inputs"
    OTHER_VERSION = "other version"
    OTHER_OUTCOME = "other outcome"


@dataclass(frozen=True)
class Record:
    """Content of ``edits.toml``.

    Parameters
    ----------
    edits : tuple of Edit
        In their order.
    campaign : str
        Path of the recordings as seen from the file; for the reader.
    inputs : dict of str to str
        SHA-256 of each input by its name.
    software : str
    automatic : str
        Checksum of the automatic list of modes.
    processing : dict
        What was chosen on the way to the modes instead of the manifest.
    selection : tuple of dict
        The outcome: frequency, damping and role of each mode.
    signed : dict
        Who stands for it, when, a note, and the checksum of everything else.
    file : str
        Where it was read from.
    """

    edits: tuple[Edit, ...]
    campaign: str = ""
    inputs: Mapping[str, str] = field(default_factory=dict)
    software: str = ""
    automatic: str = ""
    processing: Mapping[str, Any] = field(default_factory=dict)
    selection: tuple[Mapping[str, Any], ...] = ()
    signed: Mapping[str, str] = field(default_factory=dict)
    file: str = ""

    def compared_with(self, result: Result) -> Replayed | None:
        """How its outcome compares with that of a result; None where it states none."""
        if not self.selection:
            return None
        now = record_of(result)
        if self.inputs != now.inputs:
            return Replayed.OTHER_INPUTS
        if self.software != now.software:
            return Replayed.OTHER_VERSION
        return Replayed.EXACT if self.selection == now.selection else Replayed.OTHER_OUTCOME


def record_of(result: Result) -> Record:
    """The record of a result whose provenance has the path of its inputs as the reader sees it."""
    origin, model = result.provenance, result.modal_model
    inputs = origin.get("inputs", ())
    modes = result.automatic or automatic_modes(model)
    return Record(
        edits=result.edits,
        campaign=next(
            (Path(each["path"]).parent.as_posix() for each in inputs if "path" in each), ""
        ),
        inputs={each["file"]: each["sha256"] for each in inputs},
        software=f"ringmodal {origin.get('software', {}).get('ringmodal', '')}".strip(),
        automatic=content_sha256({"modes": [asdict(mode) for mode in modes]}),
        processing=origin.get("given_processing", {}),
        selection=tuple(
            {
                "frequency_hz": mode.frequency_hz,
                "damping_ratio": mode.damping_ratio,
                "role": mode.chosen.value,
            }
            for mode in model.modes
        ),
        signed=origin.get("signed", {}),
    )


def write_edits(path: Path | str, record: Record) -> None:
    """Write a record; what is signed gets the checksum of everything above."""
    base = {name: getattr(record, name) for name in ("campaign", "inputs", "software", "automatic")}
    content: dict[str, Any] = {
        "schema": SCHEMA,
        "base": {key: part for key, part in base.items() if part},
    }
    content |= {"processing": record.processing}
    content["edit"] = edit_records(record.edits)
    content |= {"selection": {"modes": record.selection} if record.selection else {}}
    document = tomlkit.document()
    for name, part in content.items():
        if name == "edit":
            document.add(tomlkit.nl())
            document[name] = tables = tomlkit.aot()
            for each in content["edit"]:
                tables.append(_section(each))
        elif part:
            document[name] = _section(part) if isinstance(part, Mapping) else part
    if record.signed:
        seal = _seal(tomllib.loads(tomlkit.dumps(document)))
        document["signed"] = _section({**record.signed, "sha256": seal})
    Path(path).write_text(tomlkit.dumps(document), encoding="utf-8", newline="\n")


def _section(record: Mapping[str, Any]) -> Any:
    """A section whose own sections are written in a line each, and a time as TOML has it."""
    section = tomlkit.table()
    for name, value in record.items():
        if name == "at" and value:
            value = datetime.fromisoformat(value)
        section[name] = _inline(value)
    return section


def _inline(value: Any) -> Any:
    if isinstance(value, Mapping):
        line = tomlkit.inline_table()
        line.update({key: _inline(part) for key, part in value.items()})
        return line
    if isinstance(value, tuple) and value and isinstance(value[0], Mapping):
        lines = tomlkit.array().multiline(True)
        lines.extend(map(_inline, value))
        return lines
    return list(value) if isinstance(value, tuple) else value


def _seal(content: Mapping[str, Any]) -> str:
    """Checksum of everything but the signature's own."""
    return content_sha256({name: part for name, part in content.items() if name != "signed"})


def read_edits(path: Path | str) -> Record:
    """Read ``edits.toml``: of a result, or written by hand.

    Needed are only ``[[edit]]`` with ``kind`` and what it names.

    Raises
    ------
    InputError
        If the file is missing, no TOML, misspells a key or kind, has an impossible value, or was
        changed after it was signed.
    """
    path = Path(path)
    content = _parsed(path)
    where = path.name
    known = ("schema", "base", "processing", "edit", "selection", "signed")
    _refuse_others(where, content, known)
    if (schema := content.get("schema", SCHEMA)) != SCHEMA:
        remedy = f"Write schema = {SCHEMA}, or use the version of ringmodal that wrote the file"
        raise InputError(f"{where}, schema", repr(schema), f"this version reads {SCHEMA}", remedy)
    tables = {
        name: _typed(f"{where}, [{name}]", name, content.get(name, {}), dict)
        for name in ("base", "processing", "selection", "signed")
    }
    base, signed = tables["base"], tables["signed"]
    entries = _typed(where, "edit", content.get("edit", []), list)
    if (seal := signed.get("sha256")) is not None and seal != _seal(content):
        rule, remedy = "a signed record must be as it was signed", "Remove [signed], or restore it"
        raise InputError(f"{where}, [signed]", "changed after it was signed", rule, remedy)
    return Record(
        edits=edits_of(where, entries),
        campaign=str(base.get("campaign", "")),
        inputs=_typed(f"{where}, [base]", "inputs", base.get("inputs", {}), dict),
        software=str(base.get("software", "")),
        automatic=str(base.get("automatic", "")),
        processing=settings_of(f"{where}, [processing]", tables["processing"]),
        selection=tuple(tables["selection"].get("modes", ())),
        signed={
            name: _time(f"{where}, [signed]", part) if name == "at" else str(part)
            for name, part in signed.items()
            if name != "sha256"
        },
        file=str(path),
    )


def _parsed(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(require_regular(path).read_text(encoding="utf-8"))
    except OSError as error:
        reason, rule = error.strerror or "unreadable", "it must be a record of decisions"
        raise InputError(str(path), reason, rule, "Check the path") from error
    except (ValueError, RecursionError) as error:  # TOML, UTF-8, an endless number, nesting
        rule = "it must be TOML in UTF-8"
        raise InputError(path.name, str(error), rule, "Correct the line") from error


def edits_of(where: str, entries: Iterable[Any]) -> tuple[Edit, ...]:
    """Edits from entries of a file; `where` is its name."""
    return tuple(_edit(f"{where}, edit {k}", each) for k, each in enumerate(entries, 1))


def _edit(where: str, entry: Any) -> Edit:
    """One ``[[edit]]``; `where` names the file and its number."""
    entry = _typed(where, "edit", entry, dict)
    if "kind" not in entry:
        raise InputError(where, "no kind", "an edit needs it", f"Add kind = one of {_KINDS}")
    name = _typed(where, "kind", entry["kind"], str)
    if name not in EditKind.__members__.values():
        raise unknown(f"{where}, kind", name, f"it must be one of {_KINDS}", tuple(EditKind))
    kind = EditKind(name)
    _refuse_others(f"{where} ({kind})", entry, (*_ABOUT, *_names_of(kind)))
    parts: dict[str, Any] = {}
    if kind in OF_POLES:
        parts["pole"] = _pole(where, _needed(where, entry, "pole", dict))
    if kind in OF_CHANNELS:
        run, number = entry.get("run"), entry.get("reference")
        of_run = None if run is None else _typed(where, "run", run, str)
        if number is not None and (type(number) is not int or number < 1):
            rule = "it is the number of a force: 1, 2, …"
            raise InputError(where, f"reference = {number!r}", rule, "Correct it")
        name = _needed(where, entry, "channel", str)
        parts["channel"] = ChannelName(name, of_run, number)
    if kind is EditKind.RUN_OUT:
        parts["run"] = _needed(where, entry, "run", str)
    if kind in (EditKind.GAIN, EditKind.ORDER_IS):
        parts["value"] = _number(where, "value", _needed(where, entry, "value", object))
    if kind is EditKind.SETTINGS:
        given = _needed(where, entry, "settings", dict)
        parts["settings"] = settings_of(f"{where}, settings", given)
    who = {key: _typed(where, key, entry.get(key, ""), str) for key in ("by", "reason")}
    return Edit(kind, **parts, **who, at=_time(where, entry.get("at", "")))


def _names_of(kind: EditKind) -> tuple[str, ...]:
    """Keys by which an edit of a kind says what it acts on."""
    if kind in OF_POLES:
        return ("pole", "value") if kind is EditKind.ORDER_IS else ("pole",)
    if kind in OF_CHANNELS:
        names = "channel", "run", "reference"
        return (*names, "value") if kind is EditKind.GAIN else names
    return {EditKind.RUN_OUT: ("run",), EditKind.SETTINGS: ("settings",)}.get(kind, ())


def _pole(where: str, entry: Mapping[str, Any]) -> PoleName:
    place = f"{where}, pole"
    _refuse_others(place, entry, ("method", "order", "frequency_hz", "damping_ratio", "cluster"))
    hz = _number(place, "frequency_hz", _needed(place, entry, "frequency_hz", object))
    if hz <= 0:
        raise InputError(place, f"frequency_hz = {hz:g}", "it must be > 0", "Correct it")
    ratio, order = entry.get("damping_ratio"), entry.get("order")
    method = entry.get("method")
    return PoleName(
        hz,
        None if ratio is None else _number(place, "damping_ratio", ratio),
        None if method is None else _setting(place, "method", method),
        None if order is None else _setting(place, "max_order", order, "order"),
    )


def settings_of(where: str, entry: Mapping[str, Any]) -> dict[str, Any]:
    """Settings by the names of `SETTINGS`, checked one by one."""
    _refuse_others(where, entry, tuple(SETTINGS))
    return {name: _setting(where, name, value) for name, value in entry.items()}


def _setting(where: str, name: str, value: Any, shown: str = "") -> Any:
    is_valid, rule = SETTINGS[name]
    if not is_valid(value):
        raise InputError(where, f"{shown or name} = {value!r}", rule, "Correct it")
    return value


def _needed(where: str, entry: Mapping[str, Any], name: str, kind: type) -> Any:
    if name not in entry:
        raise InputError(where, f"no {name}", "an edit of this kind needs it", f"Add {name} = …")
    return _typed(where, name, entry[name], kind)


def _typed(where: str, name: str, value: Any, kind: type) -> Any:
    if not isinstance(value, kind):
        said = "text" if kind is str else "a table" if kind is dict else "a list of tables [[edit]]"
        raise InputError(where, f"{name} = {value!r}", f"it must be {said}", "Correct it")
    return value


def _number(where: str, name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise InputError(where, f"{name} = {value!r}", "it must be a number", f"Write {name} = …")
    return float(value)


def _time(where: str, value: Any) -> str:
    if isinstance(value, datetime):
        return value.isoformat()
    try:
        return datetime.fromisoformat(value).isoformat() if value else ""
    except (TypeError, ValueError) as error:
        rule = "it must be a time"
        remedy = "Write e.g. at = 2026-11-27T14:02:11Z"
        raise InputError(where, f"at = {value!r}", rule, remedy) from error


def _refuse_others(where: str, entry: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in entry:
        if key not in known:
            raise unknown(where, key, f"known are {', '.join(known)}", known)
