"""The recordings of a result: whether they are still there, and reading them in other blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ema.core.edits import Edit, EditKind, of_kind
from ema.core.errors import InputError
from pipelines.process.refit import of_blocks
from pipelines.process.ring import options_of
from pipelines.process.run import process
from pipelines.results.edits_file import Record
from pipelines.results.result import Result


def recordings_of(result: Result) -> list[Path]:
    """The manifest, or else all recordings; nothing where one is missing."""
    paths = [Path(each.get("path", "")) for each in result.provenance.get("inputs", ())]
    if not paths or not all(path.is_file() for path in paths):
        return []
    manifests = [path for path in paths if path.suffix == ".toml"]
    return manifests or paths


def reread(result: Result, edits: Sequence[Edit]) -> Result:
    """The result without edits but those of settings, from its recordings in other blocks."""
    settings = tuple(
        replace(edit, settings=of_blocks([edit]))
        for edit in of_kind(edits, EditKind.SETTINGS)
        if of_blocks([edit])
    )
    options = replace(options_of(result), tune=False)
    return process(_required(result), options, edits=record(result, settings))


def replayed(result: Result, edits: Sequence[Edit]) -> Result:
    """The result with edits, from its recordings."""
    return process(_required(result), options_of(result), edits=record(result, edits))


def record(result: Result, edits: Sequence[Edit]) -> Record:
    """Edits with what else was chosen on the way to a result."""
    return Record(tuple(edits), processing=result.provenance.get("given_processing", {}))


def _required(result: Result) -> list[Path]:
    paths = recordings_of(result)
    if not paths:
        rule, remedy = "other blocks and windows need them", "Put them back where they were"
        raise InputError(result.name, "its recordings are gone", rule, remedy)
    return paths
