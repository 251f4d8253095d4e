"""Bias of FRFs by leakage, and the noise that blocks leave."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ema.core.frf import FRF, ForceRecord
from ema.core.numerics import kept_with, readonly
from ema.core.recording import BlockPlan

#: Lines over which the noise level is smoothed: σ of one is itself uncertain, or that of a tone.
SMOOTHING_LINES = 21
# A line whose σ is this many times the level around it carries hum or another tone.
_SPIKE = 3.0
# A line of the mains whose FRF is off the middle of its neighbours by so many times what it is two
# lines farther on carries a tone: a resonance would have to be 20 times narrower than a line.
_MAINS_HZ, _OFF = (50.0, 60.0), 100.0
# Of σ of a line that counts no more.
_LEFT_OUT, _SAYS_NOTHING = 100.0, 50.0
# Coherence below this says nothing; in a file it is rounded to steps of about this.
_LEAST_COHERENCE, _COHERENCE_STEP = 1e-3, 1e-5
# Averages and lines that one value rests on: noise alone has a coherence of about 1/20.
_VALUES = 20
# Rows that agree within this are multiples of each other.
_SAME_ROW = 1e-9
# Lines that a window mixes: those with at least this share of the largest, and how many.
_LEAST_TERM, _MOST_TERMS = 1e-5, 999
_AT_ONCE = 1 << 16  # numbers: they stay near the processor


def noise_level(frf: FRF, lines: slice) -> NDArray[np.float64]:
    """Standard deviation to weigh each of some lines with, (n_positions, n_frequencies).

    Smoothed over neighbouring lines, except where a line sticks out. Where σ is unknown, the
    coherence gives the weights; without it, lines are taken as equally good relative to the FRFs
    around them.
    """
    values = frf.values[:, lines]
    floor = max(1e-12 * np.max(np.abs(values)) ** 2, np.finfo(float).tiny)
    if not np.all(np.isfinite(frf.std[:, lines])):
        coherence = frf.coherence[:, lines]
        if np.isnan(frf.n_effective) and np.all(np.isfinite(coherence)):  # 1 of one average
            power = incoherent_power(values, coherence)
        else:
            power = np.broadcast_to(np.mean(np.abs(values) ** 2, axis=0), values.shape)
        smooth = _smoothed(power)
        return np.asarray(np.sqrt(np.maximum(smooth, floor)))
    power = frf.std[:, lines] ** 2
    around = _median_level(frf, lines.start, lines.stop)
    spikes = power > _SPIKE**2 * around
    smooth = _smoothed(np.where(spikes, around, power))
    return np.asarray(np.sqrt(np.maximum(np.where(spikes, power, smooth), floor)))


def incoherent_power(
    values: NDArray[np.complex128], coherence: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Power of what is not coherent with the force, |H|² (1 − γ²)/γ²."""
    known = np.clip(coherence, _LEAST_COHERENCE, 1 - _COHERENCE_STEP)
    return np.asarray(np.abs(values) ** 2 * (1 - known) / known)


