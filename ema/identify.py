"""Identification: from FRFs to modes and findings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ema.automatic import Asked, Basis, automatic_basis, joint_bases
from ema.checks.corrections import Correction, channel_edits, rows_named
from ema.checks.sensor_mass import SensorMass
from ema.core.display import band_text, counted
from ema.core.edits import Edit, EditKind, shorthand
from ema.core.errors import InputError, require_type
from ema.core.finding import Check, Finding, Verdict, findings_html
from ema.core.frf import FRF
from ema.core.frf_arrays import frequencies_of
from ema.core.modes import ModalModel, model_html
from ema.core.numerics import one_blas_thread
from ema.core.references import References, frfs_of
from ema.core.settings import CHECKS, IDENTIFICATION, CheckSettings, IdentificationSettings
from ema.fitting.curve_fit import acts_on_poles, curve_fit
from ema.fitting.edited_fit import EditedFit, edited, edited_jointly
from ema.fitting.listing import with_modal_masses
from ema.fitting.search import CurveFit
from ema.poles.estimators import NO_FRF
from ema.poles.stability import (
    OTHER,
    Opinion,
    StabilityDiagram,
    build_stability,
    second_opinion,
    select_poles,
)
from ema.poles.tracking import PoleSelection

_EACH_ALONE = Finding(
    *("", "", None),
    Check.FORCES,
    Verdict.WARNING,
    "the forces could not be identified together (no position in common, or no mode that all of "
    "them show): the modes are those of the first force; what it does not drive is not among them",
)


@dataclass(frozen=True, eq=False)
class Identification:
    """What `identify_modes` found.

    Parameters
    ----------
    frf : FRF
        The FRFs that were fitted: `measured` with `corrections` applied and the mass compensated.
    diagram : StabilityDiagram
    model : ModalModel
    opinions : tuple of Opinion
        What another pole estimator says about the modes.
    findings : tuple of Finding
        Everything excluded, corrected or doubtful.
    measured : FRF
        The FRFs as measured, with all rows.
    corrections : tuple of Correction
        What is done with single rows before the fit, at most one for each.
    sensor_mass : SensorMass or None
        The mass that was compensated.
    edits : tuple of Edit
        What a person decided.
    automatic : ModalModel or None
        The modes without edits of poles.
    is_preview : bool
        Whether these are numbers of a live refit, whose pairs, cross-check and checks of channels
        are those of before.
    basis : Basis or None
        What `refit_modes` goes on from.
    references : tuple of Identification
        Of each of several forces: its FRFs with modes of all of them, whose residues are its own.
        The identification itself is then that of the first force. Empty for one force.

    Examples
    --------
    >>> import numpy as np
    >>> import ringmodal as rm
    >>> frf = rm.estimate_frf(rm.read_campaign("sample_data/tyre_225_55R17"))
    >>> frf = frf.rows(np.arange(0, 72, 6))  # every 30°, to be quick
    >>> found = rm.identify_modes(frf, band_hz=(60.0, 160.0))
    >>> found
    <Identification: 4 modes, 60 to 160 Hz, 0 warnings>
    >>> [mode.order for mode in found.model.modes]
    [1, 2, 3, 4]
    """

    frf: FRF
    diagram: StabilityDiagram
    model: ModalModel
    opinions: tuple[Opinion, ...]
    findings: tuple[Finding, ...]
    measured: FRF
    corrections: tuple[Correction, ...] = ()
    sensor_mass: SensorMass | None = None
    edits: tuple[Edit, ...] = ()
    automatic: ModalModel | None = None
    is_preview: bool = False
    basis: Basis | None = None
    references: tuple[Identification, ...] = ()

    def __repr__(self) -> str:
        return identification_line(self)

    def _repr_html_(self) -> str:
        return identification_html(self)


@one_blas_thread
def identify_modes(
    frf: FRF | References | Sequence[FRF],
    band_hz: tuple[float, float] | None = None,
    *,
    edits: Sequence[Edit] = (),
    pinned_hz: Sequence[float] | None = None,
    excluded_hz: Sequence[float] = (),
    sensor_mass: SensorMass | None = None,
    max_order: int = 60,
    method: str = "lsce",
    settings: IdentificationSettings = IDENTIFICATION,
    checks: CheckSettings = CHECKS,
) -> Identification:
    """Identify the modes of a band, after a look at every channel.

    Screening → angles → sensor mass → poles → modes → consistency of the sensors; where that
    corrects anything, sensor mass → poles → modes again, kept only if the shapes then come closer
    to those of a ring. Where other angles than the stated ones explain the shapes, the finding
    says which, no sensor is corrected, and orders that depend on the angles stay unknown. The mass
    is compensated first, as it differs from run to run and would make healthy sensors contradict
    each other; but a sensor of wrong sign or sensitivity would pull in the wrong way, so those are
    corrected before.

    Parameters
    ----------
    frf : FRF, References or sequence of FRF
        Of one force, or of each of several: then both members of a ring's pairs are told by what
        each force drives of them. Edits then name modes of the first one, whose list is that of
        the result.
    band_hz : tuple of float, optional
        Band of the result; default: `FRF.default_band_hz`.
    edits : sequence of Edit
        What a person decided about channels and poles. The automatic identification is run as
        always on the channels; edits of poles act on its modes. Of several decisions on one mode
        the last one counts. Edits of settings are the caller's to apply.
    pinned_hz : sequence of float, optional
        Short for edits that keep the modes at these frequencies, and only those.
    excluded_hz : sequence of float
        Short for edits that set the modes at these frequencies aside.
    sensor_mass : SensorMass, optional
        Corrects to the bare tyre.
    max_order : int
        Highest model order.
    method : {"lsce", "plscf"}
        Pole estimator; the other one gives the cross-check.
    settings : IdentificationSettings
        Thresholds of poles, curve fit and pairs.
    checks : CheckSettings
        Thresholds of the checks on channels and sensors.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        If no channel is usable, or an edit names one that was not measured.
    FitError
        If no mode can be identified, or an edit names none, or several.

    Examples
    --------
    >>> import numpy as np
    >>> import ringmodal as rm
    >>> frf = rm.estimate_frf(rm.read_campaign("sample_data/tyre_225_55R17"))
    >>> frf = frf.rows(np.arange(0, 72, 6))  # every 30°, to be quick
    >>> found = rm.identify_modes(frf, band_hz=(60.0, 160.0))
    >>> for mode in found.model.modes:
    ...     print(mode.order, f"{mode.frequency_hz:.0f} Hz, {100 * mode.damping_ratio:.1f} %")
    1 79 Hz, 3.9 %
    2 100 Hz, 3.3 %
    3 121 Hz, 2.4 %
    4 145 Hz, 2.2 %
    """
    require_type("settings", settings, IdentificationSettings, "Leave it out")
    require_type("checks", checks, CheckSettings, "Leave it out")
    if sensor_mass is not None:
        require_type("sensor_mass", sensor_mass, SensorMass, "Write SensorMass(…), see its help")
    pins = None if pinned_hz is None else frequencies_of("pinned_hz", pinned_hz)
    out = frequencies_of("excluded_hz", excluded_hz) if np.size(excluded_hz) else ()
    edits = (*edits, *shorthand(pins, out))
    measured = frf if isinstance(frf, FRF | References) else References(tuple(frf))
    band_hz = band_hz or frfs_of(measured)[0].default_band_hz(checks.good_coherence)
    asked = Asked(band_hz, sensor_mass, max_order, method, settings, checks)
    if isinstance(measured, FRF):
        return identified(automatic_basis(measured, asked, edits), edits)
    return _of_several(measured, asked, edits)


def _of_several(references: References, asked: Asked, edits: Sequence[Edit]) -> Identification:
    """What each force shows by itself, then what all show together."""
    if len(references) == 1:
        return identified(automatic_basis(references.frfs[0], asked, edits), edits)
    by_force = edits_by_force(references.frfs, edits)
    alone = [
        automatic_basis(frf, _at(asked, frf), own)
        for frf, own in zip(references, by_force, strict=True)
    ]
    return identified_jointly(joint_bases(alone), edits)


def edits_by_force(frfs: Sequence[FRF], edits: Sequence[Edit]) -> list[tuple[Edit, ...]]:
    """Edits for each of several forces: a note, which keeps the numbers, where it has no such row.

    Raises
    ------
    InputError
        For a row that no force has.
    """
    by_force = []
    for number, frf in enumerate(frfs, start=1):
        concerns = [not channel_edits([edit]) or _has_row(frf, edit, number) for edit in edits]
        rest = Edit(EditKind.NOTE)
        by_force.append(tuple(e if own else rest for e, own in zip(edits, concerns, strict=True)))
    for number, edit in enumerate(edits, start=1):
        if any(own[number - 1] is edit for own in by_force):
            continue
        wanted = None if edit.channel is None else edit.channel.reference
        if wanted is not None and wanted not in range(1, len(frfs) + 1):
            rule = f"forces count from 1 to {len(frfs)}"
            where, remedy = f"edit {number}, {edit.kind}", "Correct it"
            raise InputError(where, f"reference = {wanted}", rule, remedy)
        rows_named(frfs[(wanted or 1) - 1], edit, number)  # says what is there
    return by_force


def _has_row(frf: FRF, edit: Edit, number: int) -> bool:
    """Whether an edit means a row of this force, which is that of a number."""
    if (name := edit.channel) is None:
        return any(edit.run in run.split("+") for run in frf.run)
    here = zip(frf.channel, frf.run, strict=True)
    found = any(name.channel == channel and name.run in (None, run) for channel, run in here)
    return found and name.reference in (None, number)


def identified_jointly(
    bases: Sequence[Basis], edits: Sequence[Edit], *, live: bool = False
) -> Identification:
    """Identifications of `joint_bases` with the edits of poles; that of the first force, with all.

    Where forces are identified by themselves, edits name modes of the first one and those like
    them of the others.
    """
    asked, fits = bases[0].asked, [basis.fit for basis in bases]
    if acts_on_poles(edits):
        first, of_ring = bases[0], bases[0].by_itself is not None
        how = {"live": live, "of_ring": of_ring}
        fits = edited_jointly(fits, edits, first.diagram_of, joint=first.joint, **how)
    found = tuple(
        _of_basis(replace(basis, shown=fit), edits) for basis, fit in zip(bases, fits, strict=True)
    )
    findings = dict.fromkeys(finding for each in found for finding in each.findings)
    if bases[0].by_itself is None:
        findings[_EACH_ALONE] = None
    # Another estimator sees one mode for each pair of a ring.
    known = asked.band_hz, OTHER[asked.method], asked.max_order, asked.settings
    opinions: tuple[Opinion, ...] = ()
    if (joint := bases[0].joint) is not None:
        models = [each.model for each in found]
        opinions = second_opinion(joint.frfs, models[0].modes, *known, models=models)
    models, doubts = with_modal_masses(
        [each.model for each in found],
        [each.frf for each in found],
        asked.checks.driving_point_spread,
    )
    found = tuple(replace(each, model=model) for each, model in zip(found, models, strict=True))
    return replace(
        found[0],
        opinions=opinions,
        findings=(*findings, *doubts),
        references=found,
        is_preview=any(each.is_preview for each in found),
        basis=None,
    )


def _at(asked: Asked, frf: FRF) -> Asked:
    """What is asked, the masses at the place of another force."""
    mass = asked.sensor_mass
    if mass is None or not np.isfinite(frf.excitation_deg):
        return asked
    return replace(asked, sensor_mass=replace(mass, excitation_deg=frf.excitation_deg))


def identified(
    basis: Basis, edits: Sequence[Edit], *, live: bool = False, before: Identification | None = None
) -> Identification:
    """An automatic identification with the edits of poles.

    `live` leaves out the second stage; of the same edits, the first one was done `before`.
    """
    asked, fit = basis.asked, basis.fit
    if acts_on_poles(edits):
        first = _first_stage(basis, edits, before)
        fit = edited(fit, edits, basis.diagram_of, live=live, first_stage=first)
    found = _of_basis(replace(basis, shown=fit), edits)
    known = asked.band_hz, OTHER[asked.method], asked.max_order, asked.settings
    crossed, models = basis.crossed or basis.frf, (basis.automatic if live else found.model,)
    opinions = second_opinion(crossed, found.model.modes, *known, models=models)
    return replace(found, opinions=opinions)


def _of_basis(basis: Basis, edits: Sequence[Edit]) -> Identification:
    """What a basis shows, without another estimator's opinion."""
    state, fit = basis.state, basis.shown or basis.fit
    return Identification(
        frf=basis.frf,
        diagram=basis.diagram,
        model=basis.automatic if fit is basis.fit else basis.stated(fit.model),
        opinions=(),
        findings=state.findings,
        measured=state.measured,
        corrections=state.corrections,
        sensor_mass=state.mass,
        edits=tuple(edits),
        automatic=basis.automatic,
        is_preview=basis.is_preview or fit.is_preview,
        basis=replace(basis, shown=fit),
    )


