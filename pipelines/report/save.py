"""A result as a folder: tables, FRFs, parameters, provenance and report."""

from __future__ import annotations

from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path

from ema.core.errors import require_type
from ema.core.modes import ModalModel
from pipelines.export.workbook import write_workbook
from pipelines.process.run import process
from pipelines.process.validate import ring_orders
from pipelines.report.template import PLAIN, Template
from pipelines.report.write import write_pdf, write_report
from pipelines.results import tables
from pipelines.results.edits_file import EDITS_NAME, record_of, write_edits
from pipelines.results.parameter_set import ParameterSet, from_tuning, write_parameter_set
from pipelines.results.provenance import OPTIONAL_READ_BACK, READ_BACK, relative_to, with_inputs_at
from pipelines.results.result import Result
from pipelines.results.set_basis import MeasuredOrder
from pipelines.results.store import write_identification, write_measured
from pipelines.simulate.campaign import sample_campaign
from pipelines.storage.checksums import ACCEPTED, write_marker
from pipelines.storage.result_folder import MARKER, written_whole
from pipelines.storage.tables import write_csv, write_parquet

PDF, WORKBOOK = "report.pdf", "result.xlsx"


def save(
    result: Result,
    folder: Path | str,
    *,
    report: bool = True,
    pdf: bool = False,
    xlsx: bool = False,
    force: bool = False,
    template: Template = PLAIN,
) -> None:
    """Write a result folder as the contract describes it.

    Parameters
    ----------
    result : Result
    folder : path
        Written atomically.
    report : bool
        Whether to write ``report.html``.
    pdf : bool
        Whether to write ``report.pdf`` too.
    xlsx : bool
        Whether to write ``result.xlsx`` too, the tables for Excel; needs openpyxl.
    force : bool
        Replace an existing result.
    template : Template
        Texts, logo and units of the report.

    Raises
    ------
    InputError
        If the folder exists and may not be replaced, or cannot be written.

    Examples
    --------
    >>> import ringmodal as rm
    >>> rm.save(rm.load("result"), "copy", report=False)
    >>> rm.load("copy")
    <Result tyre_225_55R17: 9 modes, no ring, 0 warnings>
    """
    require_type("result", result, Result, "Use process, load or retune")
    folder = Path(require_type("folder", folder, (str, Path), "Name a folder"))
    with written_whole(folder, force=force, accepted=_replaceable(result)) as partial:
        for name, table in tables.csv_tables(result).items():
            write_csv(partial / name, table)
        write_parquet(partial / "poles.parquet", tables.poles(result.diagram))
        write_measured(result, partial)
        write_identification(result, partial)
        ring = _parameter_set(result)
        if ring is not None:
            write_parameter_set(partial / "tyre.toml", ring)
        if xlsx:
            write_workbook(partial / WORKBOOK, result, ring)
        if report:
            write_report(result, partial / "report.html", template)
        if pdf:
            write_pdf(result, partial / PDF, template)
        record = with_inputs_at(result.provenance, relative_to(folder))
        if result.edits:
            write_edits(partial / EDITS_NAME, record_of(replace(result, provenance=record)))
        warnings = [asdict(finding) for finding in result.findings if not finding.is_ok]
        write_marker(partial / MARKER, {**record, "warnings": warnings})


def has(folder: Path | str, name: str) -> bool:
    """Whether a result has a `PDF` or a `WORKBOOK`: then it is written again with the others."""
    return (Path(folder) / name).is_file()


def _parameter_set(result: Result) -> ParameterSet | None:
    if result.tuning is None or result.tyre is None:
        return None
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
    parameters = from_tuning(
        tyre.designation,
        result.tuning,
        result.damping,
        origin,
        tyre.details,
        tuple(f"{each.check}: {each.detail}" for each in result.findings if not each.is_ok),
    )
    measured = replace(parameters.basis, measured=_measured_orders(result.modal_model))
    return replace(parameters, basis=measured)


def _measured_orders(model: ModalModel) -> tuple[MeasuredOrder, ...]:
    def known(std: float) -> float | None:
        return std if isfinite(std) and std > 0 else None

    return tuple(
        MeasuredOrder(
            order=each.order,
            frequency_hz=each.frequency_hz,
            damping_ratio=each.damping_ratio,
            frequency_std_hz=known(each.frequency_std_hz),
            damping_ratio_std=known(each.damping_std),
        )
        for each in ring_orders(model)
        if each.damping_ratio > 0
    )


def _replaceable(result: Result) -> dict[str, str]:
    """Checksums of changed parts that the result contains: it may replace them."""
    accepted = result.provenance.get(ACCEPTED, {})
    kept = (MARKER, *READ_BACK, *OPTIONAL_READ_BACK)
    return {name: sha for name, sha in accepted.items() if name in kept and sha}


def run_demo(out: Path, template: Template = PLAIN) -> tuple[Result, Path]:
    """Process the sample campaign into ``out/result``, where it replaces an earlier demonstration.

    The campaign comes from the project's folder; where that is missing it is written to
    ``out/campaign`` first.
    """
    result = process(sample_campaign(out / "campaign"))
    folder = out / "result"
    save(result, folder, force=True, template=template)
    return result, folder
