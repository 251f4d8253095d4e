"""A parameter set as a file for other programs; formats are functions in one table."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ema.core.errors import InputError, escaped, unknown
from pipelines.export.modal_targets import write_modal_targets
from pipelines.results.parameter_set import SCHEMA, Parameter, ParameterSet, write_parameter_set
from pipelines.storage.atomic import file_written_whole
from pipelines.storage.plain_values import plain
from pipelines.storage.tables import table_of
from pipelines.storage.tables import write_csv as write

COLUMNS = ("section", "name", "value", "std", "how")


def write_json(parameters: ParameterSet, path: Path) -> None:
    """Write a parameter set as JSON, sections and names as in TOML."""
    sections = {key: part for key, part in asdict(parameters).items() if part}
    for name in ("ring", "damping"):
        if name in sections:
            sections[name] = {key: _told(entry) for key, entry in sections[name].items()}
    whole = plain({"schema": SCHEMA, **sections})
    text = json.dumps(whole, indent=2, ensure_ascii=False, allow_nan=False)
    path.write_text(escaped(text) + "\n", encoding="utf-8", newline="\n")


def write_csv(parameters: ParameterSet, path: Path) -> None:
    """Write a parameter set as a table of section, name, value, standard deviation and origin."""
    write(path, table_of(COLUMNS, _rows(parameters)))


def _toml(parameters: ParameterSet, path: Path) -> None:
    write_parameter_set(path, parameters)


def _modal_targets(parameters: ParameterSet, path: Path) -> None:

    write_modal_targets(parameters, path)


#: Writers by the name of their format: each takes a parameter set and the file to write.
FORMATS: dict[str, Callable[[ParameterSet, Path], None]] = {
    "toml": _toml,
    "json": write_json,
    "csv": write_csv,
    "modal-targets": _modal_targets,
}


def export(parameters: ParameterSet, path: Path, file_format: str = "") -> str:
    """Write a parameter set in a format, whole or not at all.

    Parameters
    ----------
    parameters : ParameterSet
    path : Path
    file_format : str
        A key of `FORMATS`; default: the ending of `path`.

    Returns
    -------
    str
        The format.

    Raises
    ------
    InputError
        If there is no such format, or the file cannot be written.
    """
    wanted = file_format.casefold() or path.suffix.lower().lstrip(".")
    if wanted not in FORMATS:
        where = "--format" if file_format else str(path)
        raise unknown(where, file_format or wanted, "there is no such format", FORMATS)
    if path.is_dir() or not path.absolute().parent.is_dir():
        found = "a folder" if path.is_dir() else "a place in a folder that does not exist"
        raise InputError(str(path), found, "it must be a new or old file", "Choose another place")
    with file_written_whole(path) as partial:
        FORMATS[wanted](parameters, partial)
    return wanted


def _told(entry: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in entry.items() if value is not None}


def _rows(parameters: ParameterSet) -> Iterator[tuple[Any, ...]]:
    yield "", "designation", parameters.designation, None, ""
    for name, value in parameters.conditions.items():
        yield "conditions", name, value, None, "given"
    wheel = {name: Parameter(value) for name, value in parameters.wheel.items()}
    sections = {"ring": parameters.ring, "damping": parameters.damping, "wheel": wheel}
    for section, entries in sections.items():
        for name, entry in entries.items():
            yield section, name, entry.value, entry.std, entry.how
