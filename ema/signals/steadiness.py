"""Steadiness of the tyre within a run: change of its frequencies over time and with level.

What the response differs by from its prediction is projected, piece by piece, on what a common
relative change δ of all frequencies would add (docs/identification.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import ifft, rfft
from scipy.ndimage import uniform_filter1d
from scipy.special import stdtr

from ema.core.campaign import Response, Run
from ema.core.finding import Check, Finding, Verdict
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
_PIECE_S = 0.25
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
        return float(2 * stdtr(self.freedom, -abs(self.value) / max(self.std, 1e-300)))


@dataclass(frozen=True)
class Steadiness:
    """What one run shows."""

    run: str
    over_time: Estimate  # change from its start to its end
    over_level: Estimate | None  # if the level doubles; None for a sweep: one mode after the other


def steadiness_of(runs: Sequence[Run], frf: FRF, model: ModalModel) -> list[Steadiness]:
    """What each run shows, where something can be said.

    `frf` are the FRFs that the modes were fitted to; its rows are those of `model`.
    """
    with ThreadPoolExecutor(available_threads()) as pool:  # transforms let other threads work
        found = pool.map(lambda run: run_steadiness(run, frf, model), runs)
        return [each for each in found if each is not None]


def steadiness_findings(
    found: Sequence[Steadiness], model: ModalModel, settings: CheckSettings = CHECKS
) -> list[Finding]:
    """Findings about changes within each run, and about the dependence on level."""
    findings = [_within_run(each, model, settings) for each in found]
    levels = [each.over_level for each in found if each.over_level is not None]
    return findings + ([_level(levels, settings)] if levels else [])


def with_changes_within_runs(
    model: ModalModel, found: Sequence[Steadiness], settings: CheckSettings = CHECKS
) -> ModalModel:
    """The model with what changes within the runs add to the damping ratios in their ±."""
    changes = [each.over_time for each in found]
    added = [
        _added_damping(each.value, model) * (each.p_value < settings.steadiness_p_value)
        for each in changes
    ]
    if not np.any(added):
        return model
    std = np.mean(added, axis=0) * model.damping_ratios
    covariance = np.array(model.covariance)
    covariance[np.diag_indices_from(covariance)] += np.ravel([(0.0, each**2) for each in std])
    modes = [
        replace(mode, damping_std=float(np.hypot(mode.damping_std, each)))
        for mode, each in zip(model.modes, std, strict=True)
    ]
    return replace(model, modes=tuple(modes), covariance=covariance)


def run_steadiness(run: Run, frf: FRF, model: ModalModel) -> Steadiness | None:
    """Change of the frequencies within one run; None where nothing can be said.

    Of several forces at the same time, the FRF against one does not predict the response.
    """
    if len(run.forces) > 1:
        return None
    rate = run.recording.sampling_rate_hz
    n = min(run.recording.n_samples, _MOST_SAMPLES)
    first, last = (int(f * n / rate) for f in model.band_hz)
    last = min(last, n // 2)
    step = max(round(_PIECE_S * (last - first) * rate / n), 1)
    n_pieces = (last - first) // step
    force = _spectrum(run.force, n)[first:last]
    sensors = _sensors(run, frf, max(_SAMPLES_OF_ALL // n, _FEWEST_SENSORS))
    if not np.all(np.isfinite(force)) or n_pieces < _FEWEST_PIECES or not sensors:
        return None
    omega = 2 * np.pi * np.arange(first, last) * rate / n
    rows = np.array([row for _, row in sensors])
    expected, slope = (part * force for part in _on_all_lines(model, run.name, rows, omega))
    smoothing = max(int(_SMOOTHING_HZ * n / rate), 1)
    steady = max(int(_STEADY_HZ * n / rate), _STEADY_LINES)
    pieces = _Pieces(n_pieces, step, force, steady)
    for (sensor, _), own, moved in zip(sensors, expected, slope, strict=True):
        power = DERIVATIVES.get(sensor.channel.quantity, 0)
        seen = _spectrum(sensor.channel, n)[first:last]
        seen = seen * (1j * omega) ** power if power else seen
        pieces.add(seen, own, moved, smoothing)
    time = np.asarray((np.arange(n_pieces) + 0.5) * _PIECE_S)
    over_time, over_level = _regression(pieces, time, n / rate) or (None, None)
    if over_time is None:
        return None
    return Steadiness(run.name, over_time, None if _sweeps(force, n_pieces, step) else over_level)


class _Pieces:
    """Sums over the sensors of a run, piece by piece."""

    def __init__(
        self, n_pieces: int, step: int, force: NDArray[np.complex128], steady_lines: int
    ) -> None:
        self.n_samples, self.shape = n_pieces * step, (n_pieces, step)
        self.force, self.steady_lines = force, steady_lines
        power = uniform_filter1d(_squared(force), steady_lines, mode="nearest")
        self.force_power = np.maximum(power, 1e-300)
        self.projected, self.weight, self.power = np.zeros((3, n_pieces))

    def add(
        self,
        seen: NDArray[np.complex128],
        expected: NDArray[np.complex128],
        moved: NDArray[np.complex128],
        smoothing: int,
    ) -> None:
        """Add a sensor, unless the modes do not explain what it shows."""
        own = max(float(np.vdot(expected, expected).real), 1e-300)
        gain = float(np.vdot(expected, seen).real) / own
        rest = self._unsteady(seen - gain * expected)
        left, there = _squared(rest), float(np.vdot(seen, seen).real)
        if not np.isfinite(there) or not left.sum() < _UNEXPLAINED * there:
            return
        noise = np.sqrt(uniform_filter1d(left, smoothing, mode="nearest"))
        noise = np.maximum(noise, 1e-12 * np.sqrt(_squared(seen).max()))
        rest, moved = self._over_time(rest / noise), self._over_time(gain * moved / noise)
        self.projected += np.sum((moved.conj() * rest).real, axis=1)
        self.weight += np.sum(_squared(moved), axis=1)
        self.power += np.sum(_squared(self._over_time(seen)), axis=1) / there

    def _unsteady(self, rest: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Of what the modes do not explain, what no smooth transfer function explains either."""
        crossed = rest * self.force.conj()
        crossed = uniform_filter1d(crossed, self.steady_lines, mode="nearest")
        return np.asarray(rest - self.force * crossed / self.force_power)

    def _over_time(self, spectrum: NDArray[np.complex128]) -> NDArray[np.complex128]:
        return np.asarray(ifft(spectrum)[: self.n_samples].reshape(self.shape))