def without_spikes(
    frf: FRF, lines: slice, values: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """FRFs with lines that carry a tone, such as mains hum, replaced from their neighbours.

    In an impulse response a tone never decays and looks like a mode without damping.
    """
    std = frf.std[:, lines]
    if not np.all(np.isfinite(std)):
        return values
    spikes = std**2 > _SPIKE**2 * _median_level(frf, lines.start, lines.stop)
    number = np.arange(values.shape[1])
    for row in np.flatnonzero(spikes.any(axis=1)):
        good = ~spikes[row]
        values[row] = np.interp(number, number[good], values[row, good])
    return values


def with_coherent_tones(frf: FRF) -> FRF:
    """FRFs without weight on lines of the mains whose tones keep their phase in all blocks.

    Blocks of a force that repeats are often whole periods of the mains as well: nothing scatters.
    """
    if not np.all(np.isfinite(frf.std)) or frf.frequency_hz.size < 7:
        return frf
    lines, std = _of_mains(frf.frequency_hz), frf.std.copy()
    off, before, after = (_off_its_neighbours(frf.values, lines + k) for k in (0, -2, 2))
    beside = np.maximum(np.fmax(before, after), np.finfo(float).tiny)
    tones = np.median(off / beside, axis=0) > _OFF
    std[:, lines[tones]] = np.hypot(std[:, lines[tones]], _LEFT_OUT * off[:, tones])
    return replace(frf, std=std)


def _off_its_neighbours(
    values: NDArray[np.complex128], lines: NDArray[np.int_]
) -> NDArray[np.float64]:
    middle = (values[:, lines - 1] + values[:, lines + 1]) / 2
    return np.asarray(np.abs(values[:, lines] - middle))


def _of_mains(frequency_hz: NDArray[np.float64]) -> NDArray[np.int_]:
    """Lines at multiples of the mains, none of the first and last three."""
    inside = frequency_hz[3:-3, None]
    number = np.round(inside / _MAINS_HZ)
    away = np.abs(inside - number * _MAINS_HZ)
    near = (number > 0) & (away < np.median(np.diff(frequency_hz)) / 4)
    return 3 + np.flatnonzero(near.any(axis=1))


def without_left_out_lines(frf: FRF) -> FRF:
    """FRFs with lines that say nothing in most rows, σ far above them, as their neighbours are."""
    size = np.maximum(np.abs(frf.values), np.finfo(float).tiny)
    nothing = np.median(frf.std / size, axis=0) > _SAYS_NOTHING
    if not np.any(nothing) or np.all(nothing):
        return frf
    number = np.arange(nothing.size)
    values = [np.interp(number, number[~nothing], row[~nothing]) for row in frf.values]
    return replace(frf, values=np.array(values))


@kept_with
def _median_level(frf: FRF, start: int | None, stop: int | None) -> NDArray[np.float64]:
    """Median noise power around each line; both pole estimators and the fit ask for it."""
    power = frf.std[:, start:stop] ** 2  # row by row takes a seventh of the time of all at once
    return readonly(
        [scipy.ndimage.median_filter(row, SMOOTHING_LINES, mode="nearest") for row in power]
    )


def _smoothed(power: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over neighbouring lines; a running sum would lose the digits of small values."""
    mean = np.full(SMOOTHING_LINES, 1 / SMOOTHING_LINES)
    return np.asarray(scipy.ndimage.correlate1d(power, mean, mode="nearest"))


def line_coherence(frf: FRF) -> NDArray[np.float64]:
    """Coherence of each row as if neighbouring lines were further averages of one FRF.

    A response has a smooth FRF, noise has not. Lower than the coherence where an FRF changes
    within a few lines, in all rows alike. NaN where the force of a row is not known, and without a
    coherence.
    """
    found = np.full(frf.values.shape, np.nan)
    run, least = np.array(frf.run), np.finfo(float).tiny
    for name, record in frf.exact_forces.items():
        rows = run == name
        width = max(-(-_VALUES // record.plan.n_blocks), 1)
        force = _force_power(record)
        cross = frf.values[rows] * force
        power = np.abs(frf.values[rows]) ** 2 * force / np.maximum(frf.coherence[rows], least)
        cross, power, force = (
            scipy.ndimage.uniform_filter1d(each, width) for each in (cross, power, force)
        )
        found[rows] = np.abs(cross) ** 2 / np.maximum(force * power, least)
    return found


def force_density(record: ForceRecord) -> NDArray[np.float64]:
    """One-sided power spectral density of a run's force on the lines of its blocks, N²/Hz."""
    plan = record.plan
    share = plan.n_blocks * plan.block_samples * plan.sampling_rate_hz
    return 2 * _force_power(record) / share


@kept_with
def _force_power(record: ForceRecord) -> NDArray[np.float64]:
    """Power of the force on the lines, summed over the blocks."""
    plan = record.plan
    total = np.zeros(plan.frequency_hz.size)
    for start in plan.starts:
        block = record.force.block(start, start + plan.block_samples)
        spectrum = np.fft.rfft((block - block.mean()) * plan.taper)
        total += np.abs(spectrum[1 : total.size + 1]) ** 2
    return readonly(total)


def has_leakage(frf: FRF) -> bool:
    """Whether blocks were averaged whose ends cut the response."""
    plan = frf.blocks
    return plan is not None and plan.n_blocks > 1 and not plan.is_one_period


def leakage_bias(
    frf: FRF,
    frequency_hz: NDArray[np.float64],
    poles: Mapping[str, NDArray[np.complex128]],
    residues: NDArray[np.complex128],
) -> NDArray[np.complex128]:
    """Error of estimated inertances of given modes, to be subtracted: (n_positions, n_frequencies).

    `frequency_hz` are some lines of `frf`, which has blocks; `poles`, (n_modes,), are in the state
    of each run; `residues` are (n_positions, n_modes).
    """
    return leakage_of(frf, frequency_hz, poles)(residues)


def leakage_of(
    frf: FRF, frequency_hz: NDArray[np.float64], poles: Mapping[str, NDArray[np.complex128]]
) -> Callable[[NDArray[np.complex128]], NDArray[np.complex128]]:
    """`leakage_bias` of given poles as a function of the residues; the poles are what costs."""
    plan = frf.blocks
    assert plan is not None
    lines = np.round(frequency_hz * plan.block_s).astype(int)
    exact = _rows_with_force(frf)
    of_force = {name: _of_force(frf.exact_forces[name], lines, poles[name]) for name in exact}
    of_noise: dict[bytes, NDArray[np.complex128]] = {}  # runs in the same state share it
    for own in poles.values() if not plan.event_starts else ():
        if own.tobytes() not in of_noise:
            of_noise[own.tobytes()] = _of_noise(plan, np.append(lines, -lines), own)
    run = np.array(frf.run)

    def bias_of(residues: NDArray[np.complex128]) -> NDArray[np.complex128]:
        bias = np.zeros((frf.n_positions, frequency_hz.size), dtype=complex)
        for name, own in poles.items():
            rows, force_rows = run == name, exact.get(name)
            if plan.event_starts:  # blocks in which the response rings out
                if force_rows is not None:
                    bias[force_rows] = residues[force_rows] @ of_force[name]
                continue
            direct, mirrored = np.split(of_noise[own.tobytes()], 2, axis=1)
            bias[rows] = residues[rows] @ direct + residues[rows].conj() @ mirrored.conj()
            if force_rows is not None:
                bias[force_rows] += residues[force_rows] @ (of_force[name] - direct)
        return bias

    return bias_of


def bias_as_before(
    frf: FRF,
    values: NDArray[np.complex128],
    before: FRF,
    values_before: NDArray[np.complex128],
    bias: NDArray[np.complex128],
) -> NDArray[np.complex128] | None:
    """Bias of other rows of the same measurement, from that of the rows `before`.

    `values` and `values_before` are those of the rows on the same lines, without compensation. A
    row that was flipped or scaled has its bias flipped or scaled. None where a row was not there,
    or is no multiple of what it was, and where the noise of the rows allows more lines or fewer.
    """
    names, known = (
        list(zip(each.run, each.channel, each.node.tolist(), strict=True)) for each in (frf, before)
    )
    place = {name: row for row, name in enumerate(known)}
    if len(place) < len(known) or not place.keys() >= set(names):
        return None
    if values.shape[1] != values_before.shape[1]:
        return None
    rows = [place[name] for name in names]
    own = values_before[rows]
    power = np.maximum(np.sum(np.abs(own) ** 2, axis=1), np.finfo(float).tiny)
    gain = (np.sum(own.conj() * values, axis=1) / power)[:, None]
    same = np.allclose(values, gain * own, rtol=_SAME_ROW, atol=0.0)
    return np.asarray(gain * bias[rows]) if same else None


def _rows_with_force(frf: FRF) -> dict[str, NDArray[np.int_]]:
    """Rows of each run whose force is known and whose blocks were all used."""
    run = np.array(frf.run)
    whole = frf.missing == 0 if frf.missing.size else np.ones(frf.n_positions, dtype=bool)
    found = {name: np.flatnonzero((run == name) & whole) for name in frf.exact_forces}
    return {name: rows for name, rows in found.items() if rows.size}


def _of_force(
    record: ForceRecord, lines: NDArray[np.int_], poles: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Error of each pole for the force as recorded, (n_poles, n_lines).

    A block sees y_k = z y_{k−1} + Δt f_k, z = e^{sΔt}: on its lines
    Y = (Δt F + x₀ − x₁)/(1 − z e^{−jωΔt}), x = z y before its first sample and at its last one. A
    window mixes lines.
    """
    plan = record.plan
    seen = _seen_force(record, tuple(lines.tolist()))
    step_s = 1 / plan.sampling_rate_hz
    decay = np.exp(poles * step_s)
    first, last = _states(record, decay)
    ends = (first - last).T @ seen.weight
    error = np.zeros((poles.size, lines.size), dtype=complex)
    for offset, share, force in zip(seen.offset, seen.share, seen.force, strict=True):
        turn = np.exp(-2j * np.pi * (lines - offset) / plan.block_samples)
        # The window's mean comes with the lines themselves, from which the true FRF is subtracted.
        error += (share * (force + ends) - (offset == 0)) / (1 - decay[:, None] * turn)
    return np.asarray(step_s * poles[:, None] ** 2 * error)


@dataclass(frozen=True)
class _SeenForce:
    """Force of a run as its blocks see it on some lines."""

    offset: NDArray[np.int_]  # (n_terms,), between the lines that the window mixes
    share: NDArray[np.complex128]  # (n_terms,), of each in the mixture
    weight: NDArray[np.complex128]  # (n_blocks, n_lines), of each block in H1
    force: NDArray[np.complex128]  # (n_terms, n_lines), of the mixed lines, weighed


@kept_with
def _seen_force(record: ForceRecord, chosen: tuple[int, ...]) -> _SeenForce:
    """The window's terms, and the force on some lines; no pole matters."""
    plan, lines = record.plan, np.array(chosen)
    n = plan.block_samples
    terms = scipy.fft.fft(plan.taper) / n
    largest = np.argsort(-np.abs(terms), kind="stable")[:_MOST_TERMS]
    largest = largest[np.abs(terms[largest]) > _LEAST_TERM * np.abs(terms[largest[0]])]
    offset, share = np.where(largest > n // 2, largest - n, largest), terms[largest]
    weight = np.empty((plan.n_blocks, lines.size), dtype=complex)
    mixed = np.zeros((offset.size, lines.size), dtype=complex)
    place = lines - offset[:, None]
    mirrored = (place < 0) | (place > n // 2)
    place = np.minimum(np.abs(place), n - np.abs(place))
    windows, starts = sliding_window_view(_force(record), n), np.array(plan.starts)
    at_once = max(_AT_ONCE // max(place.size, n), 1)
    for number in range(0, plan.n_blocks, at_once):
        here = slice(number, number + at_once)
        found = scipy.fft.rfft(windows[starts[here]])[:, place]
        np.conj(found, out=found, where=mirrored)
        weight[here] = (share @ found).conj()
        found *= weight[here, None]
        mixed += found.sum(axis=0)
    power = np.maximum(np.sum(weight.real**2 + weight.imag**2, axis=0), np.finfo(float).tiny)
    return _SeenForce(offset, share, weight / power, mixed / power)


@kept_with
def _force(record: ForceRecord) -> NDArray[np.float64]:
    """Force of all blocks, without its mean."""
    force = record.force.block(0, record.plan.starts[-1] + record.plan.block_samples)
    return readonly(force - force.mean())


def _states(
    record: ForceRecord, decay: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """States before and after every block over Δt, (n_blocks, n_poles).

    What came before the recording is taken to resemble its end; it has rung out within the first
    block.
    """
    starts = np.array(record.plan.starts)
    stops = starts + record.plan.block_samples
    bounds = np.unique(np.concatenate([[0], starts, stops]))
    lengths, force = np.diff(bounds), _force(record)
    longest = int(lengths.max())
    if np.all(lengths == longest):
        parts = force.reshape(-1, longest)
    else:
        parts = np.zeros((lengths.size, longest))
        for row, (start, stop) in enumerate(pairwise(bounds.tolist())):
            parts[row, longest - (stop - start) :] = force[start:stop]
    powers = np.vander(decay, longest + 1)[:, :-1]  # e^{sΔt} to the power of longest … 1
    real, imag = np.split(np.concatenate([powers.real, powers.imag]) @ parts.T, 2)
    gained = (real + 1j * imag).T
    kept = decay ** lengths[:, None]
    states = np.zeros((bounds.size, decay.size), dtype=complex)
    for _ in range(2):  # around once, to begin with the state at the end
        states[0] = states[-1]
        for row in range(bounds.size - 1):
            states[row + 1] = kept[row] * states[row] + gained[row]
    return states[np.searchsorted(bounds, starts)], states[np.searchsorted(bounds, stops)]


def _of_noise(
    plan: BlockPlan, lines: NDArray[np.int_], poles: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Δφ on some lines, (n_modes, n_lines)."""
    n, step_s = plan.block_samples, 1 / plan.sampling_rate_hz
    correlation = scipy.fft.irfft(np.abs(scipy.fft.rfft(plan.taper, 2 * n)) ** 2)[:n] / n
    decay = np.vander(np.exp(poles * step_s), n, increasing=True)
    inside = scipy.fft.fft((correlation - 1) * decay)[:, lines]
    # Beyond one block r is zero: there the whole response is missing. e^{−jωT} = 1 on the lines.
    turn = np.exp(-2j * np.pi * lines / n)
    beyond = np.exp(poles * n * step_s)[:, None] / (1 - np.exp(poles * step_s)[:, None] * turn)
    return np.asarray(step_s * poles[:, None] ** 2 * (inside - beyond))
