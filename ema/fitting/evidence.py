"""What speaks for a pole: its residues, its share of the response, and how far it stays in place.

The residuals of a measured structure are not white: a resonance that is no exact one, or sensors
that saw it in slightly different states, leave waves that further poles would follow. Statistics of
the residuals cannot tell these from modes. Their size can, and fits to parts of the data.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.circumference.orders import PURE, family, on_circle, order_content
from ema.core.mac import auto_mac, mpc
from ema.core.modes import Flag, Mode
from ema.fitting.covariance import parameter_covariance, residue_std, std_of_waves
from ema.fitting.driven import Driven
from ema.fitting.joint_poles import JointPoint
from ema.fitting.pole_fit import N_DRIFT, N_STAND_INS, Lines, PoleFit, evaluate
from ema.fitting.variable_projection import Complex, Real

Refit = Callable[[Lines, Complex], PoleFit]
Matrix = NDArray[np.bool_]

# Parts of the positions that are left out one after the other.
_PARTS = 3
# … unless one has this share of a pole's power: two FRFs of a spindle, each with modes of its own.
_NEARLY_ALL = 0.9
# Lines within this many half-widths belong to a resonance.
_RESONANCE = 2.0
# A jackknife variance of three parts is larger by this factor once in twenty (χ², 2 d.o.f.).
_BEYOND_CHANCE = 3.0
# A broad pole beneath a sharper one has to show this many times more than others …
_DOUBTFUL = 2.5
# … and one whose positions move less in phase than this (MPC) this many times more.
_IN_PHASE, _UNLIKELY = 0.5, 5.0

# Measured: peaks of a wheel and a ruler have 3.7 or more, their humps up to 1.7.
_STANDS_OUT = 2.0
# Further rounds change nothing.
_ROUNDS = 2
# First order holds for changes up to this many half-widths, and this share of the frequency:
# beyond it, a pole damped critically would change to the other half-plane.
_FIRST_ORDER = 0.5
# Scatter that noise explains once in twenty is no more than noise.
_CHANCE = 0.05
# How far the poles of single positions are apart, in half-widths (1 σ): wheel, ruler, half a tyre.
_USUAL = 0.1
# Two poles in one resonance are one mode if their shapes have this MAC, and a second shape has
# less than this share of their residues.
_ALIKE, _ONE_SHAPE = 0.9, 0.1
# Poles closer than this share of their half-width are one at first …
_CLOSE = 0.5
# … and closer than this where runs have states of their own, which two poles explain instead.
_CLOSE_IN_RUNS = 1.0
# Without a circle that could tell their orders, poles closer than this are one at first …
_SAME = 0.15
# … if their residues together have this share of their power in one order, or this MAC.
_ONE_ORDER = 0.8


def scatter_over_positions(fit: PoleFit, refit: Refit) -> Real:
    """Jackknife standard deviations of frequencies in Hz and of damping ratios, (n_modes, 2).

    From three fits that leave out a third of the positions each (Efron & Stein 1981); 0 for one
    position. A part that has nearly all of a pole does not count for it: what is left without it
    does not show the pole. `refit` fits lines from start poles; poles above the lines are not
    compared.
    """
    lines, poles = fit.lines, fit.poles[:-N_STAND_INS]
    n_parts = min(_PARTS, lines.scale.size)
    std = np.zeros((fit.poles.size, 2))
    if n_parts < 2:
        return std
    part = np.arange(lines.scale.size) % n_parts
    without = [refit(_of_rows(lines, part != k), poles).poles for k in range(n_parts)]
    found = np.stack(without)[:, :-N_STAND_INS]
    numbers = np.stack([np.abs(found) / (2 * np.pi), -found.real / np.abs(found)], axis=2)
    power = np.abs(fit.residues[:, :-N_STAND_INS]) ** 2
    share = np.stack([power[part == k].sum(axis=0) for k in range(n_parts)]) / power.sum(axis=0)
    counts = np.broadcast_to((share < _NEARLY_ALL)[:, :, None], numbers.shape)
    std[:-N_STAND_INS] = np.sqrt((n_parts - 1) * np.var(numbers, axis=0, where=counts))
    return std


def _of_rows(lines: Lines, rows: Matrix) -> Lines:
    return replace(lines, values=lines.values[rows], scale=lines.scale[rows], run=lines.run[rows])


def with_model_error(
    modes: Sequence[Mode], covariance: Real, fit: PoleFit, scatter: Real
) -> tuple[list[Mode], Real]:
    """Modes of all poles whose ± contain the model's errors, and their covariance.

    Residuals count as waves where they are, positions where they scatter by more than the residuals
    explain (`scatter`, of `scatter_over_positions`), and the ends of the band by what they do to a
    pole. Modes that do not stand out are flagged.
    """
    own = np.array([(mode.frequency_std_hz, mode.damping_std) for mode in modes])
    shift = np.array([(m.frequency_band_shift_hz, m.damping_band_shift) for m in modes])
    std = np.fmax(own, std_of_waves(fit))
    std = np.where(scatter**2 > _BEYOND_CHANCE * std**2, scatter, std)
    whole = np.hypot(std, np.nan_to_num(shift))
    flags = [() if seen else (Flag.NO_CLEAR_PEAK,) for seen in stands_out(fit)]
    grown = [
        replace(mode, frequency_std_hz=hz, damping_std=ratio, flags=(*flag, *mode.flags))
        for mode, flag, (hz, ratio) in zip(modes, flags, whole.tolist(), strict=True)
    ]
    return grown, covariance + np.diag(np.ravel(whole**2 - own**2))


def visible_share(fit: PoleFit) -> Real:
    """What would be missing without each pole, over the structure's response at its resonance.

    RMS over positions and the lines of the resonance. A pole that shares the resonance of a
    stronger one would be joined with it: residues of two poles so close may be of any size.
    """
    omega, poles = fit.lines.omega, fit.poles
    strength = peak_response(fit)
    beside = share_resonance(poles) & (strength[:, None] < strength)
    share = np.empty(poles.size)
    for k, pole in enumerate(poles):
        near = _near(pole, omega)
        missing = _response(omega[near], poles[k], fit.residues[:, k])
        if np.any(beside[k]):
            other = int(np.argmax(np.where(beside[k], strength, 0.0)))
            both = fit.residues[:, k] + fit.residues[:, other]
            joined = np.vdot(both, fit.residues[:, [k, other]] @ poles[[k, other]])
            missing += _response(omega[near], poles[other], fit.residues[:, other])
            missing -= _response(omega[near], complex(joined / np.vdot(both, both)), both)
        share[k] = np.linalg.norm(missing) / np.linalg.norm(fit.lines.values[:, near])
    return share


def stands_out(fit: PoleFit) -> Matrix:
    """Whether each pole adds twice what all others have at its resonance, RMS over positions.

    Others are humps on the flanks of their neighbours: a mode may be the cause, or several.
    """
    omega = fit.lines.omega
    every = zip(fit.poles, fit.residues.T, strict=True)
    each = np.array([_response(omega, pole, residues) for pole, residues in every])
    whole = each.sum(axis=0) + fit.lower[:, None] - np.outer(fit.upper, omega**2)
    at = np.argmin(np.abs(fit.poles.imag[:, None] - omega), axis=1)
    own, rest = (
        [np.linalg.norm(values[:, line]) for values, line in zip(parts, at, strict=True)]
        for parts in (each, whole - each)
    )
    return np.asarray(np.array(own) > _STANDS_OUT * np.array(rest))


def is_below_misfit(fit: PoleFit) -> Matrix:
    """Whether the model leaves more at a pole's resonance, beyond noise, than the pole adds."""
    lines = fit.lines
    left = np.empty(lines.values.shape)
    for part, rows in zip(fit.parts, fit.groups, strict=True):
        real, imag = np.split(part.misfit.T, 2, axis=1)
        left[rows] = real**2 + imag**2
    left -= 2 * (lines.importance / lines.scale[:, None]) ** 2
    below = np.zeros(fit.poles.size, dtype=bool)
    for k, pole in enumerate(fit.poles):
        near = _near(pole, lines.omega)
        own = _response(lines.omega[near], pole, fit.residues[:, k]) * lines.weight[near]
        below[k] = np.sum(np.abs(own) ** 2) < np.sum(left[:, near])
    return below


