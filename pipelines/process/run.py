"""Processing of a campaign: recordings, FRFs, modes, ring parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import ema
from ema.checks.quality import reciprocity_findings
from ema.checks.sensor_mass import (
    SensorMass,
    live_mass_note,
    loading_note,
    masses_of_runs,
    sensors_of_runs,
)
from ema.core.campaign import Campaign
from ema.core.edits import Edit, shorthand
from ema.core.errors import InputError, require_type
from ema.core.files import stamp_of
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.numerics import one_blas_thread
from ema.core.references import References, frfs_of
from ema.identify import Identification
from ema.signals.steadiness import steadiness_of
from pipelines.process.refit import (
    Asked,
    as_record,
    decided_on,
    naming,
    of_blocks,
    with_modes,
    with_record,
)
from pipelines.process.ring import tune, with_other_modes
from pipelines.process.validate import refuse_warnings
from pipelines.results.edits_file import Record
from pipelines.results.options import Options, processing_in_force, tuning_in_force, with_settings
from pipelines.results.provenance import Stopwatch, checksummed, provenance
from pipelines.results.result import Result, Setup

# Share by which a band may exceed the last line, as there is none at half the sampling rate.
_BAND_TOLERANCE = 0.01
_IN_DOUBT = "the angles of the sensors are in doubt, or part of the circle has none"
_NO_CIRCLE = "without a circle of positions ([grid]), how it moves at the force is not known"
_FROM_FILE = "FRFs from a file do not state which sensors were on the tyre together"


@one_blas_thread
def process(
    source: str | Path | Sequence[str | Path] | Campaign,
    options: Options | None = None,
    progress: Callable[[str], None] | None = None,
    run_progress: Callable[[int, int], None] | None = None,
    edits: Sequence[Edit] | Record = (),
) -> Result:
    """Recordings → FRFs → poles → modes → ring parameters → validation.

    Parameters
    ----------
    source : path, sequence of paths, or Campaign
        A campaign's folder, its manifest, or recordings; or a campaign in memory, such as one with
        FRFs from arrays.
    options : Options, optional
    progress : callable, optional
        Called with the name of each stage as it starts.
    run_progress : callable, optional
        Called with (done, total) after the FRFs of each run.
    edits : sequence of Edit, or Record
        Decisions on modes, channels and settings, in their order.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        If the input cannot be used, or gives a warning in a strict run.
    FitError
        If no modes can be identified, or an edit names none, or several.

    Examples
    --------
    >>> import ringmodal as rm
    >>> result = rm.process("sample_data/tyre_225_55R17")
    >>> result
    <Result tyre_225_55R17: 9 modes, ring tuned, 0 warnings>
    >>> bool(abs(result.validation.error_percent).max() < 1.0)
    True
    """
    options = options or Options()
    require_type("options", options, Options, "Write Options(max_order=40)")
    record = as_record(edits)
    options = with_settings(options, {**record.processing, **of_blocks(record.edits)})
    decided = (*record.edits, *shorthand(options.pinned_hz or None, options.excluded_hz))
    watch = Stopwatch(progress or (lambda name: None))
    with watch.stage("read", "Reading"):
        campaign = _read(source, options)
        stamps = {path: stamp_of(path.stat()) for path in campaign.sources}
        options = replace(options, tuning=tuning_in_force(campaign.tuning, options.tuning))
    processing = processing_in_force(campaign, options.processing)
    with watch.stage("frf", "Estimating FRFs"):
        estimated = ema.estimate_frf(
            campaign, processing, estimator=options.estimator, progress=run_progress
        ).as_stored()
        first = frfs_of(estimated)[0]
        campaign, band_hz = _with_band(replace(campaign, processing=processing), first)
        mutual = reciprocity_findings(frfs_of(estimated), band_hz, campaign.checks)
        campaign = replace(campaign, findings=(*campaign.findings, *mutual))
    asked = Asked(
        band_hz=band_hz,
        max_order=options.max_order,
        method=options.method,
        estimator=options.estimator,
        identification=campaign.identification,
        checks=campaign.checks,
    )
    with checksummed(stamps) as inputs:
        with watch.stage("modes", "Identifying modes"):
            found = asked.identify(estimated, _sensor_mass(campaign))
        measured = _measured(campaign, found, asked, _setup(campaign, estimated, found))
        if decided:
            with watch.stage("decisions", "Applying decisions"), naming(record):
                measured = decided_on(measured, asked, decided, found)
        if options.strict:
            refuse_warnings(measured.findings)
        with watch.stage("ring", "Tuning the ring"):
            result = tune(measured, options)
    in_force = replace(processing, band_hz=band_hz)
    about = provenance(campaign, inputs(), options, in_force, found.frf, watch)
    mass = found.sensor_mass
    about["corrections"] = {
        "exponential_window_s": in_force.exponential_window_s,
        "sensor_mass_kg": campaign.stated_mass_kg if mass is not None and mass.loads else None,
        "live_mass_kg": None if mass is None else mass.live_mass_kg or None,
    }
    return with_record(replace(result, provenance=about), asked, record)


def _read(source: str | Path | Sequence[str | Path] | Campaign, options: Options) -> Campaign:
    """The campaign with the settings of the call; refused if it does not suffice for them."""
    campaign = source if isinstance(source, Campaign) else ema.read_campaign(source)
    _require_ring_data(campaign, options)
    if options.strict:
        refuse_warnings(campaign.findings)
    identification = options.identification or campaign.identification
    return replace(
        campaign, identification=identification, checks=options.checks or campaign.checks
    )


def _setup(campaign: Campaign, estimated: FRF | References, found: Identification) -> Setup:
    """What is said of the recordings, whatever is decided on the modes."""
    every = found.references or (found,)
    steady = [steadiness_of(campaign.runs, each.frf, each.model, campaign.checks) for each in every]
    return Setup(
        sensor_mass=_sensor_mass(campaign),
        findings=(
            *campaign.findings,
            *(finding for frf in frfs_of(estimated) for finding in frf.findings),
            *_masses_left(campaign, found),
        ),
        notes=tuple(_mass_notes(campaign, found)),
        steadiness=tuple(each for runs in steady for each in runs),
    )


def _measured(campaign: Campaign, found: Identification, asked: Asked, setup: Setup) -> Result:
    """Result before the ring steps and any decision, with the findings of all checks."""
    bare = Result(
        name=campaign.name,
        tyre=campaign.tyre,
        frf=found.frf,
        measured=found.measured,
        diagram=found.diagram,
        modal_model=found.model,
        excitation_deg=campaign.excitation_deg,
        reference_deg=campaign.reference_deg,
        setup=setup,
    )
    plain = with_modes(bare, found, asked.checks)
    whole = with_other_modes(plain, campaign, asked.band_hz, asked.estimator)
    notes = (*setup.notes, *whole.notes[len(plain.notes) :])
    later = whole.findings[len(plain.findings) :]
    return replace(whole, setup=replace(setup, notes=notes, later=later))


def _require_ring_data(campaign: Campaign, options: Options) -> None:
    """Refuse a tyre without pressure or radius before processing, not after."""
    if campaign.tyre is None or not options.tune:
        return
    for name in ("inflation_pressure_pa", "mean_radius_m"):
        if getattr(campaign.tyre, name) is None:
            where = f"{_origin(campaign)}, [tyre]"
            rule = "ring parameters cannot be determined without it"
            remedy = f"Add {name} = …, or stop at the modes with --no-tune"
            raise InputError(where, f"no {name}", rule, remedy)
    numbered = not any(finding.check == Check.NODE for finding in campaign.findings)
    if len(campaign.runs) > 1 and not campaign.has_circle and not numbered:
        raise InputError(
            _origin(campaign),
            f"{len(campaign.runs)} runs whose sensors have neither position nor node",
            "sensors of one name are averaged over the runs, but they move if the tyre is turned",
            "Add [grid] positions = … and positions_deg = { sensor = angle, … } to every [[runs]], "
            "or stop at the modes with --no-tune if they stayed in place",
        )


def _origin(campaign: Campaign) -> str:
    return campaign.sources[0].name if campaign.sources else campaign.name


def _with_band(campaign: Campaign, frf: FRF) -> tuple[Campaign, tuple[float, float]]:
    """The band as stated, which must not exceed the FRFs, or else the default with a finding."""
    stated_hz, last_hz = campaign.processing.band_hz, float(frf.frequency_hz[-1])
    if stated_hz is None:
        is_tyre = campaign.has_circle or campaign.tyre is not None
        band_hz = frf.default_band_hz(campaign.checks.good_coherence, is_tyre=is_tyre)
        why = "as excited and coherent; set band_hz to change"
        detail = f"{band_hz[0]:g} to {band_hz[1]:g} Hz, {why}"
        finding = Finding("", "", None, Check.BAND, Verdict.OK, detail)
        return replace(campaign, findings=(*campaign.findings, finding)), band_hz
    if stated_hz[1] > last_hz * (1 + _BAND_TOLERANCE):
        found = f"{stated_hz[0]:g} to {stated_hz[1]:g} Hz"
        rule = f"the FRFs end at {last_hz:g} Hz, half the sampling rate"
        raise InputError("band_hz", found, rule, "Lower the upper limit")
    return campaign, stated_hz


def _sensor_mass(campaign: Campaign) -> SensorMass | None:
    """Masses to compensate; those of sensors only where it is known which sat there together."""
    if not campaign.has_circle:
        return None
    stated = campaign.stated_mass_kg if campaign.runs else None
    if stated is None and campaign.live_mass_kg is None:
        return None
    return SensorMass(
        (campaign.sensor_mass_kg or 0.0) if campaign.runs else 0.0,
        sensors_of_runs(campaign),
        campaign.excitation_deg or 0.0,
        campaign.live_mass_kg or 0.0,
        own_kg=masses_of_runs(campaign) if campaign.own_masses_kg else {},
    )


def _mass_notes(campaign: Campaign, found: Identification) -> Iterator[str]:
    """What was done about force windows of the analyser and about the mass of the sensors."""
    if (length_s := campaign.processing.force_window_s) is not None:
        yield f"The analyser applied a force window of {length_s:g} s, which adds no damping."
    yield from _live_mass_notes(campaign, found)
    stated, compensated = campaign.stated_mass_kg, found.sensor_mass
    if not campaign.has_circle or (stated is None and not campaign.runs):
        return
    if stated is None:
        sensors = max(angles.size for angles in sensors_of_runs(campaign).values())
        yield loading_note(found.model, sensors, campaign.excitation_deg or 0.0)
    elif compensated is not None and compensated.loads:
        yield f"Corrected to the bare tyre: sensor mass of {_grams(stated)} is compensated."
        if any(mode.order is None for mode in found.model.modes):
            yield "Of modes of unknown order, it may be left; their ± holds that."
        if campaign.reference_deg is None and any(run.reference for run in campaign.runs):
            yield "The mass of the reference sensor is not compensated: its angle is not given."


def _live_mass_notes(campaign: Campaign, found: Identification) -> Iterator[str]:
    """What was done about the mass between load cell and tyre, or how large its effect may be."""
    mass_kg = campaign.live_mass_kg
    if mass_kg is None:
        if campaign.has_circle:
            yield live_mass_note(found.model, campaign.excitation_deg or 0.0)
    elif mass_kg and found.sensor_mass is not None:
        grams = f"{1e3 * mass_kg:g} g"
        yield f"Corrected to the bare tyre: live mass of {grams} at the force is compensated."


def _masses_left(campaign: Campaign, found: Identification) -> Iterator[Finding]:
    """Masses that are stated and still in the modes: no ± holds what they shift."""
    stated, live_kg, taken = campaign.stated_mass_kg, campaign.live_mass_kg, found.sensor_mass
    loads = any(stated.values()) if isinstance(stated, dict) else bool(stated)
    reason = _IN_DOUBT if campaign.has_circle else _NO_CIRCLE
    left = {}
    if stated is not None and loads and (taken is None or not taken.loads):
        from_file = campaign.has_circle and not campaign.runs
        left[f"sensors of {_grams(stated)}"] = _FROM_FILE if from_file else reason
    if live_kg and taken is None:
        left[f"{1e3 * live_kg:.3g} g between load cell and tyre"] = reason
    for what, why in left.items():
        detail = f"{what}: not compensated, natural frequencies are those with this mass; {why}"
        yield Finding("", "", None, Check.MASS, Verdict.WARNING, detail)


def _grams(stated: float | dict[str, float]) -> str:
    """Masses of sensors, for a note."""
    if not isinstance(stated, dict):
        return f"{1e3 * stated:g} g each"
    others = {name: "all others" if name == "default" else name for name in stated}
    return ", ".join(f"{1e3 * mass:g} g ({others[name]})" for name, mass in stated.items())
