"""The landing page of a folder, and several of its results side by side."""

from __future__ import annotations

import csv
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import reduce
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from ema.core.display import counted
from ema.core.errors import InputError
from ema.core.files import resolve
from ema.core.modes import ModalModel, Mode, Pair
from ema.io.campaign.manifest import MANIFEST_NAME, read_manifest
from ema.io.campaign.read import recordings_in
from ema.io.formats import is_recording
from ema.poles.stability import METHOD_NAMES
from pipelines.batch.state import BatchFolder, Record, read_record
from pipelines.compare.compare import common_shapes
from pipelines.compare.modes import match_modes, seen_by
from pipelines.library.history import verdict_text
from pipelines.library.library import TyreLibrary
from pipelines.library.version import LibraryTyre
from pipelines.results.result import Result
from pipelines.results.tables import in_band
from pipelines.review.curves import blob
from pipelines.review.session import n_drafted
from pipelines.review.sight import mode_label
from pipelines.storage.atomic import MARKER

_MOST_FOLDERS = 5000  # that are looked into
_RECENT_S = 600.0  # a batch without a new record for so long is not running
_RATE_OVER = 10  # records over which the speed of a batch is taken
_CHI_SQUARE = 2.0  # reduced, above which a fit is worth a look
_MB = 1e6

Named = Callable[[Path], str]
MOST_RESULTS = 12
# Conditions over which modes are tracked: key of [tyre], name, unit, factor.
_AXES = (
    ("inflation_pressure_pa", "pressure", "bar", 1e-5),
    ("load_n", "load", "N", 1.0),
    ("temperature_c", "temperature", "°C", 1.0),
)


@dataclass(frozen=True)
class Found:
    """What a folder has, by kind."""

    results: tuple[Path, ...]
    campaigns: tuple[Path, ...]
    batches: tuple[Path, ...]
    libraries: tuple[Path, ...]


def search(root: Path) -> Found:
    """Look into a folder at any depth; links are not followed, hidden folders left out."""
    found: dict[str, list[Path]] = {name: [] for name in Found.__dataclass_fields__}
    for number, (place, folders, files) in enumerate(os.walk(root)):
        path = Path(place)
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        if number >= _MOST_FOLDERS:
            break
        if MARKER in files:
            found["results"].append(path)
            folders.clear()
        elif "records" in folders and "results" in folders:
            found["batches"].append(path)
            folders.remove("records")
        elif MANIFEST_NAME in files or any(is_recording(path / name) for name in files):
            found["campaigns"].append(path)
        elif any(LibraryTyre(path / name).newest for name in folders):
            found["libraries"].append(path)
            folders.clear()
    return Found(**{name: tuple(paths) for name, paths in found.items()})


def is_at_rig(folder: Path) -> bool:
    """Whether a folder is one campaign, perhaps without a manifest or before its first recording.

    With a result in it, or further campaigns, there is more to show than its runs.
    """
    if (folder / MANIFEST_NAME).is_file():
        return True
    found = search(folder)
    return set(found.campaigns) <= {folder} and not (
        found.results or found.batches or found.libraries
    )


def landing(root: Path, named: Named, jobs: Mapping[Path, Mapping[str, Any]]) -> dict[str, Any]:
    """What the landing page shows, in names instead of paths."""
    found = search(root)
    results = [_result(path, root, named) for path in found.results]
    results.sort(key=lambda row: (not row["needs_look"], -len(row["doubts"]), row["name"]))
    done = {row["campaign"] for row in results}
    open_ones = [path for path in found.campaigns if path.name not in done or path in jobs]
    return {
        "folder": str(root),
        "batch": next((_batch(path, found, root) for path in found.batches), None),
        "results": results,
        "campaigns": [_campaign(path, root, named, jobs.get(path)) for path in open_ones],
        "libraries": [_library(path, root) for path in found.libraries],
    }


def _shown(path: Path, root: Path) -> str:
    return path.name if path == root else path.relative_to(root).as_posix()