def peak_response(fit: PoleFit) -> Real:
    """Response of each pole at its resonance, up to a factor; norm over the positions."""
    return np.asarray(np.linalg.norm(fit.residues, axis=0) / -fit.poles.real)


def is_hidden(fit: PoleFit, least: float) -> Matrix:
    """Whether a pole's share of the response is below the least one; more if it is beneath."""
    return visible_share(fit) < np.where(is_beneath(fit), _DOUBTFUL, 1.0) * least


def is_no_mode(fit: PoleFit, least: float) -> Matrix:
    """Poles that the others need, and that are no modes by themselves.

    The model leaves more at their resonance than they add, or they hardly show and their positions
    do not move in phase.
    """
    out_of_phase = np.array([mpc(shape) < _IN_PHASE for shape in fit.residues.T])
    return is_below_misfit(fit) | (out_of_phase & (visible_share(fit) < _UNLIKELY * least))


def is_beneath(fit: PoleFit) -> NDArray[np.bool_]:
    """Whether a resonance with a higher peak lies within the half-width of a pole's own.

    Such a broad pole follows the flanks of the other as readily as a mode of its own.
    """
    poles, strength = fit.poles, peak_response(fit)
    within = np.abs(poles.imag[:, None] - poles.imag) < -poles.real[:, None]
    stronger = strength[:, None] < strength
    return np.asarray(np.any(within & stronger & ~share_resonance(poles), axis=1))


