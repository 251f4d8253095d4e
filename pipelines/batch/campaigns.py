"""Campaigns of a batch: found under a folder, each processed into a result and a record."""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

from ema.core.errors import FitError, InputError, file_trouble, out_of_memory
from ema.io.campaign.manifest import MANIFEST_NAME
from ema.io.formats import is_recording
from model.errors import ParameterError
from pipelines.batch.state import (
    CAMPAIGNS,
    DONE,
    FAILED,
    BatchFolder,
    Record,
    choices,
    fingerprint_of,
    glance,
    take_fingerprint,
    write_record,
)
from pipelines.process.run import process
from pipelines.report.page import PLAIN, Template
from pipelines.report.write import save
from pipelines.results.options import Options
from pipelines.results.parameter_set import tuned_parameters
from pipelines.storage.atomic import MARKER, remove_abandoned, require_free
from pipelines.storage.tables import plain_rows

LIVES = 3  # worker processes that a task may end before it is given up
_OF_RESULTS = {MARKER, CAMPAIGNS}  # folders with these contain results, not recordings
_JOINT = "+"


@dataclass(frozen=True)
class CampaignFolder:
    """A folder to process."""

    name: str  # its path under the root, with slashes
    place: str  # path of its result under the results; no campaign's is inside another's
    path: Path  # absolute


@dataclass(frozen=True)
class Task:
    """A campaign to process, where its result goes, and how."""

    campaign: CampaignFolder
    folder: BatchFolder
    options: Options
    report: bool = False
    template: Template = PLAIN

    @property
    def result(self) -> Path:
        """The result folder."""
        return self.folder.result(self.campaign.place)

    @property
    def record(self) -> Path:
        """The file of its record."""
        return self.folder.record(self.campaign.place)


Work = Callable[[Task], Record]


def find_campaigns(root: Path, out: Path) -> tuple[CampaignFolder, ...]:
    """Find every campaign under a folder, at any depth, in the order of their names.

    `root` may be a campaign itself; `out`, where the batch writes, is not searched. A folder with a
    manifest is a campaign. So is one with only recordings, unless it belongs to a campaign above it
    or contains one: a lost manifest is to be noticed. Links are followed, each folder once. Hidden
    folders and results are skipped.
    """
    if not root.is_dir():
        found = "a file" if root.exists() else "folder not found"
        rule = "a batch processes the campaigns of a folder"
        raise InputError(str(root), found, rule, "Check the path")
    top = Path(os.path.realpath(root))
    paths = list(_campaigns(top, {_identity(out)}, inside=False))
    if not paths:
        rule = f"a campaign is a folder with a {MANIFEST_NAME}"
        remedy = "Check the path, or write manifest templates with `ringmodal init FOLDER`"
        raise InputError(str(root), "no campaigns", rule, remedy)
    origin = top.parent if top in paths else top
    names = sorted(path.relative_to(origin).as_posix() for path in paths)
    return tuple(placed(names, origin))


def _campaigns(folder: Path, seen: set[tuple[int, int] | None], *, inside: bool) -> Iterator[Path]:
    """Campaigns in and under `folder`, unless it was `seen`, possibly by another link.

    Recordings `inside` a campaign belong to it.
    """
    identity = _identity(folder)
    if identity in seen:
        return
    seen.add(identity)
    try:
        entries = sorted(folder.iterdir(), key=lambda path: (path.is_symlink(), path.name))
    except OSError:
        yield folder  # processing it gives the error
        return
    names = {path.name for path in entries}
    is_campaign = MANIFEST_NAME in names
    if names & _OF_RESULTS and not is_campaign:
        return
    if is_campaign:
        yield folder
    below = False
    visible = [entry for entry in entries if not entry.name.startswith(".")]
    for entry in visible:
        if os.path.isdir(entry):  # noqa: PTH112 - never raises
            for path in _campaigns(entry, seen, inside=inside or is_campaign):
                below = True
                yield path
    if not (is_campaign or inside or below) and any(map(is_recording, visible)):
        yield folder


def placed(names: list[str], origin: Path) -> Iterator[CampaignFolder]:
    """Give each campaign a place; one inside another goes beside it, as a result is one folder."""
    places: dict[str, str] = {}
    for name in names:
        above = next((each for each in Path(name).parents if each.as_posix() in places), None)
        place = name
        if above is not None:
            within = Path(name).relative_to(above).parts
            place = _JOINT.join([places[above.as_posix()], *within])
        if place in places.values():
            rule = f"the result of another campaign also goes to {place}"
            raise InputError(str(origin / name), "an ambiguous name", rule, "Rename the folder")
        places[name] = place
        yield CampaignFolder(name, place, origin / name)


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


def carry_out(task: Task) -> Record:
    """Process a campaign, write its result and its record; a failure becomes the record."""
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
    """Write a record; if that fails, the record becomes the failure."""
    try:
        task.record.parent.mkdir(parents=True, exist_ok=True)
        write_record(record, task.record)
    except (InputError, OSError) as error:
        return Record(record.campaign, FAILED, record.fingerprint, message=_explained(error)[0])
    return record


def given_up(task: Task, found: str) -> Record:
    """Record of a campaign that ended every worker process."""
    rule = "every worker process that took this campaign died, most likely for lack of memory"
    remedy = "Leave more memory to each worker, e.g. by fewer --jobs, then use --retry-failed"
    return kept(task, failure(task, InputError(task.campaign.name, found, rule, remedy)))


def sweep(task: Task) -> None:
    """Remove what a killed worker left half-written."""
    for place in (task.result, task.record):
        with suppress(OSError):  # nothing was begun there
            remove_abandoned(place)


def _processed(task: Task) -> Record:
    campaign, name = task.campaign.path, task.campaign.name
    if not (campaign / MANIFEST_NAME).exists():
        rule = "a batch processes campaigns with a manifest"
        remedy = f"Write a template with `ringmodal init {campaign}`"
        raise InputError(name, f"no {MANIFEST_NAME}", rule, remedy)
    require_free(task.result, force=True)
    before = glance(campaign)
    result = process(campaign, task.options)
    if glance(campaign) != before:
        rule = "files changed while they were processed"
        remedy = "Run the batch again when the files no longer change"
        raise InputError(name, "two states of the files", rule, remedy)
    save(result, task.result, report=task.report, force=True, template=task.template)
    files = (
        replace(state, sha256=entry["sha256"])
        for state, entry in zip(before, result.provenance["inputs"], strict=True)
    )
    return Record(
        name,
        DONE,
        fingerprint_of(files, choices(task.options)),
        designation="" if result.tyre is None else result.tyre.designation,
        inflation_pressure_pa=None if result.tyre is None else result.tyre.inflation_pressure_pa,
        n_warnings=sum(not finding.is_ok for finding in result.findings),
        modes=tuple(plain_rows(result.modal_model.to_columns())),
        parameters=tuple(
            (name, each.value, each.std, each.how)
            for name, each in tuned_parameters(result.tuning, result.damping).items()
        ),
    )


def _explained(error: Exception) -> tuple[str, str]:
    """Message for the user, and for an internal error where it happened."""
    if isinstance(error, InputError | FitError | ParameterError):
        return str(error), ""
    if isinstance(error, OSError) and error.filename is not None:
        return file_trouble(error).removeprefix("Error: "), ""
    if isinstance(error, MemoryError):
        return out_of_memory(error).removeprefix("Error: "), ""
    fault = f"Internal error: {type(error).__name__}: {error}. Please report it."
    return fault, "".join(traceback.format_exception(error))
