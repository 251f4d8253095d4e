"""Checks on channels, runs and forces: drift, coherence, block length, reciprocity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import position_finding
from ema.core.numerics import ReadonlyArrays
from ema.core.settings import CHECKS, CheckSettings

if TYPE_CHECKING:
    from ema.core.drift import Drift
    from ema.core.frf import FRF
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import scipy

from ema.circumference.orders import circle_basis, highest_order, on_circle
from ema.core.frf import FRF
from ema.poles.estimators import stretched

# Gains repeat from run to run to a percent; what is nearer to 1 than this is how sensors are.
_SMALLEST = 0.03
_SIGNIFICANT = 5.0  # standard deviations
# Share of the difference, beyond noise, that the factor has to explain. Of damping that changes it
# explains a half, of a gain all.
_EXPLAINED = 0.8
# Frequencies shift by that much where pressure and warming change, high orders more than low ones:
# each part of the band is shifted to where it fits. Half a step is 1/80 of a half-bandwidth.
_SHIFTS = np.linspace(-0.03, 0.03, 121)
_PARTS = 8
_SAME_PLACE_DEG = 0.1
_ENOUGH_ORDERS = 12  # between positions, the response follows from waves: more than a tyre has here
_SMOOTHED = 5  # lines of the derivative by frequency


@dataclass(frozen=True, eq=False)
class ReferenceCheck(ReadonlyArrays):
    """The fixed reference sensor over the runs."""

    run: tuple[str, ...]
    frequency_hz: NDArray[np.float64]  # lines of the band
    values: NDArray[np.complex128]  # inertance, (n_runs, n_frequencies)
    std: NDArray[np.float64]  # its standard deviation per quadrature
    ratio: float  # RMS deviation from the mean over its std: 1 is pure noise; NaN if unknown
    share: float  # RMS deviation from the mean over the RMS of the mean
    consistent: bool  # whether the runs show one tyre, as far as noise lets one see


def check_reference(
    reference: FRF, band_hz: tuple[float, float], settings: CheckSettings = CHECKS
) -> ReferenceCheck:
    """Compare the rows of `FRF.reference`, one per run, against their own noise in a band."""
    lines = (reference.frequency_hz >= band_hz[0]) & (reference.frequency_hz <= band_hz[1])
    values, std = reference.values[:, lines], reference.std[:, lines]
    level = np.sqrt(np.mean(std**2, axis=0))
    freedom = 2 * (values.shape[0] - 1)
    ratio = np.sqrt(np.mean(np.sum(np.abs(values - values.mean(axis=0)) ** 2, axis=0) / level**2))
    ratio = float(ratio / np.sqrt(freedom)) if freedom else np.nan  # one run has nothing beside it
    share = float(np.linalg.norm(values.std(axis=0)) / np.linalg.norm(values.mean(axis=0)))
    return ReferenceCheck(
        run=reference.run,
        frequency_hz=reference.frequency_hz[lines],
        values=values,
        std=std,
        ratio=ratio,
        share=share,
        consistent=not (ratio > settings.consistent_ratio and share > settings.consistent_share),
    )


def coherence_findings(
    frf: FRF, band_hz: tuple[float, float], settings: CheckSettings = CHECKS
) -> list[Finding]:
    """Median coherence of each position in the band; none where unknown, or 1 by definition."""
    if frf.n_effective <= 1:
        return []
    lines = (frf.frequency_hz >= band_hz[0]) & (frf.frequency_hz <= band_hz[1])
    findings = []
    for row, median in enumerate(np.median(frf.coherence[:, lines], axis=1)):
        if np.isnan(median):
            continue
        poor = median < settings.poor_coherence
        detail = f"median coherence {median:.3f} between {band_hz[0]:g} and {band_hz[1]:g} Hz"
        detail += f", below {settings.poor_coherence:g}" if poor else ""
        verdict = Verdict.WARNING if poor else Verdict.OK
        findings.append(position_finding(frf, row, Check.COHERENCE, verdict, detail))
    return findings


def averages_finding(frf: FRF) -> list[Finding]:
    """Remark that a single average has no error estimate; nothing for several averages."""
    if not frf.n_effective <= 1:
        return []
    detail = (
        "a single average: coherence is always 1 and carries no information; ± is estimated "
        "from the fit residuals. Coherence needs several averages (processing.averages)"
    )
    return [Finding("", "", None, Check.AVERAGES, Verdict.WARNING, detail)]


def period_finding(frf: FRF) -> list[Finding]:
    """Say whether blocks suit a force that repeats; nothing for one that does not."""
    plan = frf.blocks
    if plan is None or not plan.period_samples:
        return []
    found = f"the force repeats every {plan.period_s:g} s"
    if plan.is_one_period:
        detail = f"{found}; every block is one period, so that nothing leaks"
        return [Finding("", "force", None, Check.PERIOD, Verdict.OK, detail)]
    detail = (
        f"{found}, but blocks of {plan.block_s:g} s with a {plan.window} window are not one "
        "period: damping ratios may be wrong by a few percent. Use the default averages, block "
        "length and window"
    )
    return [Finding("", "force", None, Check.PERIOD, Verdict.WARNING, detail)]


# Changes between runs, in percent of frequencies and damping ratios, of which nothing depends: each
# run has its own state, and a frequency is known to a fortieth of a half-width of 2 %.
_SMALL_DRIFT, _SMALL_DAMPING_DRIFT = 0.05, 1.0


def drift_findings(drift: Drift, frequencies_hz: NDArray[np.float64]) -> list[Finding]:
    """Drift of each run against the first, one finding each; none with a single run.

    It is stated with its ± in the middle, and at the lowest and the highest of the frequencies of
    the modes; a warning where it is neither small nor within what goes up and down from run to run.
    """
    if len(drift.run) < 2 or not frequencies_hz.size:
        return []
    ends_hz = float(np.min(frequencies_hz)), float(np.max(frequencies_hz))
    at = np.array([*map(drift.at, ends_hz), drift.damping_percent])
    unsteady = [drift.unsteadiness(hz)[0] for hz in ends_hz] + [drift.unsteadiness(ends_hz[0])[1]]
    own = np.array([drift.std_percent, drift.std_percent, drift.damping_std_percent])
    std = np.hypot(own, 100 * np.array(unsteady)[:, None])
    small = np.array([_SMALL_DRIFT, _SMALL_DRIFT, _SMALL_DAMPING_DRIFT])[:, None]
    beyond = np.abs(at) > np.maximum(np.minimum(3 * std, 2 * small), small)
    warned = drift.applied & np.any(beyond, axis=0)
    middle_hz = drift.middle_hz
    middle_std = np.hypot(drift.std_percent, 100 * drift.unsteadiness(middle_hz)[0])
    says = "the run was fitted in its own state" if drift.applied else "no more than chance"
    return [
        Finding(
            run=run,
            channel="",
            position_deg=None,
            check=Check.DRIFT,
            verdict=Verdict.WARNING if warned[k] else Verdict.OK,
            detail=f"natural frequencies {drift.percent[k]:+.4f} ± {middle_std[k]:.4f} % at "
            f"{middle_hz:.0f} Hz ({at[0, k]:+.4f} % at {ends_hz[0]:.0f} Hz, {at[1, k]:+.4f} % at "
            f"{ends_hz[1]:.0f} Hz), damping {at[2, k]:+.2f} ± {std[2, k]:.2f} %, relative to "
            f"{drift.run[0]}; {says}",
        )
        for k, run in list(enumerate(drift.run))[1:]
    ]


def reference_finding(check: ReferenceCheck, settings: CheckSettings = CHECKS) -> Finding:
    """Verdict on the reference sensor as a line of ``quality.csv``."""
    deviation = (
        f"deviation over the runs is {check.ratio:.2f} times its noise (limit "
        f"{settings.consistent_ratio:g}) and {100 * check.share:.2g} % of its FRF (limit "
        f"{100 * settings.consistent_share:g} %)"
    )
    if np.isnan(check.ratio):
        verdict, says = Verdict.WARNING, "its noise is unknown with a single average"
        deviation = "deviation over the runs cannot be judged"
    elif check.consistent:
        verdict, says = Verdict.OK, "the runs show the same tyre"
    else:
        verdict, says = Verdict.WARNING, "the tyre or its mounting changed between the runs"
    return Finding(
        run="",
        channel="reference",
        position_deg=None,
        check=Check.REFERENCE,
        verdict=verdict,
        detail=f"{deviation}: {says}",
    )


@dataclass(frozen=True)
class OddGain:
    """Factor of one run over the usual one, with its standard deviation."""

    run: str
    factor: float
    std: float


def odd_gains(check: ReferenceCheck) -> list[OddGain]:
    """Runs that are most others times a real number; none with fewer than three runs.

    Every run is compared with every other one, shifted in frequency to where it fits: tyres drift,
    but none changes by one factor on all lines.
    """
    if not np.all(np.isfinite(check.std)):
        return []
    noise = 2 * np.sum(check.std**2, axis=1)
    power = np.sum(np.abs(check.values) ** 2, axis=1) - noise
    runs = np.flatnonzero(power > noise * _SIGNIFICANT / np.sqrt(check.frequency_hz.size))
    if runs.size < 3 or not _differ(check.values[runs]):
        return []
    values, noise, power = check.values[runs], noise[runs], power[runs]
    product, shifted = _products(values, check.frequency_hz)
    factor = product / (shifted - noise)
    error = noise[:, None] + factor**2 * noise
    std = np.sqrt(error / (2 * check.frequency_hz.size) / power)
    total = power[:, None] + noise[:, None]
    before = np.maximum(total - 2 * product + shifted - noise[:, None] - noise, 0)
    after = np.maximum(total - 2 * factor * product + factor**2 * shifted - error, 0)
    odd = np.abs(factor - 1) > np.maximum(_SMALLEST, _SIGNIFICANT * std)
    odd &= after < (1 - _EXPLAINED) * before
    alone = odd.sum(axis=1) > runs.size / 2
    return [
        OddGain(
            check.run[runs[row]],
            float(np.median(factor[row, odd[row]])),
            float(np.median(std[row, odd[row]])),
        )
        for row in np.flatnonzero(alone)
    ]


def _differ(values: NDArray[np.complex128]) -> bool:
    """Whether any two runs differ in a first look; where none do, nothing has to be shifted."""
    product = np.real(values.conj() @ values.T)
    return bool(np.any(np.abs(product / np.diag(product) - 1) > _SMALLEST / 2))


def _products(
    values: NDArray[np.complex128], frequency_hz: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Real products of each run (rows) with all others, shifted to fit it, and their powers."""
    n_runs, n_lines = values.shape
    shifted = np.array(
        [
            [np.interp(frequency_hz / (1 + shift), frequency_hz, run) for run in values]
            for shift in _SHIFTS
        ]
    )
    product, power = np.zeros((2, n_runs, n_runs))
    for lines in np.array_split(np.arange(n_lines), _PARTS):
        part = shifted[:, :, lines]
        own = np.sum(np.abs(part) ** 2, axis=2)
        here = np.real(np.tensordot(values[:, lines], part.conj(), axes=(1, 2)))
        fit = here**2 / np.maximum(own, np.finfo(float).tiny)
        best = np.argmax(fit, axis=1)[:, None]
        product += np.take_along_axis(here, best, axis=1)[:, 0]
        power += own[best[:, 0], np.arange(n_runs)]
    return product, power


