"""The automatic identification, on which edits act: corrections, poles and modes, pass by pass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ema.checks.corrections import (
    Correction,
    channel_edits,
    corrected,
    corrections_by_hand,
    followed_by,
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
from ema.checks.sensor_consistency import ConsistencyCheck, check_consistency, is_better, withheld
from ema.checks.sensor_mass import SensorMass, is_drift_lost, with_mass_std, without_mass
from ema.circumference.orders import on_circle, without_order
from ema.core.edits import Edit, EditKind
from ema.core.errors import FitError, InputError
from ema.core.finding import Finding
from ema.core.frf import FRF
from ema.core.modes import ModalModel
from ema.core.references import References
from ema.core.settings import CheckSettings, IdentificationSettings
from ema.fitting.curve_fit import Wish, pole_named, wishes
from ema.fitting.edited_fit import EditedFit
from ema.fitting.joint_modes import joint_modes
from ema.fitting.joint_orders import joint_curves
from ema.fitting.search import curve_fit
from ema.poles.estimators import widened_band
from ema.poles.stability import PoleSelection, StabilityDiagram, build_stability, select_poles

# A force of wrong sign first, then the sensors, then a look at what is left.
_CONSISTENCY_PASSES = 3
# What a drift does to the compensation of masses is a tenth of it each time.
_DRIFT_PASSES = 2
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
        state = replace(state, mass=asked.sensor_mass)
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
    curves = [each.fit.curve for each in bases]
    if all(each.fit.curve.circle and each.stated_deg is None for each in bases):
        fits = [EditedFit(curve) for curve in joint_curves(curves)[0]]
        return tuple(replace(each, fit=fit) for each, fit in zip(bases, fits, strict=True))
    together = References(tuple(each.frf for each in bases))
    try:
        diagram = bases[0].asked.diagram(together)
        rows, findings = joint_modes(curves, diagram)
    except (FitError, InputError):
        return tuple(bases)
    return tuple(
        replace(
            each,
            diagram=diagram,
            fit=EditedFit(each.fit.curve, one),
            state=each.state.told(findings),
            together=together,
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
        return without_mass(self.usable, self.mass)

    def told(self, findings: Sequence[Finding]) -> State:
        """The same with more findings."""
        new = [each for each in findings if each not in self.findings]
        return replace(self, findings=(*self.findings, *new))

    def after(self, check: ConsistencyCheck) -> State:
        """With the corrections of a check, and its findings."""
        corrections = followed_by(self.measured, self.corrections, check.corrections)
        state = replace(self, usable=check.frf, corrections=corrections)
        return state.told(check.findings)

    def checked(self, model: ModalModel, checks: CheckSettings, **how: bool) -> ConsistencyCheck:
        """Check of the sensors against the modes; rows decided by hand stay as they are."""
        decided = rows_by_hand(self.measured, self.corrections)
        return check_consistency(self.usable, model, settings=checks, decided=decided, **how)


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
        Angles as stated, where others explain the shapes: modes are then fitted at those and
        nothing is said of their orders. As of any structure, the members of pairs would be free at
        all positions, and damping wrong by tens of per cent.
    edits : tuple of Edit
        Of channels, which led here.
    is_preview : bool
        Whether the FRFs were changed without the checks looking at them again.
    shown : EditedFit or None
        With edits.
    crossed : FRF or None
        What the cross-check looked at, where that was not `frf`.
    together : References or None
        What was fitted of all forces, where that was not each by itself.
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
    together: References | None = None

    def is_of(self, edits: Sequence[Edit]) -> bool:
        """Whether the automatic identification is the same with these edits."""
        same = self.asked.shows_mode(self.diagram) or self.asked.wanted == _wanted(edits)
        return same and channel_edits(edits) == self.edits

    @cached_property
    def automatic(self) -> ModalModel:
        """The modes without edits of poles."""
        return self.stated(self.fit.model)

    def stated(self, model: ModalModel) -> ModalModel:
        """The modes of a fit as a result states them."""
        if self.loaded is not None:
            model = with_mass_std(model, self.loaded, self.fit.model)
        if self.stated_deg is None:
            return model
        modes = tuple(without_order(mode, _ANGLES_IN_DOUBT) for mode in model.modes)
        return replace(model, modes=modes, orders=(), position_deg=self.stated_deg)

    def diagram_of(self, method: str | None) -> StabilityDiagram:
        """Stability diagram of the asked method or another one."""
        same = method in (None, self.asked.method)
        return self.diagram if same else self.asked.diagram(self.frf, method)


def _consistent(state: State, asked: Asked, poles: _Poles, positions: PositionCheck) -> Basis:
    """Corrections that make the sensors consistent, FRFs of the bare tyre, and the fit."""
    checks, passes = asked.checks, 0 if positions.hypothesis else _CONSISTENCY_PASSES
    screened, mass, rough = state.usable, state.mass, None
    if mass is not None and passes:
        # Poles as found will do: what the mass does to pairs is not worth sorting out.
        rough = asked.fit(screened, (poles[0], replace(poles[1], pinned=True)))[1].model
        check = state.checked(rough, checks, exclude=False)
        state = state.after(check) if check.changed else state
    fitted = state.fitted
    fit = asked.fit(fitted, poles if fitted is screened else None)
    if mass is not None and rough is not None and is_drift_lost(rough, fit[1].model):
        known = replace(state, mass=replace(mass, drift=rough.drift))
        tried = asked.fit(known.fitted)
        if is_better((fitted, fit[1].model), (known.fitted, tried[1].model)):
            state, fitted, fit = known, known.fitted, tried
    for _ in range(passes):
        check = state.checked(fit[1].model, checks)
        after = state.after(check)
        if check.changed:
            tried = asked.fit(after.fitted)
            if not is_better((fitted, fit[1].model), (after.fitted, tried[1].model)):
                state = state.told([withheld(check)])
                break
            fitted, fit = after.fitted, tried
        state = after
        if not check.changed:
            break
    for _ in range(_DRIFT_PASSES):
        drift = fit[1].settled.drift
        if state.mass is None or not state.mass.loads or not drift.applied:
            break
        state = replace(state, mass=replace(state.mass, drift=drift))
        fitted, fit = state.fitted, asked.fit(state.fitted, (fit[0], asked.selected(fit[0])))
    if positions.unexplained > checks.no_wave_share and not positions.hypothesis:
        share = unexplained_share(fitted, asked.selected(fit[0]), asked.band_hz)
        state = state.told(no_wave_finding(share, checks))
    return Basis(asked, state, fitted, *fit, loaded=rough)
