"""Identification: from FRFs to modes and findings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.checks.screening import screen
from ema.checks.sensor_consistency import check_consistency, is_better, withheld
from ema.circumference.mass_loading import unloaded, without_live_mass
from ema.circumference.orders import on_circle
from ema.core.display import band_text, counted
from ema.core.finding import Finding, findings_html
from ema.core.frf import FRF, widened_band
from ema.core.modes import ModalModel, model_html
from ema.core.numerics import one_blas_thread
from ema.core.settings import CHECKS, IDENTIFICATION, CheckSettings, IdentificationSettings
from ema.fitting.curve_fit import fit_modes
from ema.poles.cross_check import OTHER, Opinion, second_opinion
from ema.poles.selection import select_poles
from ema.poles.stability import StabilityDiagram, build_stability

# A force of wrong sign first, then the sensors, then a look at what is left.
_CONSISTENCY_PASSES = 3


@dataclass(frozen=True, eq=False)
class Identification:
    """What `identify_modes` found.

    Parameters
    ----------
    frf : FRF
        The FRFs that were used: faulty channels left out or corrected, sensor mass compensated.
    diagram : StabilityDiagram
    model : ModalModel
    opinions : tuple of Opinion
        What another pole estimator says about the modes.
    findings : tuple of Finding
        Everything excluded, corrected or doubtful.

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

    Screening → sensor mass → poles → modes → consistency of the sensors; where that corrects
    anything, sensor mass → poles → modes again, kept only if the shapes then come closer to those
    of a ring. The mass is compensated first, as it differs from run to run and would make healthy
    sensors contradict each other; but a sensor of wrong sign or sensitivity would pull in the wrong
    way, so those are corrected before.

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

    def once(frf: FRF, *, roughly: bool = False) -> tuple[StabilityDiagram, ModalModel]:
        diagram = build_stability(
            frf, band_hz, max_order=max_order, method=method, settings=settings
        )
        selection = select_poles(diagram, pinned_hz, excluded_hz, settings)
        selection = replace(selection, pinned=selection.pinned or roughly)
        return diagram, fit_modes(frf, selection, settings=settings)

    widened_band(frf, band_hz)  # refuses a band without lines, of which nothing can be judged
    usable, findings = screen(frf, band_hz, checks)
    circle = on_circle(usable.position_deg)
    if sensor_mass is not None and circle:
        # Poles as found will do: what the mass does to pairs is not worth sorting out.
        fitted = once(usable, roughly=True)[1]
        rough = check_consistency(usable, fitted, exclude=False, settings=checks)
        usable, findings = rough.frf, [*findings, *(rough.findings if rough.changed else ())]
    bare = _bare(usable, sensor_mass)
    diagram, model = once(bare)
    for _ in range(_CONSISTENCY_PASSES if circle else 0):
        check = check_consistency(usable, model, settings=checks)
        if check.changed:
            corrected = _bare(check.frf, sensor_mass)
            tried = once(corrected)
            if not is_better((bare, model), (corrected, tried[1])):
                findings = [*findings, withheld(check)]
                break
            usable, bare, (diagram, model) = check.frf, corrected, tried
        findings = [*findings, *check.findings]
        if not check.changed:
            break
    other = OTHER[method]
    opinions = second_opinion(bare, model.modes, band_hz, other, max_order, settings)
    return Identification(bare, diagram, model, opinions, tuple(findings))


def _bare(frf: FRF, sensor_mass: SensorMass | None) -> FRF:
    """FRFs without the mass of the sensors, where it is known."""
    if sensor_mass is None or not on_circle(frf.position_deg):
        return frf
    if sensor_mass.live_mass_kg:
        frf = without_live_mass(frf, sensor_mass.live_mass_kg, sensor_mass.excitation_deg)
    if not sensor_mass.mass_kg:
        return frf
    return unloaded(frf, sensor_mass.sensors_deg, sensor_mass.mass_kg, sensor_mass.excitation_deg)


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
