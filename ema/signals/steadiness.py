"""Steadiness of the tyre within a run: change of its frequencies over time and with level.

What the response differs by from its prediction is projected, piece by piece, on what a common
relative change δ of all frequencies would add (docs/identification.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.core.campaign import Response, Run
from ema.core.frf import FRF
from ema.core.modes import ModalModel
from ema.core.numerics import available_threads
from ema.core.recording import DERIVATIVES, Channel
from ema.core.settings import CHECKS, CheckSettings

# Sensors of a run that are looked at, fewer of long recordings: more would cost time and tell the
# same.
_SENSORS, _FEWEST_SENSORS = 6, 2
# Points over a half-power bandwidth at which the modes are computed; a line between two of them is
# off by 1/(4 · 48²) of the response at most, which is the same over the whole run.
_PER_BANDWIDTH = 96
_SAMPLES_OF_ALL = 1 << 20
# Length of a piece: a few time constants of a mode.
PIECE_S = 0.25
# What happened before the recording is unknown; it has rung out after this time.
_SETTLING_S = 0.5
# Samples of a channel that are looked at, from its start.
_MOST_SAMPLES = 1 << 22
_SMOOTHING_HZ = 4.0
# The modes may be those without the mass of the sensors, or fit otherwise not quite: what another
# transfer function, smooth over this width and so many lines, explains is steady.
_STEADY_HZ = 1.0
_STEADY_LINES = 16
# Share of a response's power from which the modes do not explain it.
_UNEXPLAINED = 0.5
_FEWEST_PIECES = 8
# Scatter of the excited frequency over the pieces as a share of the band: noise has 0.04, an even
# sweep 0.29.
_SWEEPING = 0.15


@dataclass(frozen=True)
class Estimate:
    """Relative change of all frequencies, its standard deviation, and by how many values."""

    value: float
    std: float
    freedom: float

    @property
    def p_value(self) -> float:
        """Probability of a change as large by chance."""
        return float(
            2 * scipy.special.stdtr(self.freedom, -abs(self.value) / max(self.std, 1e-300))
        )

    def is_clear(self, settings: CheckSettings) -> bool:
        """Whether the change is more than chance."""
        return self.p_value < settings.steadiness_p_value


@dataclass(frozen=True)
class ModeChange:
    """Relative change of one mode, or of some that overlap, from the start of a run to its end."""

    frequency_hz: float
    value: float
    std: float


@dataclass(frozen=True)
class Steadiness:
    """What one run shows."""

    run: str
    over_time: Estimate  # change from its start to its end
    over_level: Estimate | None  # if the level doubles; None for a sweep: one mode after the other
    of_modes: tuple[ModeChange, ...] = ()  # where the change is no chance


def steadiness_of(
    runs: Sequence[Run], frf: FRF, model: ModalModel, settings: CheckSettings = CHECKS
) -> list[Steadiness]:
    """What each run shows, where something can be said.

    `frf` are the FRFs that the modes were fitted to; its rows are those of `model`.
    """
    with ThreadPoolExecutor(available_threads()) as pool:  # transforms let other threads work
        found = pool.map(lambda run: run_steadiness(run, frf, model, settings), runs)
        return [each for each in found if each is not None]


def run_steadiness(
    run: Run, frf: FRF, model: ModalModel, settings: CheckSettings = CHECKS
) -> Steadiness | None:
    """Change of the frequencies within one run; None where nothing can be said.

    Of several forces at the same time, the FRF against one does not predict the response.
    """
    if len(run.forces) > 1:
        return None
    rate = run.recording.sampling_rate_hz
    n = min(run.recording.n_samples, _MOST_SAMPLES)
    first, last = (int(f * n / rate) for f in model.band_hz)
    lines = slice(first, min(last, n // 2))
    force = _spectrum(run.force, n)[lines]
    sensors = _sensors(run, frf, max(_SAMPLES_OF_ALL // n, _FEWEST_SENSORS))
    step = max(round(PIECE_S * (lines.stop - first) * rate / n), 1)
    n_pieces = (lines.stop - first) // step
    if not np.all(np.isfinite(force)) or n_pieces < _FEWEST_PIECES or not sensors:
        return None
    omega = 2 * np.pi * np.arange(first, lines.stop) * rate / n
    rows = np.array([row for _, row in sensors])
    seen = np.array([_as_acceleration(each.channel, n, lines, omega) for each, _ in sensors])
    predicted = _Predicted(model, run.name, rows, omega)
    pieces = _Pieces(n_pieces, step, force, n / rate, seen, predicted.values)
    over_time, over_level = pieces.changes(predicted.slope()) or (None, None)
    if over_time is None:
        return None
    of_modes = _changes_of_modes(pieces, predicted) if over_time.is_clear(settings) else ()
    sweeps = _sweeps(force, n_pieces, step)
    return Steadiness(run.name, over_time, None if sweeps else over_level, of_modes)


def _changes_of_modes(pieces: _Pieces, predicted: _Predicted) -> tuple[ModeChange, ...]:
    """What each mode does by itself; modes that overlap do it together."""
    found = []
    for group in _overlapping(predicted.model):
        own = pieces.changes(predicted.slope(group))
        if own is not None:
            hz = float(predicted.model.frequencies_hz[group].mean())
            found.append(ModeChange(hz, own[0].value, own[0].std))
    return tuple(found)


def _overlapping(model: ModalModel) -> list[NDArray[np.int_]]:
    """The modes, together where their half-power bandwidths touch."""
    poles = np.array([mode.pole for mode in model.modes])
    along = np.argsort(poles.imag)
    apart = np.diff(poles.imag[along]) > -(poles.real[along][1:] + poles.real[along][:-1])
    return np.split(along, np.flatnonzero(apart) + 1)


@dataclass(frozen=True, eq=False)
class _Sensor:
    """What a sensor differs by from its prediction, over time, where its noise is even."""

    row: int  # among the sensors of the run
    gain: float  # of what it sees against what is predicted
    noise: NDArray[np.float64]
    rest: NDArray[np.complex128]  # (n_pieces, step), in units of the noise


class _Pieces:
    """The sensors of a run, piece by piece, unless the modes do not explain what they show."""

    def __init__(
        self,
        n_pieces: int,
        step: int,
        force: NDArray[np.complex128],
        duration_s: float,
        seen: NDArray[np.complex128],
        values: NDArray[np.complex128],
    ) -> None:
        self.shape, self.force, self.duration_s = (n_pieces, step), force, duration_s
        self._steady_lines = max(int(_STEADY_HZ * duration_s), _STEADY_LINES)
        power = scipy.ndimage.uniform_filter1d(_squared(force), self._steady_lines, mode="nearest")
        self._force_power = np.maximum(power, 1e-300)
        self._sensors: list[_Sensor] = []
        self._power = np.zeros(n_pieces)
        for row, (own, frf) in enumerate(zip(seen, values, strict=True)):
            self._add(row, own, frf * force)

    def _add(
        self, row: int, seen: NDArray[np.complex128], expected: NDArray[np.complex128]
    ) -> None:
        own = max(float(np.vdot(expected, expected).real), 1e-300)
        gain = float(np.vdot(expected, seen).real) / own
        rest = self._unsteady(seen - gain * expected)
        left, there = _squared(rest), float(np.vdot(seen, seen).real)
        if not np.isfinite(there) or not left.sum() < _UNEXPLAINED * there:
            return
        smoothing = max(int(_SMOOTHING_HZ * self.duration_s), 1)
        noise = np.sqrt(scipy.ndimage.uniform_filter1d(left, smoothing, mode="nearest"))
        noise = np.maximum(noise, 1e-12 * np.sqrt(_squared(seen).max()))
        self._sensors.append(_Sensor(row, gain, noise, self._over_time(rest / noise)))
        self._power += np.sum(_squared(self._over_time(seen)), axis=1) / there

    def _unsteady(self, rest: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Of what the modes do not explain, what no smooth transfer function explains either."""
        crossed = rest * self.force.conj()
        crossed = scipy.ndimage.uniform_filter1d(crossed, self._steady_lines, mode="nearest")
        return np.asarray(rest - self.force * crossed / self._force_power)

    def _over_time(self, spectrum: NDArray[np.complex128]) -> NDArray[np.complex128]:
        return np.asarray(
            scipy.fft.ifft(spectrum)[: self.shape[0] * self.shape[1]].reshape(self.shape)
        )

    def changes(self, slope: NDArray[np.complex128]) -> tuple[Estimate, Estimate] | None:
        """Change over time and level of what has these derivatives, (n_sensors, n_lines).

        A line through δ over time and level, with a standard deviation from the scatter (HC3).
        """
        projected, weight = np.zeros((2, self.shape[0]))
        for each in self._sensors:
            moved = self._over_time(each.gain * slope[each.row] * self.force / each.noise)
            projected += np.sum((moved.conj() * each.rest).real, axis=1)
            weight += np.sum(_squared(moved), axis=1)
        time, level = (np.arange(self.shape[0]) + 0.5) * PIECE_S, np.sqrt(self._power)
        usable = (time > _SETTLING_S) & (weight > 0)
        if np.count_nonzero(usable) < _FEWEST_PIECES:
            return None
        weight = weight[usable]
        delta = projected[usable] / weight
        level = level[usable] / np.average(level[usable], weights=weight) - 1
        columns = [np.ones(weight.size), time[usable] / self.duration_s - 0.5, level]
        found, std = _line(np.column_stack(columns), delta, weight)
        # Where few pieces hold all the power, they are few values.
        freedom = float(max(weight.sum() ** 2 / np.sum(weight**2) - 3, 1.0))
        over_time, over_level = (Estimate(found[k], std[k], freedom) for k in (1, 2))
        return over_time, over_level


