"""The automatic identification, on which edits act: corrections, poles and modes, pass by pass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.checks.corrections import (
    Correction,
    channel_edits,
    corrected,
    corrections_by_hand,
    followed_by,
    gains_applied,
    rows_by_hand,
    screen,
)
from ema.checks.positions import (
    PositionCheck,
    check_positions,
    moved,
    no_wave_finding,
    position_findings,
    unexplained_share,
)
from ema.checks.sensor_consistency import SLACK, ConsistencyCheck, check_consistency, is_better
from ema.checks.sensor_mass import (
    SensorMass,
    is_drift_lost,
    mixed_waves,
    with_mass_std,
    without_mass,
)
from ema.circumference.orders import on_circle, without_order
from ema.core.edits import Edit, EditKind
from ema.core.errors import FitError, InputError
from ema.core.finding import Finding
from ema.core.frf import FRF, TYRE_BAND_HZ
from ema.core.modes import ModalModel
from ema.core.references import References
from ema.core.settings import CheckSettings, IdentificationSettings
from ema.fitting.curve_fit import Wish, curve_fit, pole_named, wishes
from ema.fitting.edited_fit import EditedFit
from ema.fitting.joint_modes import JointModes, joint_modes
from ema.fitting.joint_orders import (
    across_forces,
    contradicted_curves,
    joint_curves,
    settled_curves,
)
from ema.poles.estimators import widened_band
from ema.poles.stability import StabilityDiagram, build_stability, select_poles
from ema.poles.tracking import PoleSelection
from ema.signals.leakage import without_left_out_lines

# A force of wrong sign first, then the sensors, then a look at what is left.
_CONSISTENCY_PASSES = 3
# Compensations of the sensors' mass run by run, each with a tenth of what a drift does to it, and
# with the pairs that were found.
_DRIFT_PASSES, _MASS_PASSES = 2, 2
# Masses are compensated up to this many times the end of the band: orders that resonate far above
# are too many to be told apart, and recordings at 4 kHz took five times as long.
_COMPENSATED = 1.5
# As many modes that are none of the ring are no chance, nor a rim, sidewall and air.
_FEIGNED = 4
_ANGLES_IN_DOUBT = "the angles of the sensors are in doubt"


def automatic_basis(frf: FRF, asked: Asked, edits: Sequence[Edit]) -> Basis:
    """The automatic identification of the FRFs with the edits of channels, to its end."""
    widened_band(frf, asked.band_hz)  # refuses a band without lines, of which nothing can be judged
    asked = replace(asked, wanted=_wanted(edits))
    by_hand, told = corrections_by_hand(frf, edits)
    edits = channel_edits(edits)
    offered = corrected(frf, by_hand)
    usable, findings, exclusions = screen(
        offered, asked.band_hz, asked.checks, decided=rows_by_hand(frf, by_hand)
    )
    corrections = followed_by(frf, by_hand, exclusions)
    state = State(frf, usable, corrections, (*told, *findings))
    poles = asked.poles(usable)
    if not on_circle(usable.position_deg):
        return Basis(asked, state, usable, *asked.fit(usable, poles), edits=edits)
    positions = check_positions(usable, poles[1], asked.band_hz, asked.checks)
    state = state.told(position_findings(positions, frf))
    if positions.orders_hold:
        state = replace(state, mass=asked.loading)
        return replace(_consistent(state, asked, poles, positions), edits=edits)
    elsewhere = replace(usable, position_deg=moved(usable, positions.moves))
    fit = asked.fit(elsewhere, poles)
    return Basis(asked, state, usable, *fit, stated_deg=usable.position_deg, edits=edits)


def joint_bases(bases: Sequence[Basis]) -> tuple[Basis, ...]:
    """Identifications against each of several forces, with what all of them say together.

    On a circle the orders of the ring are fitted to all forces; on other structures, or where
    angles are in doubt, all modes are. Forces without a position in common stay as they are.
    """
    if len(bases) < 2:
        return tuple(bases)
    if all(each.fit.curve.circle and each.stated_deg is None for each in bases):
        alone, fits = _with_known_pairs(bases)
        every = zip(alone, fits, bases, strict=True)
        return tuple(replace(each, fit=fit, by_itself=own) for each, fit, own in every)
    together = References(tuple(each.frf for each in bases))
    try:
        diagram = bases[0].asked.diagram(together)
        joint, rows, findings = joint_modes(together, [each.fit.curve for each in bases], diagram)
    except (FitError, InputError):
        return tuple(bases)
    return tuple(
        replace(
            each,
            diagram=diagram,
            fit=EditedFit(each.fit.curve, one),
            state=each.state.told(findings),
            by_itself=each,
            joint=joint,
        )
        for each, one in zip(bases, rows, strict=True)
    )


def _wanted(edits: Sequence[Edit]) -> tuple[Wish, ...]:
    return tuple(wishes(edits, EditKind.KEEP, EditKind.PICK))


_Poles = tuple[StabilityDiagram, PoleSelection]
_Fit = tuple[StabilityDiagram, EditedFit]


@dataclass(frozen=True)
class Asked:
    """Options of an identification, as of `identify_modes`."""

    band_hz: tuple[float, float]
    sensor_mass: SensorMass | None
    max_order: int
    method: str
    settings: IdentificationSettings
    checks: CheckSettings
    wanted: tuple[Wish, ...] = ()  # poles to start from where the diagram shows no mode

    @property
    def loading(self) -> SensorMass | None:
        """The masses as they are compensated: as far as the fit and orders near the band reach."""
        upper_hz = _COMPENSATED * max(self.band_hz[1], TYRE_BAND_HZ[1])
        return self.sensor_mass and replace(self.sensor_mass, upper_hz=upper_hz)

    def diagram(self, frf: FRF | References, method: str | None = None) -> StabilityDiagram:
        """Stability diagram of the asked method or another one."""
        return build_stability(
            frf,
            self.band_hz,
            max_order=self.max_order,
            method=method or self.method,
            settings=self.settings,
        )

    def poles(self, frf: FRF) -> _Poles:
        """Stability diagram, and the poles selected from it."""
        diagram = self.diagram(frf)
        return diagram, self.selected(diagram)

    def selected(self, diagram: StabilityDiagram) -> PoleSelection:
        """Poles of a diagram: the automatic ones, or what a person wants where there are none."""
        if self.wanted and not self.shows_mode(diagram):
            poles = {pole_named(diagram, wish, self.settings) for wish in self.wanted}
            return PoleSelection(np.array(sorted(poles, key=abs)), self.band_hz)
        return select_poles(diagram)

    def shows_mode(self, diagram: StabilityDiagram) -> bool:
        """Whether a diagram has an automatic pole in the band."""
        low, high = self.band_hz
        return any(c.kept and low <= c.frequency_hz <= high for c in diagram.clusters)

    def fit(self, frf: FRF, poles: _Poles | None = None) -> _Fit:
        """The automatic fit from poles, or from poles yet to be found."""
        diagram, selection = poles or self.poles(frf)
        curve = curve_fit(frf, selection, selection.band_hz, self.settings)
        return diagram, EditedFit(curve)


@dataclass(frozen=True, eq=False)
class State:
    """FRFs as measured, what was corrected, and what is usable of them."""

    measured: FRF
    usable: FRF
    corrections: tuple[Correction, ...]
    findings: tuple[Finding, ...]
    mass: SensorMass | None = None

    @cached_property
    def fitted(self) -> FRF:
        """What is fitted."""
        return without_mass(without_left_out_lines(self.usable), self.mass)

    def knowing(self, **known: Any) -> State:
        """The same with more that is known of the mass of the sensors, as of `SensorMass`."""
        return replace(self, mass=self.mass and replace(self.mass, **known))

    def told(self, findings: Sequence[Finding]) -> State:
        """The same with more findings."""
        new = [each for each in findings if each not in self.findings]
        return replace(self, findings=(*self.findings, *new))

    def after(self, check: ConsistencyCheck) -> State:
        """With the corrections of a check, and its findings."""
        made = followed_by(self.measured, self.corrections, check.corrections)
        state = replace(self, usable=check.frf, corrections=made)
        return replace(state, findings=check.beside(self.findings)).told(check.findings)

    def checked(self, model: ModalModel, checks: CheckSettings, **how: Any) -> ConsistencyCheck:
        """Check of the sensors against the modes; rows decided by hand stay as they are."""
        of_rows = self.measured, self.corrections
        how |= {"decided": rows_by_hand(*of_rows), "applied": gains_applied(*of_rows)}
        return check_consistency(self.usable, model, settings=checks, **how)


@dataclass(frozen=True, eq=False)
class Basis:
    """The automatic identification, on which edits of poles act.

    Parameters
    ----------
    asked : Asked
    state : State
        What was done with the FRFs.
    frf : FRF
        What was fitted.
    diagram : StabilityDiagram
    fit : EditedFit
        Without edits.
    loaded : ModalModel or None
        The tyre with the sensors, where their mass was compensated.
    stated_deg : ndarray or None
        Angles as stated, where others explain the shapes: nothing is said of orders then.
    edits : tuple of Edit
        Of channels, which led here.
    is_preview : bool
        Whether the FRFs were changed without the checks looking at them again.
    shown : EditedFit or None
        With edits.
    crossed : FRF or None
        What the cross-check looked at, where not `frf`.
    by_itself, joint : Basis, JointModes or None
        What this force shows alone, where `fit` is that of several; off a circle the fit of all.
    """

    asked: Asked
    state: State
    frf: FRF
    diagram: StabilityDiagram
    fit: EditedFit
    loaded: ModalModel | None = None
    stated_deg: NDArray[np.float64] | None = None
    edits: tuple[Edit, ...] = ()
    is_preview: bool = False
    shown: EditedFit | None = None
    crossed: FRF | None = None
    by_itself: Basis | None = None
    joint: JointModes | None = None

    def is_of(self, edits: Sequence[Edit]) -> bool:
        """Whether the automatic identification is the same with these edits."""
        same = self.asked.shows_mode(self.diagram) or self.asked.wanted == _wanted(edits)
        return same and channel_edits(edits) == self.edits

    @cached_property
    def automatic(self) -> ModalModel:
        """The modes without edits of poles."""
        return self.stated(self.fit.model)

    @property
    def loads(self) -> bool:
        """Whether sensors whose mass is compensated load the tyre."""
        return bool(self.state.mass and self.state.mass.loads)

    def on(self, state: State, poles: _Poles | None = None) -> Basis:
        """Another fit, of FRFs corrected otherwise."""
        diagram, fit = self.asked.fit(state.fitted, poles)
        return replace(self, state=state, frf=state.fitted, diagram=diagram, fit=fit)

    def knowing(self, *, mixing: bool, **known: Any) -> Basis:
        """The same poles where the mass of the sensors is compensated by what modes show."""
        if self.state.mass is None or not self.loads:
            return self
        if mixing:
            known["mixed"] = mixed_waves(self.fit.model, self.state.mass.excitation_deg)
        state = self.state.knowing(**known)
        curve = self.fit.curve.on(state.fitted)
        curve.find_pairs()
        return replace(self, state=state, frf=state.fitted, fit=EditedFit(curve))

    def is_better_than(self, other: Basis) -> bool:
        """Whether corrections fit the FRFs better than those of another identification."""
        return is_better((other.frf, other.fit.model), (self.frf, self.fit.model))

    def is_cleaner_than(self, other: Basis) -> bool:
        """Whether modes that are none of the ring are gone, as two runs that drift feign them."""
        here, there = (sum(m.doubtful for m in each.fit.model.modes) for each in (self, other))
        return there >= _FEIGNED and here < there / 2

    def stated(self, model: ModalModel) -> ModalModel:
        """The modes of a fit as a result states them."""
        if self.loaded is not None:
            model = with_mass_std(model, self.loaded, self.fit.model, self.frf)
        if self.stated_deg is None:
            return model
        modes = tuple(without_order(mode, _ANGLES_IN_DOUBT) for mode in model.modes)
        return replace(model, modes=modes, orders=(), position_deg=self.stated_deg)

    def diagram_of(self, method: str | None) -> StabilityDiagram:
        """Stability diagram of the asked method or another one."""
        same = method in (None, self.asked.method)
        every = self.frf if self.joint is None else self.joint.frfs
        return self.diagram if same else self.asked.diagram(every, method)


def _consistent(state: State, asked: Asked, poles: _Poles, positions: PositionCheck) -> Basis:
    """Corrections that make the sensors consistent, FRFs of the bare tyre, and the fit."""
    basis = _first_fit(state, asked, poles, trusted=not positions.hypothesis)
    if not positions.hypothesis:
        basis = _with_sensors_checked(basis)
    basis = _with_known_pairs([_with_known_drift(basis)])[0][0]
    if positions.unexplained > asked.checks.no_wave_share and not positions.hypothesis:
        share = unexplained_share(basis.frf, asked.selected(basis.diagram), asked.band_hz)
        return replace(basis, state=basis.state.told(no_wave_finding(share, asked.checks)))
    return basis


def _first_fit(state: State, asked: Asked, poles: _Poles, *, trusted: bool) -> Basis:
    """The fit without the mass of the sensors, after the sensors at fault are corrected."""
    screened, loaded = state.usable, None
    if state.mass is not None and trusted:
        # Poles as found will do: what the mass does to pairs is not worth sorting out.
        pinned = poles[0], replace(poles[1], pinned=True)
        loaded = asked.fit(state.usable, pinned)[1].model
        check = state.checked(loaded, asked.checks, exclude=False)
        state = state.after(check) if check.changed else state
    known = poles if state.fitted is screened else None
    basis = Basis(asked, state, state.fitted, *asked.fit(state.fitted, known), loaded=loaded)
    if loaded is None or not is_drift_lost(loaded, basis.fit.model):
        return basis
    steady = basis.on(state.knowing(drift=loaded.drift))
    better = steady.is_better_than(basis) or steady.is_cleaner_than(basis)
    return steady if better else basis


def _with_sensors_checked(basis: Basis) -> Basis:
    """With the corrections of sensors that the modes ask for, while these make the fit better."""
    for _ in range(_CONSISTENCY_PASSES):
        check = basis.state.checked(basis.fit.model, basis.asked.checks)
        state = basis.state.after(check)
        if not check.changed:
            return replace(basis, state=state)
        corrected_basis = basis.on(state)
        if not corrected_basis.is_better_than(basis):
            return replace(basis, state=basis.state.told([check.withheld]))
        basis = corrected_basis
    return basis


def _with_known_drift(basis: Basis) -> Basis:
    """With masses compensated run by run as the tyre drifts."""
    for _ in range(_DRIFT_PASSES):
        drift, mass = basis.fit.settled.drift, basis.state.mass
        if mass is None or not drift.applied or drift.is_as(mass.drift):
            break
        state = basis.state.knowing(drift=drift)
        basis = basis.on(state, (basis.diagram, basis.asked.selected(basis.diagram)))
    return basis


def _with_known_pairs(bases: Sequence[Basis]) -> tuple[Sequence[Basis], list[EditedFit]]:
    """With the mass of the sensors compensated by what pairs show, while that fits; and fits.

    Where it does not, the pairs have in their ± what it would have changed.
    """
    loads = any(each.loads for each in bases)
    mixing = False
    if loads:
        mixed = [each.knowing(mixing=True) for each in bases]
        before, after = (_misfit([own.fit for own in each]) for each in (bases, mixed))
        # On an even tyre, what is left of the sensors looks like waves of other orders.
        mixing = SLACK * after < before
        bases = mixed if mixing else bases
    fits = _with_pairs(bases)
    for _ in range(_MASS_PASSES if loads else 0):
        found = across_forces([fit.curve for fit in fits])
        if not any(found):
            break
        known = [
            each.knowing(mixing=mixing, across=own) for each, own in zip(bases, found, strict=True)
        ]
        again = _with_pairs(known)
        if _misfit(again) > SLACK * _misfit(fits):
            curves = [fit.curve for fit in fits], [fit.curve for fit in again]
            fits = [EditedFit(curve) for curve in contradicted_curves(*curves)]
            break
        judged = settled_curves([fit.curve for fit in again], [fit.curve for fit in fits])
        every = zip(again, judged, strict=True)
        bases, fits = known, [own if own.curve is now else EditedFit(now) for own, now in every]
    if len(bases) == 1:
        bases = [replace(bases[0], fit=fits[0])]
    return bases, fits


def _misfit(fits: Sequence[EditedFit]) -> float:
    return sum(fit.model.misfit for fit in fits)


def _with_pairs(bases: Sequence[Basis]) -> list[EditedFit]:
    """Fits with the pairs that all forces show, or with those of one by itself."""
    if len(bases) == 1:
        return [bases[0].fit]
    return [EditedFit(curve) for curve in joint_curves([each.fit.curve for each in bases])]
