"""Reciprocity of several forces: the response at one to another, against the reverse.

H(a, b) = H(b, a) holds for any linear structure that stays as it is. A shaker that was re-mounted
with another mass shifts frequencies, a load cell of another sensitivity changes the gain, a wrong
place or direction changes everything else.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from ema.circumference.orders import circle_basis, highest_order, on_circle
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.settings import CHECKS, CheckSettings

_SAME_PLACE_DEG = 0.1
_ENOUGH_ORDERS = 12  # between positions, the response follows from waves: more than a tyre has here
_SMOOTHED = 5  # lines of the derivative by frequency
_SIGNIFICANT = 5.0  # σ

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
        yield f"gain {seen.gain:.2f}: check the sensitivity of the force"


def compared(
    frequency_hz: Real,
    there: tuple[Complex, Real],
    back: tuple[Complex, Real],
    band_hz: tuple[float, float],
) -> Reciprocity:
    """Compare two FRFs that are to be equal, each with its σ: H₂(f) ≈ g H₁(f/(1 + ε))."""
    lines = (frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1])
    first, second = there[0][lines], back[0][lines]
    noise = there[1][lines] ** 2 + back[1][lines] ** 2
    smooth = uniform_filter1d((there[0] + back[0]) / 2, _SMOOTHED, mode="nearest")
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
    return Reciprocity(1 + found[0], std[0], found[1] / (1 + found[0]), std[1], unexplained)


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