def gain_findings(check: ReferenceCheck) -> list[Finding]:
    """Runs that are odd by a factor, as lines of ``quality.csv``."""
    return [
        Finding(
            run=gain.run,
            channel="reference",
            position_deg=None,
            check=Check.GAIN,
            verdict=Verdict.WARNING,
            detail=f"the FRF reads {gain.factor:.3g} ± {gain.std:.1g} times that of the other runs "
            "on all lines, as no tyre changes: check sign, unit and range of the force, and of the "
            "sensors; it was left in",
        )
        for gain in odd_gains(check)
    ]


Complex = NDArray[np.complex128]
Real = NDArray[np.float64]


class Reciprocity(NamedTuple):
    """The reverse response over the response, as one gain and one shift of all frequencies."""

    gain: float
    gain_std: float
    shift: float  # relative
    shift_std: float
    unexplained: float  # share of the power that neither explains, without that of noise


def reciprocity_findings(
    frfs: Sequence[FRF], band_hz: tuple[float, float], settings: CheckSettings = CHECKS
) -> list[Finding]:
    """Findings about each pair of forces where responses at the places of both are known."""
    found = []
    for one, other in combinations(frfs, 2):
        there, back = _at(one, other), _at(other, one)
        if there is None or back is None:
            continue
        seen = compared(one.frequency_hz, there, back, band_hz)
        if seen.unexplained > settings.reciprocity_share:
            moved = compared(one.frequency_hz, there, back, band_hz, far=True)
            seen = moved if moved.unexplained <= settings.reciprocity_share else seen
        said = list(_contradictions(seen, settings))
        detail = f"force at {_place(one)} and at {_place(other)}: "
        detail += "; ".join(said) or (
            f"reciprocal, gain {seen.gain:.3f}, frequencies within {100 * abs(seen.shift):.2g} %"
        )
        verdict = Verdict.WARNING if said else Verdict.OK
        found.append(Finding("", "", None, Check.RECIPROCITY, verdict, detail))
    return found