def _result(path: Path, root: Path, named: Named) -> dict[str, Any]:
    row: dict[str, Any] = {"id": named(path), "name": _shown(path, root), "campaign": ""}
    row |= {"tyre": "", "modes": None, "pairs": None, "chi2": None, "doubts": [], "reviewed": ""}
    try:
        row |= _content(path)
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        row["doubts"] = ["cannot be read"]
    row["needs_look"] = bool(row["doubts"]) and not row["reviewed"].startswith("signed")
    return row


def _content(path: Path) -> dict[str, Any]:
    record = json.loads((path / MARKER).read_text(encoding="utf-8"))
    stored = json.loads((path / "identification.json").read_text(encoding="utf-8"))
    with (path / "modes.csv").open(encoding="utf-8", newline="") as file:
        modes = list(csv.DictReader(file))
    tyre, signed = stored["tyre"], record.get("signed") or {}
    pressure = None if tyre is None else tyre["inflation_pressure_pa"]
    drafted = n_drafted(path)
    reviewed = f"draft, {counted(drafted, 'edit')}" if drafted else ""
    if signed and not reviewed:
        reviewed = f"signed {signed.get('by', '')} {str(signed.get('at', ''))[:10]}"
    misfit = float(stored["misfit"])
    return {
        "campaign": record["campaign"],
        "tyre": ""
        if tyre is None
        else tyre["designation"] + ("" if pressure is None else f", {pressure / 1e5:.3g} bar"),
        "modes": len(modes),
        "pairs": sum(mode["pair"] == Pair.RESOLVED and mode["member"] == "a" for mode in modes),
        "chi2": misfit if isfinite(misfit) else None,
        "doubts": list(_doubts(record, stored, modes, misfit)),
        "reviewed": reviewed,
    }


def _doubts(
    record: Mapping[str, Any], stored: Mapping[str, Any], modes: list[dict[str, str]], misfit: float
) -> Iterator[str]:
    if warnings := len(record.get("warnings", ())):
        yield counted(warnings, "warning")
    if out := sum(bool(each["excluded"]) for each in stored["corrections"]):
        yield f"{counted(out, 'channel')} left out"
    if doubtful := sum(mode["status"] != "ok" for mode in modes):
        yield f"{counted(doubtful, 'mode')} in doubt"
    seen = [each for each in stored["opinions"] if each["mode_hz"] is not None]
    apart = sum(not each["agrees"] for each in seen if isfinite(float(each["mode_hz"])))
    if apart:
        yield f"{METHOD_NAMES[seen[0]['method']]} disagrees on {counted(apart, 'mode')}"
    if misfit > _CHI_SQUARE:
        yield f"χ² {misfit:.3g}"


def _campaign(
    path: Path, root: Path, named: Named, job: Mapping[str, Any] | None
) -> dict[str, Any]:
    manifest = "none"
    files: list[Path] = []
    try:
        if (path / MANIFEST_NAME).is_file():
            sections = read_manifest(path / MANIFEST_NAME).runs
            files = [resolve(path / MANIFEST_NAME, each.file) for each in sections]
            manifest = "ready"
        else:
            files = recordings_in(path)
    except InputError as error:
        manifest = f"error: {error.found}"
    there = [file for file in files if file.is_file()]
    size = sum(file.stat().st_size for file in there) / _MB
    kinds = sorted({file.suffix.lstrip(".").upper() for file in files})
    missing = len(files) - len(there)
    return {
        **{"id": named(path), "name": _shown(path, root), "manifest": manifest},
        "files": f"{len(there)} {'/'.join(kinds)}, {size:.0f} MB",
        "measuring": missing > 0,
        "job": None if job is None else dict(job),
    }


