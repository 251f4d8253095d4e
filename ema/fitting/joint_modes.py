"""Modes of any structure from several forces: from the diagram's poles to settled rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.core.display import counted
from ema.core.errors import FitError
from ema.core.finding import Check, Finding, Verdict
from ema.core.modes import Mode
from ema.core.numerics import one_blas_thread
from ema.core.references import References, driving_point
from ema.core.settings import IdentificationSettings
from ema.fitting.covariance import JointSpread, parameter_covariance, spread_of
from ema.fitting.curve_fit import final_drift
from ema.fitting.driven import Driven
from ema.fitting.evidence import each_once, no_clear_peaks
from ema.fitting.fit_steps import is_undetermined, modes_of
from ema.fitting.joint_poles import JointLines, JointPoint, OfForce
from ema.fitting.listing import Row, Settled
from ema.fitting.order_pair import in_one_state
from ema.fitting.pole_fit import N_STAND_INS, Lines, PoleFit, evaluate
from ema.fitting.search import NO_SHIFT, CurveFit
from ema.fitting.variable_projection import Complex, Real, project
from ema.poles.stability import StabilityDiagram, select_poles

# Rounds in which poles that are no modes are dropped, or joined.
_MOST_DROPS = 12
# Poles of the diagram within this many half-widths are taken from the same model order.
_TOGETHER = 1.0
# A pole that hardly shows is a mode if it explains this many times what is left beyond noise.
_BESIDE = 4.0
# Share of the lines that is left out at one end, to see what the ends of the band do.
_TRIM = 0.06
# Modes no farther apart than this many of their standard deviations are stated with one pole.
_NOT_APART = 2.0
# … and so are those that coincide within this many half-widths, however little the noise.
_ONE_PLACE = 1e-3
# Poles of other bands are in place after few steps, others after some: where two coincide, their
# participations go on until both have one pole.
_FEW, _SOME, _MOST = 3, 6, 60


@one_blas_thread
def joint_modes(
    frfs: References, curves: Sequence[CurveFit], diagram: StabilityDiagram
) -> tuple[JointModes, list[Settled], list[Finding]]:
    """Modes that all forces show together, as each force shows them, and what changed between.

    The first one goes on from there with other poles.

    Parameters
    ----------
    frfs : References
        What the diagram was built of.
    curves : sequence of CurveFit
        Fits against each force by itself, whose lines are without leakage.
    diagram : StabilityDiagram
        Of all forces.

    Raises
    ------
    FitError
        If the diagram shows no mode.
    InputError
        If the forces have no position in common.
    """
    joint = JointModes(frfs, curves, diagram)
    return joint, joint.settled(joint.point), joint.findings(joint.point)


class JointModes:
    """The FRFs of all forces on common lines, and the fits to them."""

    def __init__(
        self, frfs: References, curves: Sequence[CurveFit], diagram: StabilityDiagram
    ) -> None:
        self.frfs, self.curves, self.diagram, first = frfs, tuple(curves), diagram, curves[0]
        self.settings, self.correlation = first.settings, first.correlation
        self.band_hz = first.band_hz
        low = max(curve.fit.lines.frequency_hz[0] for curve in curves)
        high = min(curve.fit.lines.frequency_hz[-1] for curve in curves)
        self.lines = [_cut(_steady(curve), low, high) for curve in curves]
        self.rows = References(tuple(curve.frf for curve in curves)).shared_rows()
        runs = [set(curve.frf.run_names) for curve in curves]
        scales = np.array([ln.scale[rows] for ln, rows in zip(self.lines, self.rows, strict=True)])
        level = np.exp(np.mean(np.log(scales), axis=1))
        self.problem = JointLines(
            [
                OfForce.of(
                    replace(_of_rows(ln, rows), weight=ln.weight * size, scale=np.ones(rows.size)),
                    curve.fit.poles[-N_STAND_INS:],
                    moves=own != runs[0],
                )
                for curve, ln, rows, size, own in zip(
                    curves, self.lines, self.rows, level, runs, strict=True
                )
            ],
            np.exp(np.mean(np.log(scales / level[:, None]), axis=0)),
        )
        self.notes = list[str]()
        self.point = self._with_planes(self._fitted())

    @one_blas_thread
    def going_on(self, added: Sequence[complex], starts: Mapping[int, complex]) -> list[Settled]:
        """Rows of a fit from these poles, of which some start elsewhere, and further ones."""
        other, driven = copy(self), self.point.driven
        other.notes = list(self.notes)
        poles, further = np.append(driven.poles, added), np.array(added, dtype=complex)
        nearest = np.argmin(np.abs(self.diagram.poles - further[:, None]), axis=1)
        for pole, start in starts.items():
            poles[pole] = start
        drive = np.concatenate([driven.participation, self.diagram.participation[nearest]])
        point = self._fit(self.problem, Driven(poles, drive, driven.states), _SOME)
        return other.settled(other._with_planes(point))

    def _fitted(self) -> JointPoint:
        """The fit, after poles that are no modes were dropped."""
        point = self._fit(self.problem, self._start(self.diagram), _SOME)
        for _ in range(_MOST_DROPS):
            if (once := each_once(point)) is not None:
                point = self._fit(self.problem, once, _SOME)
                continue
            (measured, left), worth, driven = point.near(), point.worth(), point.driven
            share = np.sqrt(worth / np.maximum(measured, 1e-300))
            noise = ~(point.chance(self.correlation) < self.settings.residue_p_value)
            # A weak mode is one where the model leaves little beside it.
            hidden = (share < self.settings.visible_share) & (worth < _BESIDE * left)
            doubtful = noise | hidden
            # Of several that share a resonance the lesser one goes first.
            lesser = driven.shared & doubtful & (share[None] < share[:, None])
            drop = doubtful & ~np.any(lesser, axis=1)
            if not np.any(drop) or not np.any(self._is_inside(driven.poles) & ~drop):
                break
            self.notes += [
                f"The pole at {abs(pole) / (2 * np.pi):.2f} Hz was dropped: "
                + ("its residues are as likely noise." if is_noise else "it hardly shows.")
                for pole, is_noise in zip(driven.poles[drop], noise[drop], strict=True)
                if self._is_inside(np.array([pole]))[0]
            ]
            point = self._fit(self.problem, driven.without(drop), _SOME)
        return point

    def _start(self, diagram: StabilityDiagram) -> Driven:
        """Poles of the diagram that the lines show, with the participations of the same order."""
        select_poles(diagram)  # refuses a diagram without modes
        low, high = self.problem.forces[0].lines.frequency_hz[[0, -1]]
        kept = [cluster for cluster in diagram.clusters if cluster.kept]
        width = [-cluster.pole.real / (2 * np.pi) for cluster in kept]
        chosen = [
            cluster
            for cluster, reach in zip(kept, width, strict=True)
            if self._is_inside(np.array([cluster.pole]))[0]
            or (cluster.frequency_hz - low > reach and high - cluster.frequency_hz > reach)
        ]
        if not any(self._is_inside(np.array([cluster.pole]))[0] for cluster in chosen):
            raise FitError("no pole of several forces lies in the band. Change the band.")
        orders = {
            cluster.label: set(diagram.model_order[diagram.cluster == cluster.label].tolist())
            for cluster in chosen
        }
        drives = []
        for cluster in chosen:
            beside = [
                orders[other.label]
                for other in chosen
                if abs(other.pole - cluster.pole) < -_TOGETHER * cluster.pole.real
            ]
            common = set.intersection(*beside) or orders[cluster.label]
            own = (diagram.cluster == cluster.label) & (diagram.model_order == max(common))
            drives.append(diagram.participation[np.flatnonzero(own)[0]])
        poles = np.array([cluster.pole for cluster in chosen])
        return Driven(poles, np.array(drives), np.zeros((len(self.curves), 2)))

    def _is_inside(self, poles: Complex) -> NDArray[np.bool_]:
        frequency_hz = np.abs(poles) / (2 * np.pi)
        return (frequency_hz >= self.band_hz[0]) & (frequency_hz <= self.band_hz[1])

    def _fit(self, problem: JointLines, start: Driven, tries: int = _MOST) -> JointPoint:
        return problem.fit(start, *_bounds(start.poles, self.settings), tries)

    def band_shift(self, point: JointPoint) -> Real:
        """Largest change of frequency in Hz and damping ratio where the band loses an end."""
        frequency_hz = self.problem.forces[0].lines.frequency_hz
        cut = int(_TRIM * frequency_hz.size)
        ends = (frequency_hz[cut], frequency_hz[-1]), (frequency_hz[0], frequency_hz[-1 - cut])
        before, shifts = point.driven.numbers, []
        for low, high in ends:
            width = -point.driven.poles.real / (2 * np.pi)
            inside = (before[:, 0] - low > width) & (high - before[:, 0] > width)
            shift = np.full(before.shape, np.nan)
            if np.any(inside):
                forces = [
                    OfForce.of(_cut(each.lines, low, high), each.own.poles, each.moves)
                    for each in self.problem.forces
                ]
                cut_lines = JointLines(forces, self.problem.scale)
                again = self._fit(cut_lines, point.driven.without(~inside), _FEW)
                shift[inside] = np.abs(again.driven.numbers - before[inside])
            shifts.append(shift)
        known = np.isfinite(shifts)
        largest = np.max(np.where(known, shifts, 0.0), axis=0)
        return np.asarray(np.where(known.any(axis=0), largest, np.nan))

    def _with_planes(self, point: JointPoint) -> JointPoint:
        """The fit with one pole for modes no farther apart than their ±.

        The plane of both shapes is determined then, and no shape in it before another.
        """
        driven, every, n_poles = self._in_planes(point), np.arange(point.driven.poles.size), 0
        while driven.planes[0].size != n_poles:  # others may not have been in their place
            n_poles, found = driven.planes[0].size, self._fit(self.problem, driven).driven
            free = np.ones(found.participation.shape, dtype=bool)
            free[every, np.argmax(np.abs(found.participation), axis=1)] = False
            point = JointPoint(self.problem, found, free, every)
            driven = self._in_planes(point)
        poles, sizes = np.unique(point.driven.poles, return_counts=True)
        self.notes += [
            f"{counted(size, 'mode')} at {abs(pole) / (2 * np.pi):.2f} Hz have one pole, apart by "
            "no more than their ±: the plane of their shapes is determined, not each shape in it."
            for pole, size in zip(poles, sizes.tolist(), strict=True)
            if size > 1
        ]
        return point

    def _in_planes(self, point: JointPoint) -> Driven:
        """With one pole, and participations in real shapes, for modes that the ± do not tell."""
        driven, (hz, ratio) = point.driven, point.driven.numbers.T
        if not np.any(np.triu(driven.shared, 1)):
            return driven
        std = np.sqrt(np.diag(spread_of(point, self.correlation).covariance)).reshape(-1, 2)
        apart = np.abs(driven.numbers[:, None] - driven.numbers)
        width = np.column_stack([ratio * hz, ratio])
        reach = np.maximum(_NOT_APART * np.hypot(std[:, None], std), _ONE_PLACE * width)
        same = driven.shared & np.all(apart <= reach, axis=2)
        poles, participation = driven.poles.copy(), driven.participation.copy()
        rest = set(range(poles.size))
        for k in range(poles.size):
            group = sorted(rest.intersection(np.flatnonzero(same[k]).tolist())) if k in rest else []
            if len(group) < 2:
                continue
            rest -= set(group)
            poles[group] = poles[group].mean()
            both = point.shapes[:, group] @ driven.participation[group]
            both *= np.exp(-0.5j * np.angle(np.sum(both**2)))
            shapes = np.linalg.svd(both.real)[0][:, : len(group)]
            shapes = shapes @ self._mass_axes(shapes, both)
            participation[group] = np.linalg.pinv(shapes) @ both
        return Driven(poles, participation, driven.states)

    def _mass_axes(self, shapes: Real, residues: Complex) -> Real:
        """Turns real shapes of one plane so that their masses do not couple, as far as known.

        Of the symmetric matrix Q in residues = Φ Q Φᵀ, which the driving points show.
        """
        places = [self._driving_point(force) for force in range(len(self.curves))]
        known = [force for force, place in enumerate(places) if place is not None]
        if len(known) < shapes.shape[1]:
            return np.eye(shapes.shape[1])
        there = np.array([sign * shapes[row] for row, sign in filter(None, places)])
        inner = np.linalg.pinv(shapes) @ residues[:, known] @ np.linalg.pinv(there.T)
        turned = inner * np.exp(-0.5j * np.angle(np.sum(inner**2)))
        return np.asarray(np.linalg.eigh((turned.real + turned.real.T) / 2)[1])

    def _driving_point(self, force: int) -> tuple[int, int] | None:
        """Row at the force among those of all forces, and the sign of its direction."""
        place = driving_point(self.curves[force].frf)
        if place is None or place[0] not in self.rows[force]:
            return None
        return int(np.flatnonzero(self.rows[force] == place[0])[0]), place[1]

    def settled(self, point: JointPoint) -> list[Settled]:
        """What each force shows."""
        order = np.argsort(np.abs(point.driven.poles))
        spread, shifts = spread_of(point, self.correlation), self.band_shift(point)
        std = np.sqrt(np.diag(spread.covariance)).reshape(-1, 2)
        more = np.maximum(spread.waves**2 - std**2, 0.0)
        more += spread.forces**2 + np.nan_to_num(shifts) ** 2
        std = np.sqrt(std**2 + more)
        where = np.ravel([(2 * k, 2 * k + 1) for k in order])
        covariance = (spread.covariance + np.diag(more.ravel()))[np.ix_(where, where)]
        doubts, flags = self._doubts(point, std, shifts), no_clear_peaks(point)
        unknown, found = np.zeros((2 * N_STAND_INS, 2 * N_STAND_INS)), list[Settled]()
        for r, curve in enumerate(self.curves):
            fit, residues_std = self._pole_fit(point, spread, r)
            modes = [
                replace(
                    mode,
                    frequency_std_hz=float(std[k, 0]),
                    damping_std=float(std[k, 1]),
                    residues_std=residues_std[:, k],
                    flags=flags[k],
                    frequency_band_shift_hz=float(shifts[k, 0]),
                    damping_band_shift=float(shifts[k, 1]),
                )
                for k, mode in enumerate(modes_of(fit)[:-N_STAND_INS])
            ]
            inside = self._is_inside(fit.poles)
            stand_ins = enumerate(modes_of(fit)[-N_STAND_INS:], start=len(modes))
            rows = [Row(modes[k], (int(k), 0), bool(inside[k]), doubts[k]) for k in order]
            rows += [Row(mode, (k, 0), False, "") for k, mode in stand_ins]
            alone = parameter_covariance(curve.fit, self.correlation)
            found.append(
                Settled(
                    frf=curve.frf,
                    fit=fit,
                    band_hz=self.band_hz,
                    rows=tuple(rows),
                    covariance=scipy.linalg.block_diag(covariance, unknown),
                    ring=(),
                    drift=final_drift(curve, curve.fit, alone),
                    values=_cut(curve.fit.lines, *fit.lines.frequency_hz[[0, -1]]).values,
                    misfit=point.reduced if np.all(np.isfinite(curve.frf.std)) else float("nan"),
                    notes=(*curve.leakage_notes, *self.notes),
                    locked=frozenset(),
                )
            )
        return found

    def _pole_fit(self, point: JointPoint, spread: JointSpread, force: int) -> tuple[PoleFit, Real]:
        """A force's FRFs at all of its positions, with the ± of the residues of the modes."""
        lines, driven = self.lines[force], point.driven
        shapes, std = self._shapes(point, force)
        drive = driven.participation[:, force]
        residues = shapes * drive
        spread_of_drive = np.abs(shapes) * spread.participation[:, force]
        residues_std = np.hypot(std * np.abs(drive), spread_of_drive)
        poles, stand_ins = driven.at(force), self.curves[force].fit.poles[-N_STAND_INS:]
        waves = driven.waves(lines, force)
        parts = np.stack([shapes.real, shapes.imag], axis=2).reshape(len(shapes), -1)
        rest = project(lines.omega, lines.target - waves @ parts.T, lines.weight, stand_ins)
        fit = evaluate(lines, np.append(poles, stand_ins), NO_SHIFT)
        part = replace(
            fit.parts[0],
            residues=np.concatenate([residues, rest.residues], axis=1),
            lower=rest.lower,
            upper=rest.upper,
        )
        return replace(fit, parts=(part,)), residues_std

    def _shapes(self, point: JointPoint, force: int) -> tuple[Complex, Real]:
        """Shapes at all positions of a force, and the ± that they have from noise alone.

        Positions that other forces lack have the shapes that this one shows.
        """
        lines = self.lines[force]
        missing = np.setdiff1d(np.arange(lines.scale.size), self.rows[force])
        shapes = np.zeros((lines.scale.size, point.driven.poles.size), dtype=complex)
        std = np.zeros(shapes.shape)
        noise = np.sqrt(np.mean(point.misfit**2, axis=0))
        shapes[self.rows[force]] = point.shapes
        std[self.rows[force]] = noise[:, None] * _std_of_parts(point.unscaled, self.correlation)
        if missing.size:
            of = OfForce.of(
                _of_rows(lines, missing), self.curves[force].fit.poles[-N_STAND_INS:], moves=False
            )
            waves = of.alone(point.driven.waves(of.lines, force))
            inverse = np.linalg.pinv(waves, rcond=1e-9)
            linear = inverse @ of.target
            left = np.sqrt(np.mean((of.target - waves @ linear) ** 2, axis=0))
            shapes[missing] = (linear[0::2] + 1j * linear[1::2]).T
            std[missing] = left[:, None] * _std_of_parts(inverse @ inverse.T, self.correlation)
        return shapes, std

    def _doubts(self, point: JointPoint, std: Real, shifts: Real) -> list[str]:
        """Why modes are not listed; empty where they are, and for all if none would be."""
        _, left = point.near()
        worth, numbers, doubts = point.worth(), point.driven.numbers, list[str]()
        inside = self._is_inside(point.driven.poles)
        for k, (hz, ratio) in enumerate(std):
            shown = Mode(
                complex(point.driven.poles[k]),
                float(hz),
                float(ratio),
                point.shapes[:, k],
                np.zeros(len(point.shapes)),
                frequency_band_shift_hz=float(shifts[k, 0]),
            )
            if is_undetermined(shown, False, self.settings):
                doubts.append(f"it is not determined (± {hz:.2g} Hz of {numbers[k, 0]:.4g} Hz)")
            elif worth[k] < left[k]:
                doubts.append("the model leaves more at its resonance than it adds")
            else:
                doubts.append("")
        listed = any(not doubt for doubt, own in zip(doubts, inside, strict=True) if own)
        return doubts if listed else [""] * len(doubts)

    def findings(self, point: JointPoint) -> list[Finding]:
        """What the structure's state has changed from force to force."""
        found = []
        for r in self.problem.moving:
            shift, decay = 100 * point.driven.states[r]
            detail = (
                f"at force {r + 1} all frequencies are {shift:+.3f} % and decay rates "
                f"{shift + decay:+.1f} % of those at the first force; each is fitted in its state"
            )
            found.append(Finding("", "", None, Check.FORCES, Verdict.OK, detail))
        return found


