"""Ring-mode shapes from all sensors together: gain of each sensor, place and sign of the force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.circumference.orders import highest_order, on_circle, order_basis, order_content
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.modes import ModalModel, Mode
from ema.core.numerics import ReadonlyArrays
from ema.core.settings import CHECKS, CheckSettings

# Share by which a healthy sensor may miss a pure wave of RMS 1, per quadrature: half a degree of
# misplacement at order 8 gives 0.07, tilt and the variation of a tyre around its circumference as
# much again.
SHAPE_TOLERANCE = 0.1
# A sensor follows a wave when it misses it by no more than this share of the wave's RMS …
_FOLLOWS = 0.25
# … and by this many standard deviations of its residue.
_FOLLOWS_STD = 5.0
# Share of the sensors that has to follow a wave before its order is believed: a tenth may be
# faulty, and as many stand where a wave is nearly nothing.
_MOST = 0.8
# The same where a third of the runs may have a force of wrong sign.
MAJORITY = 0.6
# … and share above which no other order needs to be tried.
_NEARLY_ALL = 0.85
# A residue known to no better than this share of the wave says nothing about a sensor; members of
# an unresolved pair have residues with a standard deviation of their own size.
_KNOWN = 0.1
# At least this much of a wave's RMS has to be expected at a place to say something about a gain.
_SEEN = 0.3
_ROUNDS = 20
# The place of the force needs so many orders, and is sought in such steps.
_FEWEST_ORDERS = 3
_STEP_DEG = 0.5


@dataclass(frozen=True, eq=False)
class RingShapes(ReadonlyArrays):
    """Shapes of the ring modes, each scaled to RMS 1; close modes of one order are one wave."""

    order: NDArray[np.int_]  # shape (n_waves,)
    # shape (n_positions, n_waves); residues as measured, of a wave cos n(θ − θ_n) fitted to them
    # robustly, and the standard deviation per quadrature of the former, `SHAPE_TOLERANCE` included
    measured: NDArray[np.complex128]
    expected: NDArray[np.complex128]
    std: NDArray[np.float64]

    @property
    def n_waves(self) -> int:
        """Number of waves."""
        return int(self.order.size)

    def gain(self, row: int, as_if: int | None = None) -> tuple[float, float]:
        """Factor of what a row measures over what is expected there or at `as_if`, with its std."""
        expected = self.expected[row if as_if is None else as_if]
        weight = 1 / self.std[row] ** 2
        power = float(np.sum(weight * np.abs(expected) ** 2))
        if not power > 0:
            return 0.0, np.inf
        product = np.sum(weight * np.real(expected.conj() * self.measured[row]))
        return float(product) / power, 1 / np.sqrt(power)

    def mismatch(self, row: int, gain: float, as_if: int | None = None) -> float:
        """RMS of what a gain leaves unexplained, in standard deviations; about 1.4 for a good row.

        A gain above 1 scales the tolerance with it: the same misplacement then shows as much more.
        """
        expected = self.expected[row if as_if is None else as_if]
        left = np.abs(self.measured[row] - gain * expected) / max(1.0, abs(gain))
        return float(np.sqrt(np.mean((left / self.std[row]) ** 2)))

    def n_telling(self, row: int) -> int:
        """Number of waves that are seen well at a row."""
        return int(np.sum(np.abs(self.expected[row]) > _SEEN))

    def misfit(self) -> float:
        """Reduced χ² of all sensors against the waves."""
        left = np.abs(self.measured - self.expected) / self.std
        return float(np.mean(left**2)) / 2 if left.size else 0.0


def ring_shapes(frf: FRF, model: ModalModel, *, followed_by: float = _MOST) -> RingShapes:
    """Shapes of the ring modes of a model whose order is beyond doubt.

    The model is fitted to these FRFs, whose positions have angles. A wave counts where its residues
    are known well, where the positions are close enough to tell its order, and where a share of the
    sensors, `followed_by`, follows it.
    """
    seen = [_wave(frf, model, close, followed_by) for close in close_modes(model.modes)]
    waves = [wave for wave in seen if wave is not None]
    if not waves:
        nothing = np.zeros((frf.n_positions, 0))
        shapes = nothing.astype(np.complex128)
        return RingShapes(np.zeros(0, dtype=int), shapes, shapes, nothing)
    order, measured, expected, std = zip(*waves, strict=True)
    return RingShapes(np.array(order), np.array(measured).T, np.array(expected).T, np.array(std).T)


_Wave = tuple[int, NDArray[np.complex128], NDArray[np.complex128], NDArray[np.float64]]


def close_modes(modes: Sequence[Mode]) -> list[list[Mode]]:
    """Modes that overlap by their half-power bandwidths, together.

    How a response divides among them is ill determined and differs from run to run when the tyre
    drifts; their sum is not.
    """
    groups: list[list[Mode]] = []
    for mode in sorted(modes, key=lambda each: abs(each.pole)):
        if groups and _overlap(groups[-1][-1], mode):
            groups[-1].append(mode)
        else:
            groups.append([mode])
    return groups


def _overlap(one: Mode, other: Mode) -> bool:
    return bool(abs(one.pole.imag - other.pole.imag) < -(one.pole.real + other.pole.real))


def _wave(frf: FRF, model: ModalModel, close: Sequence[Mode], followed_by: float) -> _Wave | None:
    residues = np.sum([mode.residues for mode in close], axis=0)
    std = close[0].residues_std if len(close) == 1 else _residue_std(frf, model, close)
    std = np.nan_to_num(std)  # unknown: the tolerance alone has to do
    found = _followed_order(residues, std, frf.position_deg, followed_by)
    if found is None:
        return None
    order, expected = found
    size = float(np.sqrt(np.mean(np.abs(expected) ** 2)))
    return order, residues / size, expected / size, np.hypot(std / size, SHAPE_TOLERANCE)


def _residue_std(frf: FRF, model: ModalModel, close: Sequence[Mode]) -> NDArray[np.float64]:
    """Standard deviation of the residue of a single pole in the place of several close ones."""
    strength = [float(np.linalg.norm(mode.residues)) for mode in close]
    pole = np.average([mode.pole for mode in close], weights=strength)
    low_hz, high_hz = model.fit_band_hz
    lines = (frf.frequency_hz >= low_hz) & (frf.frequency_hz <= high_hz)
    omega = 2 * np.pi * frf.frequency_hz[lines]
    basis = np.abs(omega**2 / (1j * omega - pole))
    scale = np.sqrt(max(1.0, np.nan_to_num(model.misfit, nan=1.0)))
    with np.errstate(divide="ignore"):  # no noise at all: infinitely well known
        return np.asarray(scale / np.sqrt(np.sum((basis / frf.std[:, lines]) ** 2, axis=1)))


def _followed_order(
    residues: NDArray[np.complex128],
    std: NDArray[np.float64],
    position_deg: NDArray[np.float64],
    followed_by: float,
) -> tuple[int, NDArray[np.complex128]] | None:
    """Order that most sensors follow, and its wave; None where there is no such order.

    Of several that are followed as well the lowest, as signs that alternate from run to run turn
    an order into a high one.
    """
    orders = _orders_told(position_deg)
    if not orders:
        return None
    limit = 2.0 * np.median(np.abs(residues))  # no pure wave exceeds its median as far
    tamed = residues * np.minimum(1, limit / np.maximum(np.abs(residues), np.finfo(float).tiny))
    strongest = order_content(tamed, position_deg).order
    share, wave = _followed(residues, std, position_deg, strongest)
    if share > _NEARLY_ALL:
        return strongest, wave
    tried = [_followed(residues, std, position_deg, order) for order in orders]
    best = int(np.argmax([share for share, _ in tried]))
    return (orders[best], tried[best][1]) if tried[best][0] > followed_by else None


def _followed(
    residues: NDArray[np.complex128],
    std: NDArray[np.float64],
    position_deg: NDArray[np.float64],
    order: int,
) -> tuple[float, NDArray[np.complex128]]:
    """Share of the sensors that follow a wave of an order, and the wave."""
    basis = order_basis(position_deg, order)
    wave = basis @ _robust(basis, residues)
    size = float(np.sqrt(np.mean(np.abs(wave) ** 2)))
    if not np.median(std) < _KNOWN * size:
        return 0.0, wave
    close = np.abs(residues - wave) < _FOLLOWS * size + _FOLLOWS_STD * std
    return float(np.mean(close)), wave


def _orders_told(position_deg: NDArray[np.float64]) -> list[int]:
    """Orders that the positions tell from each other; none on a mere part of the circle."""
    return list(range(highest_order(position_deg) + 1)) if on_circle(position_deg) else []


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


def drive_point_finding(
    model: ModalModel, excitation_deg: float | None, settings: CheckSettings = CHECKS
) -> list[Finding]:
    """Compare where the shapes are driven from with where the force is said to be.

    Where a structure is driven every mode answers in phase with the force: −Im of the residue is
    positive in all orders (a point mobility has a positive real part). An order of a ring, both
    members together, is there at the crest of its wave; so the place shows in the shapes. Without a
    circle, or with fewer than three orders, nothing is found.
    """
    if excitation_deg is None or not on_circle(model.position_deg):
        return []
    waves = _waves(model)
    if len(waves) < _FEWEST_ORDERS:
        return []
    clear = settings.drive_point_clear
    here = float(_agreement(waves, np.array([excitation_deg]))[0])
    if here < -clear:
        says = (
            "all shapes move against the force where it acts: force or accelerations have the "
            "wrong sign in all runs. Frequencies and damping are right, FRFs and residues turned"
        )
        return [_finding(excitation_deg, Verdict.WARNING, says)]
    angles = np.arange(0.0, 360.0, _STEP_DEG)
    score = _agreement(waves, angles)
    best = int(np.argmax(np.abs(score)))
    elsewhere = abs(score[best]) > clear
    away_deg = abs((angles[best] - excitation_deg + 180) % 360 - 180)
    off = away_deg > settings.drive_point_offset_deg
    off = off and 1 - here > settings.position_factor * (1 - abs(score[best]))
    if (here > clear and not off) or (here > settings.drive_point_agrees and not elsewhere):
        says = "the shapes are driven from where the force acts"
        return [_finding(excitation_deg, Verdict.OK, says)]
    says = "the shapes are not driven from there"
    remedy = "Check [excitation] position_deg and the positions of the sensors"
    if elsewhere:
        turned = ", by a force of the other sign" if score[best] < 0 else ""
        says += f" but from about {angles[best]:g}°{turned}"
        remedy = (
            f"If the force acts there, [excitation] position_deg = {angles[best]:g}; otherwise "
            "check the positions of the sensors"
        )
    return [_finding(excitation_deg, Verdict.WARNING, f"{says}. {remedy}")]


def _finding(position_deg: float, verdict: Verdict, detail: str) -> Finding:
    return Finding("", "force", position_deg, Check.DRIVE_POINT, verdict, detail)


def _waves(model: ModalModel) -> dict[int, tuple[float, float]]:
    """−Im of the residues of each order n ≥ 1 as amplitudes of cos nθ and sin nθ."""
    waves: dict[int, tuple[float, float]] = {}
    for mode in model.modes:
        if not mode.order:
            continue
        content = order_content(-mode.residues.imag.astype(complex), model.position_deg)
        cosine, sine = waves.get(mode.order, (0.0, 0.0))
        waves[mode.order] = (
            cosine + float(content.cosine[mode.order].real),
            sine + float(content.sine[mode.order].real),
        )
    return waves


def _agreement(
    waves: dict[int, tuple[float, float]], angles_deg: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Mean over the orders of the response at an angle over the crest of its wave, −1 … 1."""
    orders = np.array(list(waves))
    cosine, sine = np.array(list(waves.values())).T
    phase = np.outer(np.deg2rad(angles_deg), orders)
    return np.asarray(
        np.mean((cosine * np.cos(phase) + sine * np.sin(phase)) / np.hypot(cosine, sine), axis=1)
    )
