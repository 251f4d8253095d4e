"""Steps of a curve fit: leakage compensated, modes with their uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema.circumference.orders import family, label_modes, on_circle, order_basis, order_content
from ema.core.drift import Drift
from ema.core.frf import FRF
from ema.core.modes import Flag, Mode
from ema.core.settings import IdentificationSettings
from ema.fitting.evidence import std_over_positions
from ema.fitting.order_pair import RingOrder
from ema.fitting.pair import PairFit
from ema.fitting.pole_fit import N_STAND_INS, Lines, PoleFit, evaluate, fit_bounded
from ema.fitting.variable_projection import Complex, Real
from ema.signals.leakage import bias_as_before, has_leakage, leakage_bias, leakage_of

# A correction for random excitation that fits worse than this shows that it was not random.
_WORSE = 1.05
_LEAKAGE_ROUNDS = 2
# A pole that moved by less than this share of its half-width has the bias that it had.
_STAYED = 1e-3
# No ± of a ring mode is below these shares of frequency and damping: benchmarks/accuracy.py.
_FLOOR = np.array([1e-5, 2e-4])
# What an uneven tyre mixes into a mode from other orders, an amplitude, moves the members of its
# pair by this share of it, in half-widths and in damping ratios: benchmarks/laboratory.py.
_MIXED = np.array([0.055, 0.03])
# The same where several forces drive both members: benchmarks/references.py, "lab".
_MIXED_JOINTLY = 0.02
# The same for the mean of a pair, by the share of the power in other orders.
_IMPURE = np.array([0.3, 0.6])
# Standard deviation of the share that each member of a pair has: of an unresolved one as the random
# campaigns of benchmarks/laboratory.py ask, of an unseen one where any share is as likely.
_SHARE_STD, _ANY_SHARE_STD = 0.21, 0.3
# How much of what is not known of the stronger one is in its mean's frequency and damping.
_OF_STRONGER = np.array([0.25, 0.5])
# Error of a pole beside the ring along the imaginary axis over that across it, at least; noise has
# 1. A row with less was off by 8 σ in benchmarks/laboratory.py.
_DIRECTED = 0.5
# Imaginary over real part of such a share.
_COMPLEX = 0.5
# Of members within a half-width, of which one is seen, the other bends its peak by their distance
# times its amplitude; this share of it is not known: benchmarks/laboratory.py.
_BENT = np.array([0.12, 0.17])
# The member that shows lies this much of the way to the mean of both (1 σ): 95 of 100 rows of the
# random campaigns are within twice this.
_TO_MEAN = 0.6
# Share of the response below which a member may be an error of the FRFs instead: at random angles,
# one in fifty is met by the force so near a node.
_HARDLY = 1e-3
# … which may hide a pair: what it does to half-width and damping of members that show in others.
# 95 of 100 rows of the random campaigns of benchmarks/laboratory.py are within twice this.
_ELSEWHERE = (0.002, 0.002)


def modes_of(
    fit: PoleFit,
    covariance: NDArray[np.float64] | None = None,
    residues_std: NDArray[np.float64] | None = None,
) -> list[Mode]:
    """Modes of all poles of a fit, in its order; standard deviations NaN where not given."""
    if covariance is None or residues_std is None:
        unknown = 2 * fit.poles.size
        covariance = np.full((unknown, unknown), np.nan)
        residues_std = np.full(fit.residues.shape, np.nan)
    std = np.sqrt(np.diag(covariance)).reshape(-1, 2)
    bound = fit.at_bound.reshape(-1, 2)
    residues = fit.residues
    return [
        Mode(
            pole=complex(pole),
            frequency_std_hz=float(std[r, 0]),
            damping_std=float(std[r, 1]),
            residues=residues[:, r],
            residues_std=residues_std[:, r],
            flags=(Flag.AT_BOUND,) if np.any(bound[r]) else (),
        )
        for r, pole in enumerate(fit.poles)
    ]


def rows_of(
    modes: Sequence[Mode],
    owner: Mapping[int, RingOrder],
    covariance: NDArray[np.float64],
    between: NDArray[np.float64],
    mixed: NDArray[np.float64],
    drift: Drift,
    position_deg: NDArray[np.float64],
    settings: IdentificationSettings,
) -> list[tuple[list[Mode], NDArray[np.float64]]]:
    """`as_seen` of every mode; `covariance` is that of all."""
    known = drift, position_deg, settings
    own = [covariance[2 * r : 2 * r + 2, 2 * r : 2 * r + 2] for r in range(len(modes))]
    return [
        as_seen(mode, owner.get(r), own[r], between[r], mixed[r], *known)
        for r, mode in enumerate(modes)
    ]


def as_seen(
    mode: Mode,
    ring: RingOrder | None,
    covariance: NDArray[np.float64],
    between: NDArray[np.float64],
    mixed: float,
    drift: Drift,
    position_deg: NDArray[np.float64],
    settings: IdentificationSettings,
) -> tuple[list[Mode], NDArray[np.float64]]:
    """The mode or modes that a pole stands for, with their covariance.

    Of a resolved pair each member has its wave, and its share of what is of no single order.
    `between` are the standard deviations of `std_between_runs`, `mixed` is the share of the power
    in other orders, from `in_other_orders`.
    """
    size = np.array([mode.frequency_hz, mode.damping_ratio])
    width = mode.damping_ratio * np.array([mode.frequency_hz, 1.0])
    floor = (size * drift.unsteadiness(mode.frequency_hz)) ** 2 + (size * drift.left_out) ** 2
    floor += (mixed * width * _IMPURE) ** 2
    if ring is None or ring.pair is None:
        own = _in_either_direction(mode, covariance + np.diag(floor + between**2))
        return [_with_std(mode, own)], own
    pair = ring.pair
    floor += (_FLOOR * size) ** 2 + (size * drift.std_of_mean) ** 2
    of_member = floor + mixed * (width * (_MIXED_JOINTLY if ring.jointly else _MIXED)) ** 2
    if not ring.is_resolved:
        member = ring.one_row
        at = slice(4, 6) if member is None else slice(2 * member, 2 * member + 2)
        if member is not None:
            unsure = of_member + _to_mean(pair, member) ** 2 + _of_bend(pair) ** 2
        else:
            unsure = floor + _of_shares(pair) ** 2
            if ring.report.pair.chance < settings.pair_p_value:
                unsure = unsure + _to_stronger(pair)
        own = pair.covariance[at, at] + np.diag(between**2 + unsure)
        if not ring.is_main:  # of the ring's own, damping is unknown by the split as well
            own = _in_either_direction(mode, own)
        return [_with_std(mode, own)], own
    waves = ring.waves(position_deg)
    basis = order_basis(position_deg, ring.order)
    rest = mode.residues - basis @ (np.linalg.pinv(basis) @ mode.residues)
    own = pair.covariance[:4, :4] + np.diag(np.tile(of_member, 2))
    unknown = float("nan")  # the ends of the band move the one pole in the place of both
    members = [
        _with_std(
            replace(
                mode,
                pole=pair.poles[k],
                residues=waves[:, k] + pair.share[k] * rest,
                residues_std=mode.residues_std * np.sqrt(pair.share[k]),
                frequency_band_shift_hz=unknown if ring.jointly else mode.frequency_band_shift_hz,
                damping_band_shift=unknown if ring.jointly else mode.damping_band_shift,
            ),
            own[2 * k : 2 * k + 2, 2 * k : 2 * k + 2],
        )
        for k in (0, 1)
    ]
    return members, own


def as_stated(
    mode: Mode, covariance: NDArray[np.float64]
) -> tuple[list[Mode], NDArray[np.float64]]:
    """`as_seen` of a pole that a person left where it was, as well known as it was there."""
    return [_with_std(mode, covariance)], covariance


def in_other_orders(
    fit: PoleFit,
    owner: Mapping[int, RingOrder],
    residues_std: NDArray[np.float64],
    position_deg: NDArray[np.float64],
    settings: IdentificationSettings,
) -> NDArray[np.float64]:
    """Share of each pole's power that is in other orders than its own, less that of noise.

    One pole in the place of a resolved pair would be impure by what it leaves of the split: the
    shape is that of both members together, without poles that the pair explains.
    """
    shares = np.zeros(fit.poles.size)
    if not on_circle(position_deg):
        return shares
    shapes = np.array(fit.residues)
    resolved = {
        k: each.pair
        for k, each in owner.items()
        if each.is_resolved and each.pair and not each.jointly
    }
    if resolved:
        poles, first = np.array(fit.poles), len(resolved)
        poles[list(resolved)] = [pair.poles[1] for pair in resolved.values()]
        lower = [pair.poles[0] for pair in resolved.values()]
        explained = [
            k
            for k, each in owner.items()
            if any(each.is_within(main, settings) for main in owner.values())
        ]
        kept = np.setdiff1d(np.arange(poles.size), explained)
        both = evaluate(fit.lines, np.concatenate([lower, poles[kept]]), fit.drift).residues
        shapes[:, kept] = both[:, first:]
        for k, each in owner.items():
            if each.jointly:  # its pair is not in the lines
                shapes[:, k] += each.waves(position_deg).sum(axis=1)
        shapes[:, list(resolved)] += both[:, :first]
    for k, shape in enumerate(shapes.T):
        size = np.sum(np.abs(shape) ** 2)
        power = order_content(shape, position_deg).power * shape.size / size
        noise = 2 * np.sum(residues_std[:, k] ** 2) / size
        shares[k] = max(power.sum() - power.max() - noise, 0.0)
    # More than all there is: the positions do not tell this order from others.
    told = shares <= 1.0
    return (
        np.where(told, shares, np.median(shares[told])) if np.any(told) else np.zeros_like(shares)
    )


def _of_shares(pair: PairFit, share_std: float = _SHARE_STD) -> NDArray[np.float64]:
    """What not knowing the members' shares does to the mean of frequency and damping ratio.

    Shares of complex modes are complex: part of a split then shows as damping, and part of what
    damping differs by as frequency.
    """
    apart = np.abs(pair.numbers[2:4] - pair.numbers[:2])
    spread = share_std * np.sqrt(pair.share[0] * pair.share[1]) * apart
    hz = pair.numbers[4]
    return np.asarray(np.hypot(spread, _COMPLEX * np.array([spread[1] * hz, spread[0] / hz])))


def std_of_unseen_pairs(
    fit: PoleFit,
    modes: Sequence[Mode],
    owner: Mapping[int, RingOrder],
    position_deg: NDArray[np.float64],
    correlation: float,
) -> NDArray[np.float64]:
    """Standard deviations of frequency and damping ratio from pairs that no order tells.

    Of a wave shorter than two distances of the sensors only one of cosine and sine is seen: its
    pair is taken to be split like those of the ring's orders. Where the other member hardly shows,
    what is taken for it may be an error of the FRFs, and it may be elsewhere. Without a circle the
    positions tell by what they differ.
    """
    if not on_circle(position_deg):
        return std_over_positions(fit, correlation)
    std = np.zeros((len(modes), 2))
    pairs = [each.pair for each in owner.values() if each.pair is not None]
    if pairs:
        each_share = [_of_shares(pair, _ANY_SHARE_STD) / pair.numbers[4:6] for pair in pairs]
        share = np.median(each_share, axis=0)
        for k, mode in enumerate(label_modes(modes, position_deg)):
            if mode.order is None and k not in owner:
                std[k] = share * (mode.frequency_hz, mode.damping_ratio)
    for k, each in owner.items():
        if _hardly_shows_another(each):
            half_width_hz = modes[k].damping_ratio * modes[k].frequency_hz
            std[k] = np.array(_ELSEWHERE) * (half_width_hz, modes[k].damping_ratio)
    return std


def _hardly_shows_another(order: RingOrder) -> bool:
    pair = order.pair
    return pair is not None and order.one_row is not None and min(pair.share) < _HARDLY


def _to_mean(pair: PairFit, member: int) -> NDArray[np.float64]:
    """Most of the way from a member to the mean of both (1 σ), less where they are apart.

    Of a weak member beneath a strong one, its share times the split is seen, neither of them alone:
    what else broadens the resonance is taken for it.
    """
    apart_hz, width_hz = pair.numbers[2] - pair.numbers[0], pair.numbers[4] * pair.numbers[5]
    away = pair.numbers[4:] - pair.numbers[2 * member : 2 * member + 2]
    return np.asarray(_TO_MEAN * away / (1 + (apart_hz / width_hz) ** 2))


def _of_bend(pair: PairFit) -> NDArray[np.float64]:
    """What a member that hardly shows leaves open of the one within its half-width (1 σ).

    Shares of complex modes turn a distance in frequency into one in damping, and back.
    """
    hz, ratio = pair.numbers[4:]
    half_width = np.array([hz * ratio, ratio])
    apart = (pair.numbers[2:4] - pair.numbers[:2]) / half_width
    amplitude = np.sqrt(pair.share[0] * pair.share[1]) * (apart[0] < 1)
    return np.asarray(_BENT * amplitude * np.hypot(*apart) * half_width)


def _to_stronger(pair: PairFit) -> NDArray[np.float64]:
    """Variance from taking the mean of two members that are seen for the stronger one.

    Shares of complex modes can be so far from the power of the members that the mean lies beside
    both; the 95 % interval reaches the stronger member, as far as it is known.
    """
    to_stronger = np.zeros((2, 6))
    stronger = 2 * pair.stronger
    to_stronger[[0, 1], [stronger, stronger + 1]], to_stronger[[0, 1], [4, 5]] = 1.0, -1.0
    away = to_stronger @ pair.numbers
    unknown = np.diag(to_stronger @ pair.covariance @ to_stronger.T)
    return np.asarray((away / 2) ** 2 + _OF_STRONGER**2 * unknown)


def _in_either_direction(mode: Mode, covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance in which the frequency is not known far better than damping says of the pole.

    Errors move a pole along and across the imaginary axis alike.
    """
    least_hz = _DIRECTED * mode.frequency_hz * np.sqrt(covariance[1, 1])
    return covariance + np.diag([max(least_hz**2 - covariance[0, 0], 0.0), 0.0])


