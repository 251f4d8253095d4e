"""The result folder: written whole or not at all, and read back for later stages."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from ema.errors import InputError
from ema.quality import WARNING, Finding
from ema.regular_file import require_regular
from pipelines import tables
from pipelines.checksums import ACCEPTED, write_marker
from pipelines.frf_file import read_frf, write_frfs
from pipelines.identification_file import read_identification, write_identification
from pipelines.parameter_set import from_tuning, write_parameter_set
from pipelines.parquet import write_parquet
from pipelines.result import Result
from pipelines.result_check import (
    OPTIONAL_READ_BACK,
    READ_BACK,
    CheckedResult,
    checked_result,
)
from pipelines.result_folder import MARKER, recover, written_whole

PDF = "report.pdf"
_ATTEMPTS = 20  # another process may replace the result again and again


def save(
    result: Result,
    folder: Path | str,
    *,
    report: bool = True,
    pdf: bool = False,
    force: bool = False,
) -> None:
    """Write a result folder as the contract describes it.

    Parameters
    ----------
    result : Result
    folder : path
        Appears whole or not at all.
    report : bool
        Whether to write ``report.html``.
    pdf : bool
        Whether to write ``report.pdf`` too.
    force : bool
        Replace an existing result.

    Raises
    ------
    InputError
        If the folder exists and may not be replaced, or cannot be written.
    """
    folder = Path(folder)
    with written_whole(folder, force=force, accepted=_replaceable(result)) as partial:
        _write_tables(result, partial)
        write_frfs(result.frf, partial)
        write_identification(result, partial)
        _write_tyre(result, partial / "tyre.toml")
        if report:
            from pipelines.report import write_report

            write_report(result, partial / "report.html")
        if pdf:
            from pipelines.report.paper import write_pdf

            write_pdf(result, partial / PDF)
        write_marker(partial / MARKER, {**result.provenance, "warnings": _warnings(result)})


def has_pdf(folder: Path | str) -> bool:
    """Whether a result holds the report as PDF: then it is written again with the others."""
    return (Path(folder) / PDF).is_file()


def load(folder: Path | str, *, accept_changes: bool = False) -> Result:
    """Read a result folder back: everything but tuning, damping and validation.

    Those follow from the modes; `pipelines.process.tune` adds them again.

    Parameters
    ----------
    folder : path
    accept_changes : bool
        Whether to take parts that are not as they were written; each becomes a warning among the
        findings, and its checksum a part of the provenance.

    Raises
    ------
    InputError
        If the folder is no result, is damaged, or a part of it was changed, is missing or was
        added and is not accepted.
    """
    folder = Path(folder)
    for attempts_left in reversed(range(_ATTEMPTS)):
        recover(folder)
        before = _marker_bytes(folder)
        try:
            result = _loaded(folder, accept_changes=accept_changes)
        except InputError:
            if not attempts_left or _marker_bytes(folder) == before:
                raise
        else:
            if not attempts_left or _marker_bytes(folder) == before:
                return result
    raise AssertionError("the last attempt returns or raises")


def _loaded(folder: Path, *, accept_changes: bool) -> Result:
    checked = checked_result(folder, accept_changes=accept_changes)
    from pipelines.provenance_schema import require_provenance  # loads what checks types

    record = checked.marker.content
    require_provenance(folder / MARKER, record)  # a checksum that fits vouches for no types
    return with_accepted(read_identification(folder, record), checked)


def with_accepted(result: Result, checked: CheckedResult) -> Result:
    """A result that tells which of its parts were accepted although they had changed."""
    if not checked.accepted:
        return result
    findings = dict.fromkeys(
        [
            *result.findings,
            *(
                Finding("", name, None, "changed", WARNING, f"{change.value}; accepted as it is")
                for name, change in checked.accepted.items()
            ),
        ]
    )
    earlier = result.provenance.get(ACCEPTED, {})
    provenance = {**result.provenance, ACCEPTED: {**earlier, **checked.sha256}}
    return replace(result, findings=tuple(findings), provenance=provenance)


def _marker_bytes(folder: Path) -> bytes | None:
    """What tells one result from the next: another process may replace it meanwhile."""
    with suppress(OSError, InputError):
        return require_regular(folder / MARKER).read_bytes()
    return None


def _replaceable(result: Result) -> dict[str, str]:
    """Checksums of changed parts that live on in a result: they may be replaced by it."""
    accepted = result.provenance.get(ACCEPTED, {})
    lives_on = (MARKER, *READ_BACK, *OPTIONAL_READ_BACK)
    return {name: sha for name, sha in accepted.items() if name in lives_on and sha}


def _write_tables(result: Result, folder: Path) -> None:
    tables.write_csv(folder / "modes.csv", tables.MODES, tables.modes_rows(result))
    tables.write_csv(
        folder / "shapes.csv", tables.shapes_columns(result), tables.shapes_rows(result)
    )
    tables.write_csv(folder / "orders.csv", tables.ORDERS, tables.orders_rows(result))
    tables.write_csv(folder / "quality.csv", tables.QUALITY, tables.quality_rows(result))
    tables.write_csv(folder / "validation.csv", tables.VALIDATION, tables.validation_rows(result))
    write_parquet(folder / "poles.parquet", tables.poles_columns(result.diagram))


def _write_tyre(result: Result, path: Path) -> None:
    """Write ``tyre.toml`` where the ring was tuned."""
    if result.tuning is None or result.tyre is None:
        return
    record = result.provenance
    origin = {
        "software": f"ringmodal {record['software']['ringmodal']}",
        "created": record["created"],
        "campaign": result.name,
        "inputs": {entry["file"]: entry["sha256"] for entry in record["inputs"]},
    }
    if record.get(ACCEPTED):
        origin[ACCEPTED] = sorted(record[ACCEPTED])
    tyre = result.tyre
    parameters = from_tuning(tyre.designation, result.tuning, result.damping, origin, tyre.details)
    write_parameter_set(path, parameters)


def _warnings(result: Result) -> list[dict[str, Any]]:
    return [asdict(finding) for finding in result.findings if finding.verdict != "ok"]


__all__ = ["PDF", "has_pdf", "load", "read_frf", "save", "with_accepted"]
