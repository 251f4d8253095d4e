"""Sensors that contradict the modes all others agree on: flipped, wrongly scaled, swapped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.circumference import circle_basis, label_modes
from ema.frf import FRF
from ema.modes import ModalModel, Mode
from ema.quality import EXCLUDED, WARNING, Finding, position_finding

# Shapes of the ring's modes that the check rests on.
_PURE = 0.5
# Share of the positions that has to show a mode's order where its purity does not.
_MAJORITY = 0.6
_FEWEST_MODES = 2
# No shape of a single order exceeds its median magnitude by this factor.
_LOUD = 2.0
# What a sensor may deviate from the shapes, as a share of them, before it is looked at …
_TOLERANCE = 0.25
# … and, beyond its own noise, in standard deviations.
_SIGNIFICANT = 5.0
# A gain between these is how sensors are; farther off it is a wrong sensitivity.
_GAIN = (0.8, 1.25)
# A run of which more than this share of the sensors contradicts the others is odd as a whole.
_MOST = 0.5
_ROUNDS = 20


@dataclass(frozen=True, eq=False)
class _Shapes:
    """Measured and expected residues of the ring's modes, each mode scaled to RMS 1.

    Parameters
    ----------
    measured, expected : ndarray of complex, shape (n_positions, n_modes)
    noise : ndarray, shape (n_positions,)
        RMS standard deviation over the modes.
    """

    measured: NDArray[np.complex128]
    expected: NDArray[np.complex128]
    noise: NDArray[np.float64]

    def gain(self, row: int, as_if: int) -> float:
        """Factor of the measured shape of a row over what is expected at row `as_if`."""
        expected = self.expected[as_if]
        power = float(np.sum(np.abs(expected) ** 2))
        return float(np.real(np.vdot(expected, self.measured[row]))) / power if power else 0.0

    def mismatch(self, row: int, as_if: int, gain: float) -> float:
        """What a gain leaves unexplained, as a share of the expected shape."""
        left = self.measured[row] - gain * self.expected[as_if]
        size = np.linalg.norm(gain * self.expected[as_if])
        return float(np.linalg.norm(left) / size) if size else np.inf

    def limit(self, as_if: int, gain: float) -> float:
        """Largest mismatch that a healthy sensor shows there."""
        size = abs(gain) * np.linalg.norm(self.expected[as_if])
        noise = self.noise[as_if] * np.sqrt(2 * self.expected.shape[1])
        return float(_TOLERANCE + _SIGNIFICANT * noise / size) if size else np.inf


def check_consistency(
    frf: FRF, model: ModalModel, *, exclude: bool = True
) -> tuple[FRF, list[Finding]]:
    """Compare every sensor with the shapes that all sensors together show.

    Each mode of the ring is cos n(θ − θ_n) all around; fitted robustly, the few sensors that
    disagree stand out by the gain and the mismatch over all modes. A flipped or wrongly scaled
    sensor and two swapped ones are corrected, what else contradicts the modes is left out.

    Parameters
    ----------
    frf : FRF
        Of a closed circle of positions.
    model : ModalModel
        Modes fitted to these FRFs.
    exclude : bool
        Whether to leave out what cannot be put right.

    Returns
    -------
    corrected : FRF
    findings : list of Finding
        One for every sensor that was corrected or left out.
    """
    modes = _ring_modes(model, frf.position_deg)
    if len(modes) < _FEWEST_MODES:
        return frf, []
    shapes = _shapes(modes, frf.position_deg)
    factor = np.ones(frf.n_positions)
    source = np.arange(frf.n_positions)
    findings: dict[int, Finding] = {}
    suspects = []
    for row in range(frf.n_positions):
        gain = shapes.gain(row, row)
        if shapes.mismatch(row, row, gain) > shapes.limit(row, gain):
            suspects.append(row)
        elif gain < 0 or not _GAIN[0] <= gain <= _GAIN[1]:
            factor[row] = _sensible_factor(gain)
            findings[row] = position_finding(frf, row, *_gain_finding(gain))
    for first, second in _swapped(frf, shapes, suspects):
        source[[first, second]] = second, first
        for row, other in ((first, second), (second, first)):
            text = f"swapped with {frf.channel[other]}; both were put right"
            findings[row] = position_finding(frf, row, "swapped", WARNING, text)
    lost = [row for row in suspects if row not in findings and exclude]
    alone, odd_runs = _without_odd_runs(frf, lost)
    for row in alone:
        share = shapes.mismatch(row, row, shapes.gain(row, row))
        findings[row] = position_finding(frf, row, "inconsistent", EXCLUDED, _contradiction(share))
    corrected = _corrected(frf, factor, source)
    kept = np.setdiff1d(np.arange(frf.n_positions), alone)
    return corrected.rows(kept), [findings[row] for row in sorted(findings)] + odd_runs


def _contradiction(share: float) -> str:
    what = "contradicts the modes of all other sensors"
    return f"{what} by {100 * share:.0f} %" if share <= 1 else f"{what}: nothing of them is in it"


def _without_odd_runs(frf: FRF, suspects: Sequence[int]) -> tuple[list[int], list[Finding]]:
    """Suspects that stand alone in their run, and the runs most sensors of which are suspects.

    Sensors do not fail by the dozen: such a run saw the tyre in another state, or the manifest
    gives it the positions of another run.
    """
    count = {name: [frf.run[row] for row in suspects].count(name) for name in set(frf.run)}
    odd = sorted(name for name, n in count.items() if n > _MOST * frf.run.count(name))
    findings = [
        Finding(
            run=name,
            channel="",
            position_deg=None,
            check="inconsistent",
            verdict=WARNING,
            detail=f"{count[name]} of {frf.run.count(name)} sensors contradict the modes of the "
            "other runs together: the run saw the tyre in another state, or its positions are "
            "those of another run; it was left in",
        )
        for name in odd
    ]
    return [row for row in suspects if frf.run[row] not in odd], findings


def _ring_modes(model: ModalModel, position_deg: NDArray[np.float64]) -> list[Mode]:
    """Modes of one order each, told without trust in any position that reads far too much."""
    limits = [_LOUD * np.median(np.abs(mode.residues)) for mode in model.modes]
    tamed = [
        replace(mode, residues=mode.residues * np.minimum(1, limit / np.abs(mode.residues)))
        for mode, limit in zip(model.modes, limits, strict=True)
    ]
    labelled = label_modes(tamed, position_deg)
    orders = [
        None if seen.order is None else _trusted_order(mode, seen, position_deg)
        for mode, seen in zip(model.modes, labelled, strict=True)
    ]
    return [
        replace(mode, order=order)
        for mode, order in zip(model.modes, orders, strict=True)
        if order is not None
    ]


def _trusted_order(mode: Mode, seen: Mode, position_deg: NDArray[np.float64]) -> int | None:
    """Order of a pure shape, or the one that most positions follow; None where there is neither.

    A run with a reversed force spoils the purity of every shape, but most positions still agree.
    """
    if seen.order_purity > _PURE:
        return seen.order
    # Orders too high to be resolved together with all others count too: order 7 shares half of the
    # places of a 15° grid with order 5. Of equals the lowest, as signs that alternate from run to
    # run turn order n into a high one.
    orders = range((position_deg.size + 1) // 2)
    share = [_followed(replace(mode, order=order), position_deg) for order in orders]
    best = int(np.argmax(share))
    return best if share[best] > _MAJORITY else None


def _followed(mode: Mode, position_deg: NDArray[np.float64]) -> float:
    """Share of the positions that a wave of the mode's order explains."""
    own = _order_basis(mode, position_deg)
    fitted = own @ _robust(own, mode.residues)
    size = np.sqrt(np.mean(np.abs(fitted) ** 2))
    noise = _SIGNIFICANT * mode.residues_std
    return float(np.mean(np.abs(mode.residues - fitted) < _TOLERANCE * size + noise))