def _with_std(mode: Mode, covariance: NDArray[np.float64]) -> Mode:
    std = np.sqrt(np.diag(covariance))
    return replace(mode, frequency_std_hz=float(std[0]), damping_std=float(std[1]))


def beside_ring(
    modes: Sequence[Mode], position_deg: NDArray[np.float64], owner: Container[int] = ()
) -> set[int]:
    """Modes that are surely not the ring's own; without a circle all.

    Those in `owner` stand for all that their order has.
    """
    if not on_circle(position_deg):
        return set(range(len(modes)))
    labelled = label_modes(modes, position_deg)
    groups = family(labelled).values()
    own = {k for each in groups for k in (each[:1] if each[0] in owner else each)}
    return {k for k, mode in enumerate(labelled) if mode.order is not None} - own


def shift_beside(modes: Sequence[Mode], beside: Container[int]) -> NDArray[np.float64]:
    """What the ends of the band move in modes that are not of the ring, (n_modes, 2).

    They are weak: what the model leaves out of the ring's resonances moves them, and only them.
    """
    shift = [(each.frequency_band_shift_hz, each.damping_band_shift) for each in modes]
    shift = [each if k in beside else (0.0, 0.0) for k, each in enumerate(shift)]
    return np.nan_to_num(shift)


def is_undetermined(mode: Mode, beside: bool, settings: IdentificationSettings) -> bool:
    """Whether a frequency is known, or stays with another band, to no better than a tenth.

    Beside the ring also whether the pole is known to no better than half its half-width: what the
    model leaves of other resonances looks like that.
    """
    away = np.fmax(mode.frequency_std_hz, mode.frequency_band_shift_hz)
    pole = np.hypot(mode.frequency_std_hz / mode.frequency_hz, mode.damping_std)
    blurred = beside and pole > settings.pole_scatter * mode.damping_ratio
    return bool(away > settings.undetermined_share * mode.frequency_hz or blurred)