def _squared(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """|z|², without the root that np.abs takes."""
    return values.real**2 + values.imag**2


def _sweeps(force: NDArray[np.complex128], n_pieces: int, step: int) -> bool:
    """Whether the frequency that is excited moves over the band in time."""
    signal = scipy.fft.ifft(force, 2 * force.size)
    turn = (signal[1:] * signal[:-1].conj())[: 2 * n_pieces * step - 1]
    turn = np.append(turn, 0).reshape(n_pieces, -1)
    power = np.abs(turn).sum(axis=1)
    centre = np.angle(turn.sum(axis=1)) / np.pi  # 0 at one end of the band, 1 at the other
    mean = np.average(centre, weights=power)
    return bool(np.sqrt(np.average((centre - mean) ** 2, weights=power)) > _SWEEPING)


def _sensors(run: Run, frf: FRF, most: int) -> list[tuple[Response, int]]:
    """Up to so many sensors of a run with their rows, spread over the run."""
    place = np.where(np.isfinite(frf.position_deg), np.round(frf.position_deg, 6), frf.node)
    rows = {float(key): row for row, key in enumerate(place)}

    def key(response: Response) -> float:
        if response.position_deg is not None:
            return float(np.round(response.position_deg, 6))
        return float(-1 if response.node is None else response.node)

    known = [(each, rows[key(each)]) for each in run.responses if key(each) in rows]
    chosen = np.unique(np.linspace(0, len(known) - 1, min(most, _SENSORS, len(known))).astype(int))
    return [known[k] for k in chosen]


def _spectrum(channel: Channel, n_samples: int) -> NDArray[np.complex128]:
    samples = channel.block(0, n_samples)
    return np.asarray(scipy.fft.rfft(samples - samples.mean()))


def _as_acceleration(
    channel: Channel, n_samples: int, lines: slice, omega: NDArray[np.float64]
) -> NDArray[np.complex128]:
    seen, power = _spectrum(channel, n_samples)[lines], DERIVATIVES.get(channel.quantity, 0)
    return np.asarray(seen * (1j * omega) ** power if power else seen)


class _Predicted:
    """FRFs of some rows in the state of a run, and their derivative to a change of modes.

    They are computed as closely as the sharpest resonance needs.
    """

    def __init__(
        self, model: ModalModel, run: str, rows: NDArray[np.int_], omega: NDArray[np.float64]
    ) -> None:
        poles, residues = model.poles_and_residues(as_measured=True)
        self.model, self.rows, self.omega = model, rows, omega
        self.poles, self.residues = model.drift.poles_in(run, poles), residues[rows]
        sharpest = 2 * float(np.min(-poles.real, initial=np.inf))
        step = int(min(sharpest / _PER_BANDWIDTH / (omega[1] - omega[0]), omega.size))
        self._coarse = omega if step < 2 else np.append(omega[:-1:step], omega[-1])

    @property
    def values(self) -> NDArray[np.complex128]:
        """Inertances, (n_rows, n_lines)."""
        # R/(jω − s) and its mirror image have one denominator and a real numerator in jω.
        turned = self.residues * self.poles.conj()
        parts = turned.real, self.residues.real
        constant, linear = _real_sums(self._both(slice(None)), *parts)
        terms, omega = self.model.residual_terms, self._coarse
        modal = 2 * (1j * omega * linear - constant) + terms.upper[self.rows, None]
        return self._on_all_lines(-(omega**2) * modal + terms.lower[self.rows, None])

    def slope(self, modes: NDArray[np.int_] | slice | None = None) -> NDArray[np.complex128]:
        """Derivative to a common relative change of some poles, by default all that are listed."""
        modes = slice(len(self.model.modes)) if modes is None else modes
        own, residues, omega = self.poles[modes], self.residues[:, modes], self._coarse
        size = np.abs(own) ** 2
        parts = size * (residues * own.conj()).real, size * residues.real, (own * residues).real
        constant, linear, square = _real_sums(self._both(modes) ** 2, *parts)
        slope = 2 * (constant - 2j * omega * linear - omega**2 * square)
        return self._on_all_lines(-(omega**2) * slope)

    def _both(self, modes: NDArray[np.int_] | slice) -> NDArray[np.complex128]:
        own, s = self.poles[modes, None], 1j * self._coarse
        return np.asarray(1 / ((s - own) * (s - own.conj())))

    def _on_all_lines(self, values: NDArray[np.complex128]) -> NDArray[np.complex128]:
        if self._coarse is self.omega:
            return values
        return np.array([np.interp(self.omega, self._coarse, row) for row in values])


def _real_sums(
    functions: NDArray[np.complex128], *factors: NDArray[np.float64]
) -> list[NDArray[np.complex128]]:
    """Sums over complex functions (rows), each set of them with real factors."""
    return [(each @ functions.view(float)).view(complex) for each in factors]


def _line(
    columns: NDArray[np.float64], values: NDArray[np.float64], weight: NDArray[np.float64]
) -> tuple[list[float], list[float]]:
    """Weighted fit of columns, and standard deviations from the scatter (HC3)."""
    inverse = np.linalg.pinv(columns.T @ (weight[:, None] * columns))
    found = inverse @ columns.T @ (weight * values)
    leverage = weight * np.einsum("ka,ab,kb->k", columns, inverse, columns)
    rest = weight * (values - columns @ found) / np.maximum(1 - leverage, 0.1)
    score = columns * rest[:, None]
    std = np.sqrt(np.diag(inverse @ score.T @ score @ inverse))
    return found.tolist(), std.tolist()