def _order_basis(mode: Mode, position_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    basis = circle_basis(position_deg, mode.order or 0)
    return basis[:, :1] if not mode.order else basis[:, -2:]


def _shapes(modes: Sequence[Mode], position_deg: NDArray[np.float64]) -> _Shapes:
    measured, expected, noise = [], [], []
    for mode in modes:
        own = _order_basis(mode, position_deg)
        fitted = own @ _robust(own, mode.residues)
        size = np.sqrt(np.mean(np.abs(fitted) ** 2))
        measured.append(mode.residues / size)
        expected.append(fitted / size)
        noise.append(mode.residues_std / size)
    spread = np.sqrt(np.mean(np.square(noise), axis=0))
    return _Shapes(np.array(measured).T, np.array(expected).T, spread)


def _robust(basis: NDArray[np.float64], values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Least absolute deviations, by reweighting: a minority of wrong sensors has no say."""
    weight = np.ones(values.size)
    amplitude = np.zeros(basis.shape[1], dtype=complex)
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)[:, None]
        amplitude = np.linalg.lstsq(root * basis, root[:, 0] * values, rcond=None)[0]
        left = np.abs(values - basis @ amplitude)
        weight = 1 / np.maximum(left, 1e-3 * np.median(np.abs(values)))
    return amplitude


def _sensible_factor(gain: float) -> float:
    """What to multiply with: a flipped sensor of right sensitivity keeps its own calibration."""
    return -1.0 if _GAIN[0] <= -gain <= _GAIN[1] else 1 / gain


def _gain_finding(gain: float) -> tuple[str, str, str]:
    if _GAIN[0] <= -gain <= _GAIN[1]:
        text = f"fits the modes with a factor of {gain:.2f}: the sign was turned"
        return "flipped", WARNING, text
    turned = " and with the wrong sign" if gain < 0 else ""
    text = f"reads {abs(gain):.3g} times what the modes say{turned}: divided by that"
    return "scaled", WARNING, text


def _swapped(frf: FRF, shapes: _Shapes, suspects: Sequence[int]) -> list[tuple[int, int]]:
    """Pairs of one run's suspects of which each fits the other's place."""
    pairs: list[tuple[int, int]] = []
    taken: set[int] = set()
    for number, first in enumerate(suspects):
        for second in suspects[number + 1 :]:
            if frf.run[first] != frf.run[second] or {first, second} & taken:
                continue
            if _fits(shapes, first, second) and _fits(shapes, second, first):
                pairs.append((first, second))
                taken |= {first, second}
    return pairs


def _fits(shapes: _Shapes, row: int, as_if: int) -> bool:
    gain = shapes.gain(row, as_if)
    close = shapes.mismatch(row, as_if, gain) <= shapes.limit(as_if, gain)
    return close and _GAIN[0] <= gain <= _GAIN[1]


def _corrected(frf: FRF, factor: NDArray[np.float64], source: NDArray[np.int_]) -> FRF:
    moved = frf.rows(source)
    return replace(
        moved,
        values=moved.values * factor[:, None],
        std=moved.std * np.abs(factor)[:, None],
        node=frf.node,
        position_deg=frf.position_deg,
    )