def _first_stage(
    basis: Basis, edits: Sequence[Edit], before: Identification | None
) -> CurveFit | None:
    """The fit of a preview of the same edits on the same basis."""
    if before is None or before.basis is None or before.edits != tuple(edits):
        return None
    shown = before.basis.shown if before.basis.fit is basis.fit else None
    return shown.curve if shown is not None and shown.is_preview else None


def identification_line(found: Identification) -> str:
    """Modes and doubts."""
    doubts = sum(not finding.is_ok for finding in found.findings)
    return (
        f"<Identification: {counted(len(found.model.modes), 'mode')}, "
        f"{band_text(found.model.band_hz)}, {counted(doubts, 'warning')}>"
    )


def identification_html(found: Identification) -> str:
    """The modes, and every finding that a reader has to know."""
    return model_html(found.model) + findings_html(found.findings)


@one_blas_thread
def fit_modes(
    frf: FRF,
    poles: PoleSelection | ArrayLike | None = None,
    band_hz: tuple[float, float] | None = None,
    settings: IdentificationSettings = IDENTIFICATION,
    *,
    hz: ArrayLike | None = None,
) -> ModalModel:
    """Fit poles, residues and residual terms to all FRFs at once.

    Weighted least squares with 1/σ, the noise level of the FRFs over frequency and position;
    poles move within bounds around their start values. The bias of the window is compensated for
    blocks of a random excitation. Runs whose frequencies differ by more than chance have states of
    their own with common shapes, and the result is that of the first.

    Parameters
    ----------
    frf : FRF
    poles : PoleSelection or array_like of complex, optional
        From `select_poles`, or poles in rad/s. Default: the automatic selection.
    band_hz : tuple of float, optional
        Band of the result; by default that of the selection, or where coherence is good.
    settings : IdentificationSettings
    hz : array_like, optional
        List only the modes at these frequencies in Hz. The others of the band are fitted too, so
        that their response is not pressed into these.

    Returns
    -------
    ModalModel

    Raises
    ------
    InputError
        If an argument cannot be used.
    FitError
        If no pole lies in the band, none at a frequency of `hz`, or the fit diverges.

    Examples
    --------
    >>> import ringmodal as rm
    >>> frf = rm.estimate_frf(rm.read_campaign("sample_data/tyre_225_55R17"))
    >>> frf = frf.rows(range(0, 72, 6))  # every 30°, to be quick
    >>> rm.fit_modes(frf, hz=[78.7, 100.3]).frequencies_hz.round(1)
    array([ 78.7, 100.3])
    """
    require_type("frf", frf, FRF, NO_FRF)
    require_type("settings", settings, IdentificationSettings, "Leave it out")
    pinned = None if hz is None else frequencies_of("hz", hz)
    if poles is None:
        band_hz = band_hz or _around(frf, pinned or ())
        selection = select_poles(build_stability(frf, band_hz, settings=settings))
    elif pinned is not None:
        rule = "modes are given by their poles or by their frequencies"
        raise InputError("fit_modes", "poles and hz", rule, "Leave one of them out")
    else:
        selection = poles if isinstance(poles, PoleSelection) else PoleSelection.around(poles)
    fit = EditedFit(curve_fit(frf, selection, band_hz or selection.band_hz, settings))
    if pinned is None:
        return fit.model

    def diagram(method: str | None) -> StabilityDiagram:
        return build_stability(frf, selection.band_hz, method=method or "lsce", settings=settings)

    return edited(fit, shorthand(pinned), diagram).model


def _around(frf: FRF, hz: tuple[float, ...]) -> tuple[float, float]:
    """The band of views, widened to some frequencies and a fifth beyond."""
    low, high = frf.default_band_hz()
    far = min(max([high, *(1.2 * each for each in hz)]), float(frf.frequency_hz[-1]))
    return min([low, *(0.8 * each for each in hz)]), far