def _near(pole: complex, omega: Real) -> Matrix:
    """Lines of a pole's resonance, at least one."""
    distance = np.abs(1j * omega - pole)
    return np.asarray(distance <= max(_RESONANCE * -pole.real, float(distance.min())))


def _response(omega: Real, pole: complex, residues: Complex) -> Complex:
    """Inertances of one mode, (n_positions, n_frequencies)."""
    direct, mirrored = 1 / (1j * omega - pole), 1 / (1j * omega - np.conj(pole))
    return -(omega**2) * (np.outer(residues, direct) + np.outer(residues.conj(), mirrored))


def residue_size(fit: PoleFit, correlation: float) -> Real:
    """Residues of each pole over their standard deviations, squared and summed over positions.

    What is uncertain about a pole moves its residues at all positions together. Where two poles
    share a resonance this says nothing about whether both are there: they are judged at the poles
    found.
    """
    covariance = parameter_covariance(fit, correlation)
    alone = residue_std(fit, covariance, correlation)
    beside = residue_std(fit, np.zeros_like(covariance), correlation)
    std = np.where(np.any(share_resonance(fit.poles), axis=1), beside, alone)
    return np.asarray(np.sum(np.abs(fit.residues) ** 2 / std**2, axis=0))


def within_noise(fit: PoleFit, correlation: float, limit: float) -> tuple[Matrix, Real]:
    """Poles whose residues noise may make with a probability above a limit, and `residue_size`."""
    size = residue_size(fit, correlation)
    return np.asarray(~(scipy.special.chdtrc(2 * fit.lines.scale.size, size) < limit)), size


def share_resonance(poles: Complex, reach: float = 1.0) -> Matrix:
    """Which poles lie within `reach` half-widths of each other's resonance, (n_poles, n_poles)."""
    near = np.abs(poles[:, None] - poles) < reach * np.minimum.outer(-poles.real, -poles.real)
    return np.asarray(near & ~np.eye(poles.size, dtype=bool))


@dataclass(frozen=True, eq=False)
class _OwnPoles:
    """How far the poles of each position are from those of a fit, (n_positions, n_modes) each."""

    change: Complex  # rad/s
    variance: Real  # of its real and of its imaginary part, from noise
    residues: Complex

    @property
    def weight(self) -> Real:
        """Share of each position in the mean."""
        power = np.abs(self.residues) ** 2
        return np.asarray(power / power.sum(axis=0))

    @property
    def mean(self) -> Complex:
        """Mean change, (n_modes,)."""
        return np.asarray(np.sum(self.weight * self.change, axis=0))


def at_mean_of_positions(fit: PoleFit) -> PoleFit:
    """The fit at the mean poles of all positions."""
    for _ in range(_ROUNDS if len(fit.residues) > 1 else 0):
        step = _own_poles(fit, 1.0).mean
        step[np.abs(step) > _FIRST_ORDER * np.minimum(-fit.poles.real, fit.poles.imag)] = 0
        step[list(fit.locked)] = 0
        again = evaluate(fit.lines, fit.poles + step, fit.drift, fit.pairs, fit.locked)
        fit = replace(again, at_bound=fit.at_bound)
    return fit


