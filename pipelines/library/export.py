"""Parameter sets as files for other programs, and tables of all versions."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ema.core.display import jsonable
from ema.core.errors import escaped, unknown
from pipelines.export.belt import write_modal_targets
from pipelines.library.history import history_of
from pipelines.library.version import ApprovalState, LibraryTyre, Version, values_of
from pipelines.results.parameter_set import (
    CONDITION_NAMES,
    DAMPING_NAMES,
    RING_NAMES,
    WHEEL_NAMES,
    Parameter,
    ParameterSet,
    parameter_document,
    write_parameter_set,
)
from pipelines.storage import tables
from pipelines.storage.atomic import file_written_whole, require_free_file
from pipelines.storage.checksums import DamagedFile

COLUMNS = ["section", "name", "value", "std", "how"]
_TEXTS = ("tyre", "designation", "tyre_id", "created", "author", "note", "campaign", "software")
CONDITIONS = ("inflation_pressure_pa", *CONDITION_NAMES)
OF_VERSION = (
    *("tyre", "designation", "tyre_id", "version", "approved", "created", "author", "note"),
    *("campaign", "software", *CONDITIONS),
)
LONG = (*OF_VERSION, "parameter", "value", "std", "how", "verdict")
_PARAMETERS = (*RING_NAMES, *DAMPING_NAMES, *(f"wheel_{name}" for name in WHEEL_NAMES))
WIDE = (
    *OF_VERSION,
    *(name + end for name in _PARAMETERS for end in ("", "_std", "_how")),
    "verdict",
)


def write_json(parameters: ParameterSet, path: Path) -> None:
    """Write a parameter set as JSON, sections and names as in TOML."""
    content = jsonable(parameter_document(parameters).unwrap())
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
    path.write_text(escaped(text) + "\n", encoding="utf-8", newline="\n")


def write_csv(parameters: ParameterSet, path: Path) -> None:
    """Write a parameter set as a table of section, name, value, standard deviation and origin."""
    sections = {
        "conditions": {name: Parameter(value) for name, value in parameters.conditions.items()},
        "ring": parameters.ring,
        "damping": parameters.damping,
        "wheel": {name: Parameter(value) for name, value in parameters.wheel.items()},
    }
    rows: list[tuple[Any, ...]] = [("", "designation", parameters.designation, None, "")]
    for section, entries in sections.items():
        rows += [(section, name, each.value, each.std, each.how) for name, each in entries.items()]
    tables.write_csv(path, dict(zip(COLUMNS, zip(*rows, strict=True), strict=True)))


#: Writers by the name of their format: each takes a parameter set and the file to write.
FORMATS: dict[str, Callable[[ParameterSet, Path], Any]] = {
    "toml": lambda parameters, path: write_parameter_set(path, parameters),
    "json": write_json,
    "csv": write_csv,
    "modal-targets": write_modal_targets,
}


def export(parameters: ParameterSet, path: Path, file_format: str = "") -> str:
    """Write a parameter set atomically in a format of `FORMATS`, by default that of the ending.

    Returns the format; `InputError` if it is unknown, or the file cannot be written.
    """
    wanted = file_format.casefold() or path.suffix.lower().lstrip(".")
    if wanted not in FORMATS:
        where = "--format" if file_format else str(path)
        raise unknown(where, file_format or wanted, "unknown format", FORMATS)
    require_free_file(path, force=True)
    with file_written_whole(path) as partial:
        FORMATS[wanted](parameters, partial)
    return wanted


Row = dict[str, Any]


def version_rows(
    tyres: Iterable[LibraryTyre], *, wide: bool = False
) -> tuple[list[Row], list[DamagedFile]]:
    """Rows of all versions of some tyres, and the damage found.

    Wide: one row per version with the columns `WIDE`, else one per version and parameter, `LONG`.
    """
    rows: list[Row] = []
    damage: list[DamagedFile] = []
    for history in map(history_of, tyres):
        damage += history.damage
        for line in history.lines:
            approved = line.approval is ApprovalState.APPROVED
            common = _of_version(line.version, approved=approved)
            values = values_of(line.version.parameters).items()
            if wide:
                parts = [
                    {name: each.value, f"{name}_std": each.std, f"{name}_how": each.how}
                    for name, each in values
                ]
                rows.append({key: cell for part in (common, *parts) for key, cell in part.items()})
            else:
                rows += [common | {"parameter": name, **asdict(each)} for name, each in values]
    return rows, damage


def write_table(path: Path, rows: Sequence[Row], *, wide: bool = False) -> None:
    """Write rows as CSV or Parquet, by the ending of `path`; written atomically."""
    columns = WIDE if wide else LONG
    tables.write_table(path, tables.typed(rows, {name: _type_of(name) for name in columns}))


def _of_version(version: Version, *, approved: bool) -> Row:
    own, entry = version.parameters, version.entry
    stated = {name: own.conditions.get(name) for name in CONDITIONS}
    return {
        "tyre": version.tyre,
        "designation": own.designation,
        "tyre_id": entry.tyre_id,
        **{"version": version.number, "approved": approved},
        **{"created": entry.created, "author": entry.author, "note": entry.note},
        "campaign": str(own.provenance.get("campaign", "")),
        "software": str(own.provenance.get("software", entry.software)),
        "verdict": str(own.basis.state or ""),
        # A set written by hand may have words.
        **{name: float(v) if isinstance(v, int | float) else None for name, v in stated.items()},
    }


def _type_of(name: str) -> str:
    if name in (*_TEXTS, "parameter", "how", "verdict") or name.endswith("_how"):
        return "string"
    return {"version": "int32", "approved": "bool"}.get(name, "float64")