def _batch(path: Path, found: Found, root: Path) -> dict[str, Any]:
    folder = BatchFolder(path)
    records: list[tuple[float, Record]] = []
    for file in folder.path.joinpath("records").rglob("record.json"):
        with suppress(OSError):
            if (record := read_record(file)) is not None:
                records.append((file.stat().st_mtime, record))
    records.sort(key=lambda each: each[0])
    times = [at for at, _ in records]
    failed = [record for _, record in records if not record.is_done]
    recent = bool(times) and time.time() - times[-1] < _RECENT_S
    running = recent and not _is_summed_up(folder, times[-1])
    total = max(len(found.campaigns), len(records)) if running else len(records)
    known = times[-_RATE_OVER:]
    rate = 60 * (len(known) - 1) / (known[-1] - known[0]) if running and len(known) > 1 else None
    return {
        **{"name": _shown(path, root), "done": len(records), "total": total, "running": running},
        "failed": len(failed),
        "failures": [{"name": each.campaign, "why": each.message} for each in failed],
        "per_minute": rate,
    }


def _is_summed_up(folder: BatchFolder, newest: float) -> bool:
    """Whether the tables at the end of a batch are newer than its records."""
    return folder.is_complete() and folder.summary.stat().st_mtime >= newest


def _library(path: Path, root: Path) -> dict[str, Any]:
    sets = []
    with suppress(InputError, OSError):
        for tyre in TyreLibrary(path).tyres():
            sets.append(_tyre(tyre))
    return {"name": _shown(path, root), "sets": sets}


def _tyre(tyre: LibraryTyre) -> dict[str, Any]:
    row = {"tyre": tyre.name, "versions": tyre.newest, "approved": "", "verdict": ""}
    with suppress(InputError, OSError):
        row["verdict"] = verdict_text(tyre.latest_intact().parameters)
        approval, version = tyre.approval(), tyre.approved()
        if approval is not None and version is not None:
            row["approved"] = f"v{version.number}, {approval.author}"
    return row


_HOUR_S, _DAY_S = 3600.0, 86400.0
_LONG_S = 3 * _DAY_S  # times farther apart are shown in days


@dataclass(frozen=True)
class _Track:
    """A mode through the results, None where one does not have it."""

    modes: list[Mode | None]

    @property
    def seen(self) -> list[tuple[int, Mode]]:
        """The mode in the results that have it."""
        return [(number, mode) for number, mode in enumerate(self.modes) if mode is not None]


def compared(results: Sequence[Result], names: Sequence[str]) -> dict[str, Any]:
    """Modes of several results as tracks, and the conditions that all of them state."""
    axes = [*(_axis(results, *each) for each in _AXES), _time_axis(results)]
    tracks = sorted(_tracks(results), key=lambda each: each.seen[-1][1].frequency_hz)
    return {
        "results": [
            {"id": name, "name": result.name, "condition": _condition(result)}
            for name, result in zip(names, results, strict=True)
        ],
        "tracks": [
            {
                **{"name": mode_label(each.seen[-1][1]), "order": each.seen[-1][1].order},
                "points": list(map(_point, results, each.modes)),
            }
            for each in tracks
        ],
        "axes": [axis for axis in axes if axis is not None],
    }


def frf_blob(results: Sequence[Result], names: Sequence[str], position_deg: float) -> bytes:
    """The FRF of each result at the position nearest to an angle."""
    arrays, rows = {}, []
    for number, result in enumerate(results):
        frf = result.frf
        away = np.abs((frf.position_deg - position_deg + 180) % 360 - 180)
        row = 0 if np.all(np.isnan(away)) else int(np.nanargmin(away))
        lines = in_band(frf.frequency_hz, result.modal_model.fit_band_hz)
        values = frf.values[row, lines]
        arrays[f"frequency_hz_{number}"] = frf.frequency_hz[lines]
        arrays |= {f"real_{number}": values.real, f"imag_{number}": values.imag}
        angle = float(frf.position_deg[row])
        rows.append({"row": row, "position_deg": angle if np.isfinite(angle) else None})
    return blob({"results": list(names), "rows": rows}, arrays)