def without_leakage(
    frf: FRF, plain: PoleFit, around: NDArray[np.complex128], settings: IdentificationSettings
) -> tuple[PoleFit, list[str]]:
    """Fit again, for averaged blocks, with the bias of the window compensated."""
    if not has_leakage(frf):
        return plain, []
    cleared = plain
    for _ in range(_LEAKAGE_ROUNDS):
        bias = _leakage_of(frf, cleared)(cleared.residues[:, :-N_STAND_INS])
        lines = replace(plain.lines, values=plain.lines.values - bias)
        start = np.append(cleared.poles[:-N_STAND_INS], plain.poles[-N_STAND_INS:])
        drift = cleared.drift if len(cleared.drift) > 1 else None
        given = settings, drift, around, plain.pairs, plain.locked
        cleared = fit_bounded(lines, start, *given)
    if cleared.misfit > _WORSE * plain.misfit:
        note = (
            "The bias of window and block length was not compensated: compensation makes the "
            "fit worse."
        )
        return plain, [note]
    return cleared, ["The bias of window and block length was compensated in the curve fit."]


def _leakage_of(
    frf: FRF, fit: PoleFit
) -> Callable[[NDArray[np.complex128]], NDArray[np.complex128]]:
    """Bias of the poles of a fit, as a function of their residues."""
    runs = enumerate(frf.run_names)
    poles = {name: fit.in_run(number)[:-N_STAND_INS] for number, name in runs}
    return leakage_of(frf, fit.lines.frequency_hz, poles)


