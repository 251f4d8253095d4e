"""One campaign of a batch, from recordings to a result folder and a record, come what may."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from time import perf_counter

from ema.core.errors import FitError, InputError, file_trouble, out_of_memory
from ema.core.finding import OK
from ema.io.campaign.manifest import MANIFEST_NAME
from model.errors import ParameterError
from pipelines.batch.campaigns import CampaignFolder
from pipelines.batch.state import (
    DONE,
    FAILED,
    BatchFolder,
    Record,
    Row,
    choices,
    fingerprint_of,
    glance,
    take_fingerprint,
    write_record,
)
from pipelines.process.run import process
from pipelines.report.save import save
from pipelines.results.options import Options
from pipelines.results.parameter_set import from_tuning
from pipelines.results.result import Result
from pipelines.storage.atomic import remove_abandoned
from pipelines.storage.result_folder import require_free
from pipelines.storage.tables import plain_rows

LIVES = 3  # a task that has ended this many workers is given up


@dataclass(frozen=True)
class Task:
    """A campaign to process.

    Parameters
    ----------
    campaign : CampaignFolder
    folder : BatchFolder
        Where its result and its record go.
    options : Options
    report : bool
        Whether to write ``report.html``.
    """

    campaign: CampaignFolder
    folder: BatchFolder
    options: Options
    report: bool = False


Work = Callable[[Task], Record]


def carry_out(task: Task) -> Record:
    """Process a campaign, write its result and its record; whatever fails becomes the record."""
    start = perf_counter()
    try:
        record = _processed(task)
    except Exception as error:  # noqa: BLE001 - one campaign must not end the others
        record = failure(task, error)
    return kept(task, replace(record, seconds=round(perf_counter() - start, 3)))


def failure(task: Task, error: Exception) -> Record:
    """Record of a campaign that ended with an error."""
    message, place = _explained(error)
    fingerprint = take_fingerprint(task.campaign.path, choices(task.options))
    return Record(task.campaign.name, FAILED, fingerprint, message=message, traceback=place)


def kept(task: Task, record: Record) -> Record:
    """Write a record; where that fails, the record says so."""
    path = task.folder.record(task.campaign.place)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_record(record, path)
    except (InputError, OSError) as error:
        return Record(record.campaign, FAILED, record.fingerprint, message=_explained(error)[0])
    return record


def given_up(task: Task, found: str) -> Record:
    """Record of a campaign that every worker died of."""
    rule = "every worker process that took this campaign died, most likely for lack of memory"
    remedy = "Leave more memory to each worker, e.g. by fewer --jobs, then use --retry-failed"
    return kept(task, failure(task, InputError(task.campaign.name, found, rule, remedy)))


def sweep(task: Task) -> None:
    """Remove what a killed worker left half-written."""
    for place in (
        task.folder.result(task.campaign.place),
        task.folder.record(task.campaign.place),
    ):
        with suppress(OSError):  # nothing was begun there
            remove_abandoned(place)


def _processed(task: Task) -> Record:
    campaign = task.campaign.path
    _require_manifest(task.campaign)
    require_free(task.folder.result(task.campaign.place), force=True)
    before = glance(campaign)
    result = process(campaign, task.options)
    if glance(campaign) != before:
        rule = "files changed while they were processed"
        remedy = "Run the batch again when nothing writes there any more"
        raise InputError(task.campaign.name, "results of two states of the files", rule, remedy)
    save(result, task.folder.result(task.campaign.place), report=task.report, force=True)
    files = (
        replace(state, sha256=entry["sha256"])
        for state, entry in zip(before, result.provenance["inputs"], strict=True)
    )
    return Record(
        task.campaign.name,
        DONE,
        fingerprint_of(files, choices(task.options)),
        designation="" if result.tyre is None else result.tyre.designation,
        inflation_pressure_pa=None if result.tyre is None else result.tyre.inflation_pressure_pa,
        n_warnings=sum(finding.verdict != OK for finding in result.findings),
        modes=tuple(plain_rows(result.modal_model.to_frame())),
        parameters=_parameters(result),
    )


def _require_manifest(campaign: CampaignFolder) -> None:
    if not (campaign.path / MANIFEST_NAME).exists():
        raise InputError(
            campaign.name,
            f"no {MANIFEST_NAME}",
            "a batch takes campaigns with a manifest",
            f"Draft one with `ringmodal init {campaign.path}`",
        )


def _parameters(result: Result) -> tuple[Row, ...]:
    if result.tuning is None:
        return ()
    parameters = from_tuning("", result.tuning, result.damping, {})
    return tuple(
        (name, parameter.value, parameter.std, parameter.how)
        for name, parameter in {**parameters.ring, **parameters.damping}.items()
    )


def _explained(error: Exception) -> tuple[str, str]:
    """Message for the user, and the place in the program where it is at fault."""
    if isinstance(error, InputError | FitError | ParameterError):
        return str(error), ""
    if isinstance(error, OSError) and error.filename is not None:
        return file_trouble(error).removeprefix("Error: "), ""
    if isinstance(error, MemoryError):
        return out_of_memory(error).removeprefix("Error: "), ""
    fault = f"Internal error: {type(error).__name__}: {error}. Please report it."
    return fault, "".join(traceback.format_exception(error))