def std_over_positions(fit: PoleFit, correlation: float) -> Real:
    """Standard deviations of mean frequencies in Hz and damping ratios, (n_modes, 2).

    From how far the positions' own poles scatter around the mean, where that is beyond noise; of
    few positions the 95 % interval is that of Student's t. `correlation` is that of
    `line_correlation`.
    """
    freedom = len(fit.residues) - 1
    if not freedom:
        return np.zeros((fit.poles.size, 2))
    own = _own_poles(fit, correlation)
    off, size = own.change - own.mean, np.abs(fit.poles)
    along = (fit.poles.conj() * off).real / size
    damping = (fit.poles.real / size * along - off.real) / size
    scatter = np.stack([np.sum((own.weight * each) ** 2, axis=0) for each in (along, damping)])
    noise = np.sum(own.weight**2 * own.variance, axis=0) / np.stack([np.ones_like(size), size**2])
    scatter *= (freedom + 1) / freedom
    beyond = scatter > noise * scipy.special.chdtri(freedom, _CHANCE) / freedom
    few = scipy.special.stdtrit(freedom, 1 - _CHANCE / 2) / scipy.special.ndtri(1 - _CHANCE / 2)
    std = few * np.sqrt(np.where(beyond, scatter - noise, 0.0)).T
    return np.asarray(std / (2 * np.pi, 1))


def _own_poles(fit: PoleFit, correlation: float) -> _OwnPoles:
    """Poles of the positions; no change for stand-ins and in the resonance of a stronger pole.

    What there is of either would follow the other. Changes that the residuals hide are likely
    small (ridge regression).
    """
    strength = peak_response(fit)
    beside = np.any(share_resonance(fit.poles) & (strength[:, None] < strength), axis=1)
    beside[-N_STAND_INS:] = True
    own = np.flatnonzero(~beside)
    columns = np.ravel(np.column_stack([2 * own, 2 * own + 1]))
    usual = _USUAL * -fit.poles.real * np.sqrt(np.mean(np.abs(fit.residues) ** 2, axis=0))
    expected = np.diag(np.repeat(usual[own], 2) ** -2)
    change, residues = np.zeros((2, *fit.residues.shape), dtype=complex)
    variance = np.zeros(fit.residues.shape)
    for part, rows in zip(fit.parts, fit.groups, strict=True):
        slopes, noise = part.slopes[:, columns], np.mean(part.misfit**2, axis=0)
        normal, towards = slopes.T @ slopes, slopes.T @ part.target
        inverse = np.linalg.inv(normal + noise[:, None, None] * expected)
        second = np.einsum("ikl,li->ki", inverse, towards)
        given = part.following[:-2, columns] @ second
        residues[rows] = part.residues - (given[0::2] + 1j * given[1::2]).T
        at = np.ix_(rows, own)
        change[at] = (second[0::2] + 1j * second[1::2]).T / residues[at]
        left = np.mean((part.misfit - slopes @ second) ** 2, axis=0)
        known = np.diagonal(inverse, axis1=1, axis2=2) * correlation * left[:, None]
        variance[at] = (known[:, 0::2] + known[:, 1::2]) / 2 / np.abs(residues[at]) ** 2
    return _OwnPoles(change, variance, residues)


def no_clear_peaks(point: JointPoint) -> list[tuple[Flag, ...]]:
    """Modes that do not stand out, each with the combination of forces that drives it best.

    Beside it are all others but those that share its resonance.
    """
    driven, lines = point.driven, [each.lines for each in point.problem.forces]
    parts, omega = np.stack([point.shapes.real, point.shapes.imag], axis=2), lines[0].omega
    waves = list[Complex]()
    for r, own_lines in enumerate(lines):
        real, imag = np.split(driven.waves(own_lines, r).T / np.tile(own_lines.weight, 2), 2, 1)
        waves.append((real + 1j * imag).reshape(driven.poles.size, 2, -1))
    flags = list[tuple[Flag, ...]]()
    for k, line in enumerate(np.argmin(np.abs(driven.poles.imag[:, None] - omega), axis=1)):
        at = np.stack([each[:, :, line] for each in waves], axis=2)
        own = parts[:, k] @ at[k]
        beside = np.stack([each.values[:, line] for each in lines], axis=1)
        for other in np.flatnonzero(driven.shared[k]):
            beside = beside - parts[:, other] @ at[other]
        size, drive = np.linalg.norm(own), np.linalg.svd(own)[2][0]
        rest = np.linalg.svd(beside, full_matrices=False)
        best = np.linalg.norm((rest[2] @ drive.conj()) / np.maximum(rest[1], 1e-12 * size))
        flags.append(() if size * best > _STANDS_OUT else (Flag.NO_CLEAR_PEAK,))
    return flags


