"""Identification: from FRFs to modes and findings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ema.checks.corrections import Correction, followed_by
from ema.checks.positions import (
    PositionCheck,
    check_positions,
    moved,
    no_wave_finding,
    position_findings,
    unexplained_share,
)
from ema.checks.screening import screen
from ema.checks.sensor_consistency import ConsistencyCheck, check_consistency, is_better, withheld
from ema.circumference.mass_loading import unloaded, without_live_mass
from ema.circumference.orders import on_circle, without_order
from ema.core.display import band_text, counted
from ema.core.drift import NO_DRIFT, Drift
from ema.core.finding import Finding, findings_html
from ema.core.frf import FRF, widened_band
from ema.core.modes import ModalModel, model_html
from ema.core.numerics import one_blas_thread
from ema.core.settings import CHECKS, IDENTIFICATION, CheckSettings, IdentificationSettings
from ema.fitting.curve_fit import fit_modes
from ema.poles.selection import OTHER, Opinion, PoleSelection, second_opinion, select_poles
from ema.poles.stability import StabilityDiagram, build_stability

# A force of wrong sign first, then the sensors, then a look at what is left.
_CONSISTENCY_PASSES = 3
# What a drift does to the compensation of masses is a tenth of it each time.
_DRIFT_PASSES = 2
# Mean gain and phase of the sensors are known to this (1 σ): ISO 16063-21, and 10 µs at 160 Hz.
_MASS_KNOWN = 0.01
_ANGLES_IN_DOUBT = "the angles of the sensors are in doubt"


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

    def __repr__(self) -> str:
        return identification_line(self)

    def _repr_html_(self) -> str:
        return identification_html(self)


@dataclass(frozen=True, eq=False)
class SensorMass:
    """Mass of the sensors and where they sat.

    Parameters
    ----------
    mass_kg : float
        Mass of one sensor.
    sensors_deg : dict of str to ndarray
        Angles of all sensors of each run.
    excitation_deg : float
        Angle of the force.
    live_mass_kg : float
        Mass between load cell and tyre.
    drift : Drift
        Natural frequencies of the runs against each other.
    own_kg : dict of str to ndarray
        Mass of each sensor in `sensors_deg`, where they differ.

    Examples
    --------
    >>> import ringmodal as rm
    >>> from ema.circumference.mass_loading import sensors_of_runs
    >>> campaign = rm.read_campaign("sample_data/tyre_225_55R17")
    >>> mass = rm.SensorMass(0.004, sensors_of_runs(campaign))
    >>> mass.sensors_deg["config_1.uff"][:3]
    array([ 0., 30., 60.])
    """

    mass_kg: float
    sensors_deg: dict[str, NDArray[np.float64]]
    excitation_deg: float = 0.0
    live_mass_kg: float = 0.0
    drift: Drift = NO_DRIFT
    own_kg: dict[str, NDArray[np.float64]] = field(default_factory=dict)

    @property
    def loads(self) -> bool:
        """Whether a sensor has a mass."""
        return bool(self.mass_kg) or any(np.any(each) for each in self.own_kg.values())


@one_blas_thread
def identify_modes(
    frf: FRF,
    band_hz: tuple[float, float] = (20.0, 260.0),
    *,
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
    frf : FRF
    band_hz : tuple of float
        Band of the result.
    pinned_hz : sequence of float, optional
        Frequencies of the modes, instead of the automatic selection.
    excluded_hz : sequence of float
        Frequencies of poles that are no modes.
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
        If no channel is usable.
    FitError
        If no mode can be identified.

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
    asked = _Asked(band_hz, pinned_hz, excluded_hz, max_order, method, settings, checks)
    widened_band(frf, band_hz)  # refuses a band without lines, of which nothing can be judged
    usable, findings, exclusions = screen(frf, band_hz, checks)
    poles = asked.poles(usable)
    state = _State(frf, usable, exclusions, tuple(findings))
    if not on_circle(usable.position_deg):
        fitted, (diagram, model) = usable, asked.fit(usable, poles)
    else:
        positions = check_positions(usable, poles[1], band_hz, checks)
        state = state.told(position_findings(positions, frf))
        if positions.orders_hold:
            state = replace(state, mass=sensor_mass)
            state, fitted, (diagram, model) = _consistent(state, asked, poles, positions)
        else:
            fitted, (diagram, model) = usable, asked.fit_elsewhere(usable, poles, positions)
    other = OTHER[method]
    opinions = second_opinion(fitted, model.modes, band_hz, other, max_order, settings)
    return Identification(
        frf=fitted,
        diagram=diagram,
        model=model,
        opinions=opinions,
        findings=state.findings,
        measured=frf,
        corrections=state.corrections,
        sensor_mass=state.mass,
    )


_Poles = tuple[StabilityDiagram, PoleSelection]
_Fit = tuple[StabilityDiagram, ModalModel]


@dataclass(frozen=True)
class _Asked:
    """Options of an identification."""

    band_hz: tuple[float, float]
    pinned_hz: Sequence[float] | None
    excluded_hz: Sequence[float]
    max_order: int
    method: str
    settings: IdentificationSettings
    checks: CheckSettings

    def poles(self, frf: FRF) -> _Poles:
        """Stability diagram, and the poles selected from it."""
        diagram = build_stability(
            frf, self.band_hz, max_order=self.max_order, method=self.method, settings=self.settings
        )
        return diagram, self.selected(diagram)

    def selected(self, diagram: StabilityDiagram) -> PoleSelection:
        """Poles of a stability diagram."""
        return select_poles(diagram, self.pinned_hz, self.excluded_hz, self.settings)

    def fit(self, frf: FRF, poles: _Poles | None = None) -> _Fit:
        """Modes from poles, or from poles yet to be found."""
        diagram, selection = poles or self.poles(frf)
        return diagram, fit_modes(frf, selection, settings=self.settings)

    def fit_elsewhere(self, frf: FRF, poles: _Poles, positions: PositionCheck) -> _Fit:
        """Modes at the angles that explain the shapes, and nothing said of their orders.

        As of any structure, the members of pairs would be free at all positions: damping wrong by
        tens of per cent.
        """
        elsewhere = replace(frf, position_deg=moved(frf, positions.moves))
        diagram, model = self.fit(elsewhere, poles)
        modes = tuple(without_order(mode, _ANGLES_IN_DOUBT) for mode in model.modes)
        return diagram, replace(model, modes=modes, orders=(), position_deg=frf.position_deg)


@dataclass(frozen=True, eq=False)
class _State:
    """FRFs as measured, what was corrected, and what is usable of them."""

    measured: FRF
    usable: FRF
    corrections: tuple[Correction, ...]
    findings: tuple[Finding, ...]
    mass: SensorMass | None = None

    @cached_property
    def fitted(self) -> FRF:
        """What is fitted."""
        return without_mass(self.usable, self.mass)

    def told(self, findings: Sequence[Finding]) -> _State:
        """The same with more findings."""
        return replace(self, findings=(*self.findings, *findings))

    def after(self, check: ConsistencyCheck) -> _State:
        """With the corrections of a check, and its findings."""
        corrections = followed_by(self.measured, self.corrections, check.corrections)
        state = replace(self, usable=check.frf, corrections=corrections)
        return state.told(check.findings)


def _consistent(
    state: _State, asked: _Asked, poles: _Poles, positions: PositionCheck
) -> tuple[_State, FRF, _Fit]:
    """Corrections that make the sensors consistent, FRFs of the bare tyre, and the fit."""
    checks, passes = asked.checks, 0 if positions.hypothesis else _CONSISTENCY_PASSES
    screened, mass, rough = state.usable, state.mass, None
    if mass is not None and passes:
        # Poles as found will do: what the mass does to pairs is not worth sorting out.
        rough = asked.fit(screened, (poles[0], replace(poles[1], pinned=True)))[1]
        check = check_consistency(screened, rough, exclude=False, settings=checks)
        state = state.after(check) if check.changed else state
    fitted = state.fitted
    fit = asked.fit(fitted, poles if fitted is screened else None)
    if mass is not None and rough is not None and is_drift_lost(rough, fit[1]):
        known = replace(state, mass=replace(mass, drift=rough.drift))
        tried = asked.fit(known.fitted)
        if is_better((fitted, fit[1]), (known.fitted, tried[1])):
            state, fitted, fit = known, known.fitted, tried
    for _ in range(passes):
        check = check_consistency(state.usable, fit[1], settings=checks)
        after = state.after(check)
        if check.changed:
            tried = asked.fit(after.fitted)
            if not is_better((fitted, fit[1]), (after.fitted, tried[1])):
                state = state.told([withheld(check)])
                break
            fitted, fit = after.fitted, tried
        state = after
        if not check.changed:
            break
    for _ in range(_DRIFT_PASSES):
        drift = fit[1].drift
        if state.mass is None or not state.mass.loads or not drift.applied:
            break
        state = replace(state, mass=replace(state.mass, drift=drift))
        fitted, fit = state.fitted, asked.fit(state.fitted, (fit[0], asked.selected(fit[0])))
    if positions.unexplained > checks.no_wave_share and not positions.hypothesis:
        share = unexplained_share(fitted, asked.selected(fit[0]), asked.band_hz)
        state = state.told(no_wave_finding(share, checks))
    if rough is not None:
        fit = fit[0], with_mass_std(fit[1], rough)
    return state, fitted, fit


def is_drift_lost(loaded: ModalModel, bare: ModalModel) -> bool:
    """Whether runs that drift were compensated as if in one state.

    They then look like pairs, which leave more than the loaded tyre does.
    """
    return loaded.drift.applied and bare.misfit > loaded.misfit


def with_mass_std(model: ModalModel, loaded: ModalModel) -> ModalModel:
    """The model of the bare tyre with what is not known of the compensation in its ±.

    The force of a mass is as wrong as gain and phase of the sensors that tell its motion: a phase
    turns a shift of frequency into damping.
    """
    bare_hz = np.array([mode.frequency_hz for mode in model.modes])
    loaded_hz = np.array([mode.frequency_hz for mode in loaded.modes])
    shift = np.min(np.abs(bare_hz[:, None] / loaded_hz - 1), axis=1)
    # A mode that only one of both shows is shifted like the others.
    unknown = _MASS_KNOWN * np.minimum(shift, 2 * np.median(shift))
    variance = np.stack([unknown * bare_hz, unknown], axis=1) ** 2
    modes = [
        replace(
            mode,
            frequency_std_hz=float(np.sqrt(mode.frequency_std_hz**2 + hz)),
            damping_std=float(np.sqrt(mode.damping_std**2 + ratio)),
        )
        for mode, (hz, ratio) in zip(model.modes, variance, strict=True)
    ]
    covariance = model.covariance + np.diag(variance.ravel())
    return replace(model, modes=tuple(modes), covariance=covariance)


def without_mass(frf: FRF, sensor_mass: SensorMass | None) -> FRF:
    """FRFs without the mass of the sensors, where it is known and the positions are a circle."""
    if sensor_mass is None or not on_circle(frf.position_deg):
        return frf
    if not sensor_mass.loads:
        return without_live_mass(frf, sensor_mass.live_mass_kg, sensor_mass.excitation_deg)
    return unloaded(
        frf,
        sensor_mass.sensors_deg,
        sensor_mass.own_kg or sensor_mass.mass_kg,
        sensor_mass.excitation_deg,
        sensor_mass.drift,
        sensor_mass.live_mass_kg,
    )


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