def _contradictions(seen: Reciprocity, settings: CheckSettings) -> Iterator[str]:
    if seen.unexplained > settings.reciprocity_share:
        yield (
            f"{100 * seen.unexplained:.0f} % of the response at one to the other is not that of "
            "the reverse: check places and directions of both forces"
        )
        return  # gain and shift mean nothing then
    if abs(seen.shift) > max(settings.steady_change, _SIGNIFICANT * seen.shift_std):
        yield (
            f"frequencies differ by {100 * seen.shift:+.2f} %: other masses at the force, "
            "or the tyre changed in between"
        )
    low, high = settings.usual_gain_min, settings.usual_gain_max
    significant = abs(seen.gain - 1) > _SIGNIFICANT * seen.gain_std
    if significant and not low <= seen.gain <= high:
        what = "sensitivity" if seen.gain > 0 else "sign"
        yield f"gain {seen.gain:.2f}: check the {what} of the force"


def compared(
    frequency_hz: Real,
    there: tuple[Complex, Real],
    back: tuple[Complex, Real],
    band_hz: tuple[float, float],
    *,
    far: bool = False,
) -> Reciprocity:
    """Compare two FRFs that are to be equal, each with its σ: H₂(f) ≈ g H₁(f/(1 + ε)).

    For small ε, or beside the one of `_SHIFTS` that fits best where it may be `far` from 0.
    """
    lines = (frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1])
    shift = 0.0
    if far:
        reverse = back[0][None]
        moved = np.array([stretched(frequency_hz, reverse, 1 + to)[0] for to in _SHIFTS])
        along = np.abs(np.real(moved[:, lines].conj() @ there[0][lines]))
        best = int(np.argmax(along / np.linalg.norm(moved[:, lines], axis=1)))
        shift, back = float(_SHIFTS[best]), (moved[best], back[1])
    first, second = there[0][lines], back[0][lines]
    noise = there[1][lines] ** 2 + back[1][lines] ** 2
    smooth = scipy.ndimage.uniform_filter1d((there[0] + back[0]) / 2, _SMOOTHED, mode="nearest")
    slope = -(frequency_hz * np.gradient(smooth, frequency_hz))[lines]
    known = bool(np.all(np.isfinite(noise) & (noise > 0)))
    weight = 1 / np.sqrt(noise) if known else np.ones(noise.size)
    design = np.column_stack([first, slope]) * weight[:, None]
    parted = np.vstack([design.real, design.imag])
    target = (second - first) * weight
    inverse = np.linalg.pinv(parted.T @ parted)
    found = inverse @ parted.T @ np.concatenate([target.real, target.imag])
    left = target - design @ found
    chi2 = float(np.sum(np.abs(left) ** 2)) / max(2 * left.size - 2, 1)
    std = np.sqrt(np.diag(inverse) * (max(chi2, 1.0) if known else chi2))
    missed = left / weight
    of_noise = 2 * np.sum(noise) if known else np.sum(np.abs(np.diff(missed, 2)) ** 2) / 6
    power = float(np.sum(np.abs(first) ** 2 + np.abs(second) ** 2)) / 2
    unexplained = max(float(np.sum(np.abs(missed) ** 2) - of_noise), 0.0) / (power or 1.0)
    shift += (1 + shift) * found[1] / (1 + found[0])
    return Reciprocity(1 + found[0], std[0], shift, std[1], unexplained)


