"""The modes of a result again with decisions, from its FRFs: no recording is read."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import ema
from ema.checks.positions import axes_finding
from ema.checks.quality import (
    averages_finding,
    check_reference,
    coherence_findings,
    drift_findings,
    gain_findings,
    period_finding,
    reference_finding,
)
from ema.checks.ring_shapes import drive_point_finding
from ema.checks.sensor_mass import SensorMass
from ema.checks.steady_runs import steadiness_findings, without_changes_within_runs
from ema.core.edits import Edit, EditKind, of_kind
from ema.core.errors import FitError, InputError
from ema.core.finding import Check, Finding
from ema.core.frf import FRF
from ema.core.numerics import one_blas_thread
from ema.core.references import References, mapped
from ema.core.settings import CheckSettings, IdentificationSettings
from ema.identify import Identification
from ema.refit import EditCost, edit_cost, refit_modes
from ema.signals.frf_of_spectra import restated
from pipelines.process.ring import options_of, tune
from pipelines.results.edits_file import Record, read_edits
from pipelines.results.provenance import Stopwatch, made_now
from pipelines.results.result import Further, Result, automatic_modes, driven_modes, edit_records
from pipelines.results.store import load

# Settings that need no recordings; all others cut them into other blocks.
_OF_STORED = ("band_hz", "max_order", "method", "estimator")
_BEFORE = "options_before_edits"  # of the provenance: what edits of settings changed


@dataclass(frozen=True)
class Asked:
    """How modes are identified."""

    band_hz: tuple[float, float]
    max_order: int
    method: str
    estimator: str
    identification: IdentificationSettings
    checks: CheckSettings

    def identify(
        self, frf: FRF | References, sensor_mass: SensorMass | None, edits: Sequence[Edit] = ()
    ) -> Identification:
        """Modes of FRFs as measured, of one force or several."""
        return ema.identify_modes(
            frf,
            self.band_hz,
            edits=edits,
            sensor_mass=sensor_mass,
            max_order=self.max_order,
            method=self.method,
            settings=self.identification,
            checks=self.checks,
        )

    def changed(self, settings: Mapping[str, Any]) -> Asked:
        """The same with other settings."""
        chosen = {name: settings[name] for name in _OF_STORED if name in settings}
        if "band_hz" in chosen:
            chosen["band_hz"] = tuple(map(float, chosen["band_hz"]))
        return replace(self, **chosen)


def asked_of(result: Result) -> Asked:
    """How the modes of a stored result were identified, before decisions on settings."""
    record = result.provenance
    options = {**record["options"], **record["options"]["processing"], **record.get(_BEFORE, {})}
    return Asked(
        band_hz=tuple(options["band_hz"]),
        identification=IdentificationSettings(**record["settings"]["identification"]),
        checks=CheckSettings(**record["settings"]["checks"]),
        **{name: options[name] for name in _OF_STORED if name != "band_hz"},
    )


def with_modes(result: Result, found: Identification, checks: CheckSettings) -> Result:
    """The result with other modes, and with all findings; the ring steps are left out."""
    setup, measured, fitted, model = result.setup, found.measured, found.frf, found.model
    assert setup is not None
    fixed, band_hz = fitted.reference, model.band_hz
    reference = None if fixed is None else check_reference(fixed, band_hz, checks)
    compared = []
    if reference is not None:
        compared = [reference_finding(reference, checks), *gain_findings(reference)]
    every = [each.measured for each in found.references] or [measured]
    models = [each.model for each in found.references] or [model]
    places = [result.excitation_deg, *(frf.excitation_deg for frf in every[1:])]
    notes = (*model.notes, *setup.notes)
    steady = without_changes_within_runs(model, setup.steadiness, checks)
    return replace(
        result,
        frf=fitted,
        measured=measured,
        diagram=found.diagram,
        modal_model=replace(steady, notes=notes),
        reference=reference,
        tuning=None,
        damping=None,
        validation=None,
        opinions=found.opinions,
        findings=(
            *setup.findings,
            *(each for frf in every for each in _of_channels(frf, band_hz, checks)),
            *found.findings,
            *compared,
            *(f for m in models for f in drift_findings(m.drift, m.frequencies_hz)),
            *steadiness_findings(setup.steadiness, model, checks),
            *(
                f
                for m, at_deg in zip(models, places, strict=True)
                for f in drive_point_finding(m, at_deg, checks)
            ),
            *setup.later,
        ),
        notes=notes,
        corrections=found.corrections,
        sensor_mass=found.sensor_mass,
        edits=found.edits,
        references=driven_modes(found),
        further=tuple(
            Further(each.measured, each.corrections, each.sensor_mass)
            for each in found.references[1:]
        ),
    )


def _of_channels(
    measured: FRF, band_hz: tuple[float, float], checks: CheckSettings
) -> Iterator[Finding]:
    """Findings about the FRFs of one force as measured."""
    yield from averages_finding(measured)
    yield from period_finding(measured)
    yield from coherence_findings(measured, band_hz, checks)
    yield from axes_finding(measured, band_hz)


def decided_on(
    result: Result, asked: Asked, edits: Sequence[Edit], found: Identification | None = None
) -> Result:
    """The result with decisions instead of those it has.

    Parameters
    ----------
    result : Result
    asked : Asked
        How its modes were identified before decisions on settings.
    edits : sequence of Edit
        All that are in force.
    found : Identification, optional
        The automatic identification, where it is at hand.
    """
    assert result.setup is not None
    mass, frfs = result.setup.sensor_mass, result.frfs
    before, now = (asked.changed(settings_of(each)) for each in (result.edits, edits))
    automatic = result.automatic or automatic_modes(result.modal_model)
    misfit = result.automatic_misfit if result.automatic else result.modal_model.misfit
    if now != before:
        if now.estimator != before.estimator and result.measured.blocks is None:
            rule, remedy = "FRFs from a file are as they are", "Leave the estimator out"
            raise InputError("estimator", repr(now.estimator), rule, remedy)
        frfs = mapped(frfs, lambda frf: restated(frf, now.estimator))
        found = now.identify(frfs, mass)
        plain = with_modes(result, found, now.checks).modal_model
        automatic, misfit = automatic_modes(plain), plain.misfit
    if found is None:
        found = now.identify(frfs, mass, edits)
    elif edits:
        found = refit_modes(found, edits)
    again = with_modes(result, found, now.checks)
    if "band_hz" in settings_of(edits):
        stated = tuple(each for each in again.findings if each.check is not Check.BAND)
        again = replace(again, findings=stated)
    if not edits:
        return replace(again, edits=(), automatic=(), automatic_misfit=float("nan"))
    return replace(again, edits=tuple(edits), automatic=automatic, automatic_misfit=misfit)


def settings_of(edits: Sequence[Edit]) -> dict[str, Any]:
    """What edits of settings say, the last one first heard."""
    found: dict[str, Any] = {}
    for edit in of_kind(edits, EditKind.SETTINGS):
        found |= edit.settings
    return found


def of_blocks(edits: Sequence[Edit]) -> dict[str, Any]:
    """Settings of edits that need the recordings."""
    return {name: each for name, each in settings_of(edits).items() if name not in _OF_STORED}


@one_blas_thread
def refit(
    source: Result | Path | str,
    edits: Sequence[Edit] | Record | Path | str,
    *,
    accept_changes: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Result:
    """Identify the modes of a result again with decisions, and tune the ring; nothing is written.

    The recordings are not needed. With the same FRFs and version the result is, to the last digit,
    that of `process` with these decisions.

    Parameters
    ----------
    source : Result or path
        A result or its folder.
    edits : sequence of Edit, Record or path
        All decisions that are to be in force, or ``edits.toml``; those that the result has are
        replaced (``[*result.edits, further]`` keeps them).
    accept_changes : bool
        Whether to accept a folder in which files were changed.
    progress : callable, optional
        Called with the name of each stage as it starts.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        If the result was written by an earlier version, if an edit names a channel or run that it
        does not have, or needs the recordings.
    FitError
        If an edit names no mode, or several.

    Examples
    --------
    >>> import ringmodal as rm
    >>> from ema.core.edits import Edit, EditKind, PoleName
    >>> without = Edit(EditKind.SET_ASIDE, PoleName(121.4), reason="not seen at 2.0 bar")
    >>> rm.refit("result", [without])
    <Result tyre_225_55R17: 8 modes, ring tuned, 0 warnings>
    """
    watch = Stopwatch(progress or (lambda name: None))
    with watch.stage("read", "Reading"):
        result = refittable(source, accept_changes=accept_changes)
        record = read_edits(edits) if isinstance(edits, Path | str) else as_record(edits)
    asked = asked_of(result)
    decided = _with_processing(result, asked, record)
    with watch.stage("modes", "Identifying modes"), naming(record):
        again = decided_on(result, asked, decided)
    with watch.stage("ring", "Tuning the ring"):
        again = tune(again, options_of(result))
    about = {**result.provenance, **made_now(), "stage_seconds": watch.seconds}
    return with_record(replace(again, provenance=about), asked, record)


def cost(
    source: Result | Path | str, edits: Sequence[Edit], *, accept_changes: bool = False
) -> EditCost:
    """What decisions would cost against those that a result has; nothing is written.

    Arguments as for `refit`.
    """
    result = refittable(source, accept_changes=accept_changes)
    assert result.setup is not None
    asked = asked_of(result)
    force = asked.changed(settings_of(result.edits))
    if asked.changed(settings_of(edits)) != force or of_blocks(edits) != of_blocks(result.edits):
        rule = "costs compare fits of the same lines"
        raise InputError("--try", "another band or estimator", rule, "Refit without --try")
    found = force.identify(result.frfs, result.setup.sensor_mass, result.edits)
    return edit_cost(found, edits)


@contextmanager
def naming(record: Record) -> Iterator[None]:
    """Name the file of a record in errors about its edits."""
    try:
        yield
    except FitError as error:
        raise (FitError(f"{record.file}, {error}") if record.file else error) from error


def as_record(edits: Sequence[Edit] | Record) -> Record:
    """Decisions as a record."""
    return edits if isinstance(edits, Record) else Record(tuple(edits))


def refittable(source: Result | Path | str, *, accept_changes: bool = False) -> Result:
    """A result that holds what a refit needs; of a path, the result read from there."""
    if isinstance(source, Result):
        result, where = source, source.name
    else:
        result, where = load(source, accept_changes=accept_changes), str(source)
    if result.setup is None or "max_order" not in result.provenance.get("options", {}):
        version = result.provenance.get("software", {}).get("ringmodal", "an earlier version")
        rule = "it holds too little for the same numbers as from the recordings"
        remedy = "Process the recordings again, with --edits for decisions"
        raise InputError(where, f"a result of ringmodal {version}", rule, remedy)
    return result


def _with_processing(result: Result, asked: Asked, record: Record) -> tuple[Edit, ...]:
    """Edits of a record, after the settings in which its own result differs from this one."""
    processing = result.provenance["options"]["processing"]
    for name, value in {**record.processing, **of_blocks(record.edits)}.items():
        if name not in _OF_STORED and processing.get(name) != value:
            where, rule = record.file or "edits", "other blocks or windows need the recordings"
            remedy = "Replay with `ringmodal process CAMPAIGN --edits FILE`"
            raise InputError(where, f"{name} = {value!r}", rule, remedy)
    there = asked.changed(record.processing)
    if there == asked:
        return record.edits
    other = {name: getattr(there, name) for name in _OF_STORED}
    changed = {name: each for name, each in other.items() if each != getattr(asked, name)}
    return (Edit(EditKind.SETTINGS, settings=changed, reason="[processing]"), *record.edits)


def with_record(result: Result, asked: Asked, record: Record) -> Result:
    """The result with its decisions in its provenance, and how they compare with a record."""
    own = ("edits", "edited_by", "replayed", "signed", _BEFORE)
    about = {name: part for name, part in result.provenance.items() if name not in own}
    if not result.edits:
        return replace(result, provenance=about)
    now = asked.changed(settings_of(result.edits))
    changed = [name for name in _OF_STORED if getattr(now, name) != getattr(asked, name)]
    options = {**about["options"], **{n: getattr(now, n) for n in _OF_STORED if n != "band_hz"}}
    options["processing"] = {**options["processing"], "band_hz": now.band_hz}
    about |= {
        "options": options,
        "edits": edit_records(result.edits),
        "edited_by": sorted({edit.by for edit in result.edits if edit.by}),
    }
    if changed:
        about[_BEFORE] = {name: getattr(asked, name) for name in changed}
    result = replace(result, provenance=about)
    if (replayed := record.compared_with(result)) is not None:
        about["replayed"] = replayed.value
    return result