def _steady(curve: CurveFit) -> Lines:
    """Lines of a fit, without leakage, all runs in the state of the first one."""
    fit = curve.fit
    if len(fit.drift) == 1:
        return fit.lines
    return replace(fit.lines, values=in_one_state(fit, fit.poles))


def _cut(lines: Lines, low_hz: float, high_hz: float) -> Lines:
    kept = (lines.frequency_hz >= low_hz) & (lines.frequency_hz <= high_hz)
    return replace(
        lines,
        frequency_hz=lines.frequency_hz[kept],
        values=lines.values[:, kept],
        weight=lines.weight[kept],
        importance=lines.importance[kept],
    )


def _of_rows(lines: Lines, rows: NDArray[np.int_]) -> Lines:
    return replace(lines, values=lines.values[rows], scale=lines.scale[rows], run=lines.run[rows])


def _bounds(poles: Complex, settings: IdentificationSettings) -> tuple[Real, Real]:
    """Bounds of (decay rate, frequency), mode by mode in rad/s."""
    decay, frequency = -poles.real, poles.imag
    reach = np.maximum(settings.frequency_reach * frequency, decay)
    factor = settings.damping_reach
    lower = np.column_stack([decay / factor, np.maximum(frequency - reach, 0.1 * frequency)])
    upper = np.column_stack([decay * factor, frequency + reach])
    return lower.ravel(), upper.ravel()


def _std_of_parts(unscaled: Real, correlation: float) -> Real:
    """RMS standard deviation of real and imaginary part at unit noise, (n_modes,)."""
    return np.asarray(np.sqrt(correlation * np.diag(unscaled).reshape(-1, 2).mean(axis=1)))