def cleared_of_moved(frf: FRF, before: PoleFit, after: PoleFit) -> Lines | None:
    """Lines of a fit that went on, with the bias of the poles that moved; None where none did.

    Poles of `after` are those of `before`, with further ones ahead of the stand-ins.
    """
    n_before, n_after = before.poles.size - N_STAND_INS, after.poles.size - N_STAND_INS
    away = np.abs(after.poles[:n_before] - before.poles[:n_before])
    moved = np.flatnonzero(away > _STAYED * -before.poles[:n_before].real)
    there = np.append(moved, np.arange(n_before, n_after))
    if not there.size:
        return None
    change = _bias_of(frf, after, there)
    if moved.size:
        change = change - _bias_of(frf, before, moved)
    return replace(after.lines, values=after.lines.values - change)


def _bias_of(frf: FRF, fit: PoleFit, chosen: NDArray[np.intp]) -> Complex:
    """Bias of some poles of a fit with their residues."""
    runs = enumerate(frf.run_names)
    poles = {name: fit.in_run(number)[chosen] for number, name in runs}
    return leakage_bias(frf, fit.lines.frequency_hz, poles, fit.residues[:, chosen])


def cleared_lines(frf: FRF, lines: Lines, poles: Complex, drift: Real) -> Lines:
    """Lines without the bias of poles that are nearly known."""
    fit = evaluate(lines, poles, drift)
    bias_of = _leakage_of(frf, fit)
    for _ in range(_LEAKAGE_ROUNDS):
        bias = bias_of(fit.residues[:, :-N_STAND_INS])
        fit = evaluate(replace(lines, values=lines.values - bias), poles, drift)
    return fit.lines


def cleared_like(
    before: FRF,
    lines_before: Lines,
    cleared_before: Lines,
    frf: FRF,
    lines: Lines,
    poles: Complex,
    drift: Real,
) -> Lines:
    """Lines of other rows of a measurement without their bias: that of before where it is known."""
    there, bias = lines_before.values, lines_before.values - cleared_before.values
    known = bias_as_before(frf, lines.values, before, there, bias)
    if known is None:
        return cleared_lines(frf, lines, poles, drift)
    return replace(lines, values=lines.values - known)