def _at(frf: FRF, other: FRF) -> tuple[Complex, Real] | None:
    """Response at the place of another force and its σ; None where it was not measured."""
    angle = other.excitation_deg
    if np.isfinite(angle) and np.isfinite(frf.excitation_deg):
        away = np.abs((frf.position_deg - angle + 180.0) % 360.0 - 180.0)
        row = int(np.argmin(np.nan_to_num(away, nan=np.inf)))
        if away[row] < _SAME_PLACE_DEG:
            return frf.values[row], frf.std[row]
        highest = highest_order(frf.position_deg) if on_circle(frf.position_deg) else 0
        if highest < _ENOUGH_ORDERS:
            return None
        waves = np.linalg.pinv(circle_basis(frf.position_deg, highest))
        weights = (circle_basis(np.array([angle]), highest) @ waves)[0]
        return weights @ frf.values, np.sqrt(weights**2 @ frf.std**2)
    same = (frf.node == other.force_node) & (frf.axis == other.force_axis)
    rows = np.flatnonzero(same) if other.force_node else np.zeros(0, dtype=int)
    return (frf.values[rows[0]], frf.std[rows[0]]) if rows.size else None


def _place(frf: FRF) -> str:
    if np.isfinite(frf.excitation_deg):
        return f"{frf.excitation_deg:g} degrees"
    return f"node {frf.force_node}{' XYZ'[frf.force_axis].strip()}"