def each_once(point: JointPoint) -> Driven | None:
    """Poles with one in the place of two that share a resonance and one shape; None where none do.

    Whatever loads the structure at a force moves the mode as this force sees it: that is no second
    mode. Two modes differ in shape, or coincide and then have a plane of shapes.
    """
    driven, shapes = point.driven, point.shapes
    alike = driven.shared & (auto_mac(shapes.T) > _ALIKE)
    for one, other in zip(*np.nonzero(np.triu(alike, 1)), strict=True):
        group = [int(one), int(other)]
        residues = shapes[:, group] @ driven.participation[group]
        sizes, drives = np.linalg.svd(residues, full_matrices=False)[1:]
        if sizes[1] > _ONE_SHAPE * sizes[0]:
            continue
        weight = np.sum(np.abs(shapes[:, group]) ** 2, axis=0)
        weight *= np.sum(np.abs(driven.participation[group]) ** 2, axis=1)
        poles, participation = driven.poles.copy(), driven.participation.copy()
        poles[one] = np.average(driven.poles[group], weights=weight)
        participation[one] = drives[0]
        rest = np.delete(poles, other), np.delete(participation, other, axis=0)
        return Driven(*rest, driven.states)
    return None


def surplus_poles(
    labelled: Sequence[Mode], fit: PoleFit, in_runs: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Poles that only improve the fit of others; `in_runs` may follow the states of the runs.

    They end on a bound of their damping, or lie within the resonance of a mode of the ring and
    have its order or none: what an order's second mode is comes from the order's own FRFs.
    """
    surplus = np.zeros(fit.poles.size, dtype=bool)
    members = family(labelled)
    main = {found[0] for found in members.values()}
    bound = fit.at_bound[0 : 2 * len(labelled) : 2]
    reach = np.where(in_runs, _CLOSE_IN_RUNS, _CLOSE)
    for k, mode in enumerate(labelled):
        if k in main:
            continue
        near = [
            o
            for o in main
            if abs(labelled[o].frequency_hz - mode.frequency_hz)
            < reach[o] * labelled[o].damping_ratio * labelled[o].frequency_hz
        ]
        same = any(mode.order == labelled[o].order or mode.order_purity < PURE for o in near)
        surplus[k] = bound[k] or same
    return surplus


def merged(
    lines: Lines, poles: NDArray[np.complex128], position_deg: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Poles with one in the place of several that share the resonance of one order.

    With free residues at all positions, two poles closer than their width explain each run's
    own frequency and damping, whatever the cause. What a pair is comes from its order's FRFs.
    """
    fit = evaluate(lines, poles, np.zeros((1, N_DRIFT)))
    rest = list(np.argsort(np.abs(poles[:-N_STAND_INS])))
    chosen: list[complex] = []
    while rest:
        group = [rest.pop(0)]
        while rest and _is_close(poles[group[-1]], poles[rest[0]]):
            group.append(rest.pop(0))
        one = len(group) > 1 and _look_alike(poles[group], fit.residues[:, group], position_deg)
        chosen += [complex(np.mean(poles[group]))] if one else poles[group].tolist()
    return np.append(chosen, poles[-N_STAND_INS:])


def _look_alike(
    poles: NDArray[np.complex128],
    residues: NDArray[np.complex128],
    position_deg: NDArray[np.float64],
) -> bool:
    """Whether close poles share one order, or, without a circle, one shape."""
    if on_circle(position_deg):
        return order_content(residues.sum(axis=1), position_deg).purity > _ONE_ORDER
    apart = np.ptp(np.abs(poles)) / np.min(-poles.real)
    return bool(apart < _SAME or np.min(auto_mac(residues.T)) > _ONE_ORDER)


def _is_close(one: complex, other: complex) -> bool:
    """Whether two poles lie within half the half-width of each other's resonance."""
    return bool(abs(one - other) < _CLOSE * min(-one.real, -other.real))