def _tracks(results: Sequence[Result]) -> list[_Track]:
    """The same modes by the rules of `compare`, each with the last result that has it.

    Where one of the results has one mode of an order, the others show the mean of their pair.
    """
    models = [result.modal_model for result in results]
    sides = [reduce(lambda own, other: seen_by(own, other).model, models, own) for own in models]
    tracks: list[_Track] = []
    for number, side in enumerate(sides):
        left = list(side.modes)
        for earlier in range(number - 1, -1, -1):
            known = [track for track in tracks if track.seen[-1][0] == earlier]
            for track, mode in _matched(sides[earlier], side, known, left):
                track.modes.append(mode)
                left = [each for each in left if each is not mode]
        for track in tracks:
            track.modes.extend([None] * (number + 1 - len(track.modes)))
        tracks += [_Track([None] * number + [mode]) for mode in left]
    return tracks


def _matched(
    before: ModalModel, now: ModalModel, tracks: Sequence[_Track], left: Sequence[Mode]
) -> list[tuple[_Track, Mode]]:
    """Which modes of a result go on with which tracks."""
    if not tracks or not left:
        return []
    old = [track.seen[-1][1] for track in tracks]
    shapes, _ = common_shapes(replace(before, modes=tuple(old)), replace(now, modes=tuple(left)))
    return [(tracks[i], left[j]) for i, j in match_modes(old, left, shapes)]


def _point(result: Result, mode: Mode | None) -> dict[str, Any] | None:
    if mode is None:
        return None
    names = "frequency_hz", "frequency_std_hz", "damping_ratio", "damping_std"
    return {name: getattr(mode, name) for name in names} | {
        **{"purity": mode.order_purity, "mpc": mode.mpc, "status": mode.status},
        "is_mean": all(mode is not each for each in result.modal_model.modes),
    }


def _stated(result: Result, key: str) -> float | None:
    tyre = result.tyre
    if tyre is None:
        return None
    value = getattr(tyre, key, None)
    try:
        return float(tyre.details[key] if value is None else value)
    except (KeyError, ValueError):
        return None


def _axis(
    results: Sequence[Result], key: str, name: str, unit: str, factor: float
) -> dict[str, Any] | None:
    values = [_stated(result, key) for result in results]
    if any(value is None for value in values):
        return None
    return {
        "name": name,
        "unit": unit,
        "values": [factor * value for value in values if value is not None],
    }


def _time_axis(results: Sequence[Result]) -> dict[str, Any] | None:
    """Time after the earliest test, where all state ``date`` in [tyre], perhaps with ``time``."""
    times = [_tested(result) for result in results]
    known = [each.timestamp() for each in times if each is not None]
    if len(known) < len(results):
        return None
    long = max(known) - min(known) > _LONG_S
    unit, of_unit = ("d", _DAY_S) if long else ("h", _HOUR_S)
    return {"name": "time", "unit": unit, "values": [(at - min(known)) / of_unit for at in known]}


def _tested(result: Result) -> datetime | None:
    """When a tyre was tested, ISO 8601; UTC where no zone is stated."""
    details = {} if result.tyre is None else result.tyre.details
    text = " ".join(details[name] for name in ("date", "time") if details.get(name))
    try:
        at = datetime.fromisoformat(text)
    except ValueError:
        return None
    return at if at.tzinfo else at.replace(tzinfo=UTC)


def _condition(result: Result) -> str:
    parts = []
    for key, _, unit, factor in _AXES:
        value = _stated(result, key)
        if value is not None:
            parts.append(f"{factor * value:.4g} {unit}")
    if (at := _tested(result)) is not None:
        parts.append(f"{at:%Y-%m-%d %H:%M}".removesuffix(" 00:00"))
    return ", ".join(parts)


def require_few(names: Sequence[str]) -> None:
    """Refuse a comparison of one result, or of too many."""
    if not 2 <= len(set(names)) <= MOST_RESULTS:
        rule = f"2 to {MOST_RESULTS} different ones are compared"
        raise InputError("results", str(len(names)), rule, "Choose others")
