"""The result folder: written whole or not at all, and read back for later stages."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.errors import InputError
from ema.frf import FRF
from pipelines import tables
from pipelines.identification_file import read_identification, write_identification
from pipelines.parameter_set import from_tuning, write_parameter_set
from pipelines.parquet import read_parquet, write_parquet
from pipelines.result import Result
from pipelines.result_folder import FILES, MARKER, recover, written_whole

PDF = "report.pdf"
_OF_DAMAGED_FILES = (OSError, LookupError, ValueError, TypeError, AttributeError, RuntimeError)


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
    with written_whole(folder, force=force) as partial:
        _write_tables(result, partial)
        _write_frfs(result.frf, partial)
        write_identification(result, partial)
        if result.tuning is not None and result.tyre is not None:
            origin = {
                "software": f"ringmodal {result.provenance['software']['ringmodal']}",
                "created": result.provenance["created"],
                "campaign": result.name,
                "inputs": {entry["file"]: entry["sha256"] for entry in result.provenance["inputs"]},
            }
            tyre = result.tyre
            parameters = from_tuning(
                tyre.designation, result.tuning, result.damping, origin, tyre.details
            )
            write_parameter_set(partial / "tyre.toml", parameters)
        if report:
            from pipelines.report import write_report

            write_report(result, partial / "report.html")
        if pdf:
            from pipelines.report.paper import write_pdf

            write_pdf(result, partial / PDF)
        _write_provenance(result, partial)


def has_pdf(folder: Path | str) -> bool:
    """Whether a result holds the report as PDF: then it is written again with the others."""
    return (Path(folder) / PDF).is_file()


def load(folder: Path | str) -> Result:
    """Read a result folder back: everything but tuning, damping and validation.

    Those follow from the modes; `pipelines.process.tune` adds them again.

    Raises
    ------
    InputError
        If the folder is no result or is damaged.
    """
    folder = Path(folder)
    recover(folder)
    if not (folder / MARKER).is_file():
        raise InputError(
            str(folder),
            f"no {MARKER}",
            "it must be a result folder",
            "Run `ringmodal process` first",
        )
    try:
        record = dict(json.loads((folder / MARKER).read_text(encoding="utf-8")))
        record.pop(FILES, None)
        return read_identification(folder, record, read_frf(folder / "frf.parquet"))
    except _OF_DAMAGED_FILES as error:
        raise InputError(
            str(folder), f"unreadable ({error})", "the result is incomplete", "Process it again"
        ) from error


def read_frf(path: Path) -> FRF:
    """Read the FRFs of ``frf.parquet`` (or ``reference.parquet``)."""
    table = read_parquet(path)
    n_positions = int(table.schema.metadata[b"n_positions"])

    def grid(name: str) -> NDArray[Any]:
        return np.asarray(table[name].to_numpy()).reshape(n_positions, -1)

    return FRF(
        frequency_hz=grid("frequency_hz")[0],
        values=grid("real") + 1j * grid("imag"),
        coherence=grid("coherence"),
        std=grid("std"),
        node=grid("node")[:, 0],
        position_deg=grid("position_deg")[:, 0],
        run=tuple(str(name) for name in grid("run")[:, 0]),
        channel=tuple(str(name) for name in grid("channel")[:, 0]),
    )


def _write_tables(result: Result, folder: Path) -> None:
    tables.write_csv(folder / "modes.csv", tables.MODES, tables.modes_rows(result))
    tables.write_csv(
        folder / "shapes.csv", tables.shapes_columns(result), tables.shapes_rows(result)
    )
    tables.write_csv(folder / "orders.csv", tables.ORDERS, tables.orders_rows(result))
    tables.write_csv(folder / "quality.csv", tables.QUALITY, tables.quality_rows(result))
    tables.write_csv(folder / "validation.csv", tables.VALIDATION, tables.validation_rows(result))
    write_parquet(folder / "poles.parquet", tables.poles_columns(result.diagram))


def _write_frfs(frf: FRF, folder: Path) -> None:
    from ema.io.uff_write import write_frfs

    write_frfs(folder / "frf.uff", frf)
    for name, rows in (("frf", frf), ("reference", frf.reference)):
        if rows is None:
            continue
        words = {"run": rows.run, "channel": rows.channel}
        metadata = {"n_positions": str(rows.n_positions)}
        write_parquet(folder / f"{name}.parquet", tables.frf_columns(rows), words, metadata)


def _write_provenance(result: Result, folder: Path) -> None:
    """Written last: it lists all files of the result."""
    files = sorted([MARKER, *(path.name for path in folder.iterdir())])
    content = {**result.provenance, "warnings": _warnings(result), FILES: files}
    text = json.dumps(content, indent=2, ensure_ascii=False, default=str)
    (folder / MARKER).write_text(text + "\n", encoding="utf-8", newline="\n")


def _warnings(result: Result) -> list[dict[str, Any]]:
    return [asdict(finding) for finding in result.findings if finding.verdict != "ok"]