def _squared(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """|z|², without the root that np.abs takes."""
    return values.real**2 + values.imag**2


def _sweeps(force: NDArray[np.complex128], n_pieces: int, step: int) -> bool:
    """Whether the frequency that is excited moves over the band in time."""
    signal = ifft(force, 2 * force.size)
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
    return np.asarray(rfft(samples - samples.mean()))


def _on_all_lines(
    model: ModalModel, run: str, rows: NDArray[np.int_], omega: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """As `_response`, which is computed as closely as its sharpest resonance needs."""
    poles, _ = model.poles_and_residues(as_measured=True)
    sharpest = 2 * float(np.min(-poles.real, initial=np.inf))
    step = int(min(sharpest / _PER_BANDWIDTH / (omega[1] - omega[0]), omega.size))
    if step < 2:
        return _response(model, run, rows, omega)
    coarse = np.append(omega[:-1:step], omega[-1])
    values, slopes = (
        np.array([np.interp(omega, coarse, row) for row in part])
        for part in _response(model, run, rows, coarse)
    )
    return values, slopes


def _response(
    model: ModalModel, run: str, rows: NDArray[np.int_], omega: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """FRFs of some rows in the state of a run, and their derivative to a common change."""
    poles, residues = model.poles_and_residues(as_measured=True)
    poles, residues = model.drift.poles_in(run, poles), residues[rows]
    # R/(jω − s) and its mirror image have one denominator and a real numerator in jω.
    both = 1 / ((1j * omega - poles[:, None]) * (1j * omega - poles[:, None].conj()))
    terms, turned = model.residual_terms, residues * poles.conj()
    constant, linear = _real_sums(both, turned.real, residues.real)
    modal = 2 * (1j * omega * linear - constant)
    values = -(omega**2) * (modal + terms.upper[rows, None]) + terms.lower[rows, None]
    listed = slice(len(model.modes))
    own, residues, both = poles[listed], residues[:, listed], both[listed]
    size = np.abs(own) ** 2
    parts = size * turned[:, listed].real, size * residues.real, (own * residues).real
    constant, linear, square = _real_sums(both**2, *parts)
    slope = 2 * (constant - 2j * omega * linear - omega**2 * square)
    return values, -(omega**2) * slope


def _real_sums(
    functions: NDArray[np.complex128], *factors: NDArray[np.float64]
) -> list[NDArray[np.complex128]]:
    """Sums over complex functions (rows), each set of them with real factors."""
    return [(each @ functions.view(float)).view(complex) for each in factors]


def _regression(
    pieces: _Pieces, time: NDArray[np.float64], duration_s: float
) -> tuple[Estimate, Estimate] | None:
    """Line through δ over time and level, with a standard deviation from the scatter (HC3)."""
    level = np.sqrt(pieces.power)
    usable = (time > _SETTLING_S) & (pieces.weight > 0)
    if np.count_nonzero(usable) < _FEWEST_PIECES:
        return None
    weight = pieces.weight[usable]
    delta = pieces.projected[usable] / weight
    level = level[usable] / np.average(level[usable], weights=weight) - 1
    columns = np.column_stack([np.ones(weight.size), time[usable] / duration_s - 0.5, level])
    inverse = np.linalg.pinv(columns.T @ (weight[:, None] * columns))
    found = inverse @ columns.T @ (weight * delta)
    leverage = weight * np.einsum("ka,ab,kb->k", columns, inverse, columns)
    rest = weight * (delta - columns @ found) / np.maximum(1 - leverage, 0.1)
    score = columns * rest[:, None]
    std = np.sqrt(np.diag(inverse @ score.T @ score @ inverse))
    # Where few pieces hold all the power, they are few values.
    freedom = float(max(weight.sum() ** 2 / np.sum(weight**2) - 3, 1.0))
    over_time, over_level = (Estimate(float(found[k]), float(std[k]), freedom) for k in (1, 2))
    return over_time, over_level


def _within_run(seen: Steadiness, model: ModalModel, settings: CheckSettings) -> Finding:
    found, verdict = seen.over_time, Verdict.OK
    detail = (
        f"natural frequencies {100 * found.value:+.3f} ± {100 * found.std:.3f} % from start to end"
    )
    if found.p_value < settings.steadiness_p_value:
        broader = _added_damping(found.value, model)
        mode = model.modes[int(np.argmax(broader))]
        detail += (
            f"; modes are averages over the run, and damping ratios up to {100 * broader.max():.2g}"
            f" % of their value too high (at {mode.frequency_hz:.0f} Hz)"
        )
        if abs(found.value) >= settings.steady_change:
            verdict = Verdict.WARNING
            detail += ". Let the tyre settle (temperature, pressure), or record less at a time"
    else:
        detail += "; no more than chance"
    return Finding(seen.run, "", None, Check.WITHIN_RUN, verdict, detail)


def _added_damping(change: float, model: ModalModel) -> NDArray[np.float64]:
    """Relative error of each damping ratio if frequencies change evenly by a share in a run.

    The mean of 1/(jω − s) over s with variance v is 1/(jω − s) − v/(jω − s)³, to which one pole
    fits best (least squares over all lines) with a decay rate larger by v/σ; v = (ω change)²/12.
    """
    return np.asarray(change**2 / (12 * model.damping_ratios**2))


def _level(found: Sequence[Estimate], settings: CheckSettings) -> Finding:
    """Dependence on level, of all runs together."""
    value, std = np.array([(each.value, each.std) for each in found]).T
    weight = 1 / np.maximum(std, 1e-12) ** 2
    mean = float(np.average(value, weights=weight))
    # Runs that differ by more than their own ± count by how they differ.
    spread = float(np.sum(weight * (value - mean) ** 2)) / max(len(found) - 1, 1)
    error = float(np.sqrt(max(1.0, spread) / weight.sum()))
    p_value = Estimate(mean, error, sum(each.freedom for each in found)).p_value
    verdict = Verdict.OK
    detail = f"natural frequencies {100 * mean:+.3f} ± {100 * error:.3f} % where the level doubles"
    if not p_value < settings.steadiness_p_value:
        detail += "; no more than chance"
    elif abs(mean) >= settings.steady_change / 2:
        verdict, softer = Verdict.WARNING, "softer" if mean < 0 else "stiffer"
        detail += (
            f" for {_PIECE_S:g} s, and more where it stays high: the tyre is {softer} at higher "
            "level. Modes hold for the level of this test, and damping ratios are too high; "
            "compare with a test at another level"
        )
    return Finding("", "", None, Check.LEVEL_DEPENDENCE, verdict, detail)
