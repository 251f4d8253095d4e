"""The measuring chain of a laboratory: force, responses, sensors and converter.

Responses are exact for the stated force: its spectrum over a period longer than the recording is
multiplied by the exact inertance, so what happened before the recording is right as well. Where
poles move within a run, q' = s(t) q + b f is solved exactly for every mode by the substitution
q = exp(∫(s − s₀)dt) p, which leaves a constant pole s₀ and a modulated force.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from pipelines.simulate.campaign import HUM_HZ, OFFSET_M_S2, noise_spectrum, scaled
from pipelines.simulate.laboratory_effects import Effects, Excitation
from pipelines.simulate.truth import Complexes, Floats, System

SETTLING_S = 3.0  # kept before the recording; the slowest mode decays to e^-12 and less
DEAD = 1e-4  # of the signal is left of a dead sensor
RANGE_OVER_PEAK = 1.25  # full scale of the converter over the largest sample

# Electrodynamic shaker of 100 N: what moves with the tyre, on its suspension.
ARMATURE_KG, SUSPENSION_HZ, SUSPENSION_DAMPING = 0.25, 12.0, 0.1

PINK_HZ = 30.0  # a pink force falls with 1/f of its power above this frequency
BURST_SHARE = (0.4, 0.6)
BURST_RAMP_S = 0.02
HIT_PEAK_N = (40.0, 120.0)
HIT_LENGTH_S = (2.0e-3, 3.5e-3)
SHORTEST_HIT_DISTANCE_S = 0.8
BOUNCE_S = (0.015, 0.06)
BOUNCE_PEAK = (0.2, 0.7)
LARGEST_GROWTH = 10.0  # span of the exponent of the substitution; e^10 leaves eleven digits
LEVEL_TIME_S = 0.05  # softening follows the level smoothed over this time


@dataclass(frozen=True, eq=False)
class Mounting:
    """Where the sensors of a run are and how they see."""

    declared_deg: Floats  # angles in the manifest; shape (n_sensors,), as all below
    actual_deg: Floats  # angles on the tyre
    tilt_deg: Floats  # of the sensor's axis against the radius
    gain: Floats  # sensitivity over the declared one
    delay_s: Floats  # of the channel


@dataclass(frozen=True, eq=False)
class Driven:
    """A tyre under a force and its sensors; the spectrum is that of the force over a period."""

    system: System
    rows: Floats  # motion of the sensors in the coordinates of the tyre
    spectrum: Complexes
    omega: Floats
    mounting: Mounting

    @property
    def period(self) -> int:
        """Samples of the period."""
        return 2 * (self.omega.size - 1)

    def seen(self, spectra: Complexes) -> Floats:
        """Accelerations over the period, with gain and delay of the channels."""
        delayed = np.exp(-1j * self.omega * self.mounting.delay_s[:, None])
        spectra = spectra * delayed * self.mounting.gain[:, None]
        return np.asarray(scipy.fft.irfft(spectra, self.period, axis=1))


def period_samples(effects: Effects) -> int:
    """Length of the period that a run is computed on."""
    settling = round(SETTLING_S * effects.sampling_rate_hz)
    return 2 * int(scipy.fft.next_fast_len(-(-(effects.n_samples + settling) // 2), real=True))


def frequencies(effects: Effects, period: int) -> Floats:
    """Angular frequencies of the spectrum of a period, rad/s."""
    lines = np.arange(period // 2 + 1)
    return np.asarray(2 * np.pi * lines * effects.sampling_rate_hz / period)


def force_spectrum(effects: Effects, random: np.random.Generator) -> Complexes:
    """Spectrum of the force over a whole period, without preload and shaker."""
    period, rate = period_samples(effects), effects.sampling_rate_hz
    omega = frequencies(effects, period)
    kind = effects.excitation
    if kind is Excitation.HAMMER:
        spectrum = scipy.fft.rfft(_hits(effects, period, random))
        spectrum[-1] = 0
        return np.asarray(spectrum)
    if kind is Excitation.SWEEP:
        low, high = (2 * np.pi * limit for limit in effects.band_hz)
        time = np.arange(period) / rate % effects.event_s
        climb = (high - low) / (2 * effects.event_s)
        spectrum = scipy.fft.rfft(np.sin((low + climb * time) * time))
    else:
        spectrum = noise_spectrum(omega, effects.band_hz, random)
        if kind is Excitation.PINK:
            spectrum /= np.sqrt(1 + omega / (2 * np.pi * PINK_HZ))
        if kind is Excitation.BURST:
            over_time = scipy.fft.irfft(spectrum, period)
            spectrum = scipy.fft.rfft(over_time * _gate(effects, period, random))
    spectrum[[0, -1]] = 0
    return scaled(spectrum, effects.force_rms_n, period)


def _gate(effects: Effects, period: int, random: np.random.Generator) -> Floats:
    """1 in bursts at uneven distances, 0 in the pauses, with short ramps."""
    rate = effects.sampling_rate_hz
    time = np.arange(period) / rate
    gate, start = np.zeros(period), random.uniform(0, 0.5 * effects.event_s)
    while start < time[-1]:
        length = effects.event_s * random.uniform(*BURST_SHARE)
        into = np.minimum(time - start, start + length - time)
        gate += 0.5 - 0.5 * np.cos(np.pi * np.clip(into / BURST_RAMP_S, 0, 1))
        start += effects.event_s * random.uniform(0.9, 1.1)
    return gate


def _hits(effects: Effects, period: int, random: np.random.Generator) -> Floats:
    """Hammer hits, timed by hand: pulses of random width, height and distance."""
    rate = effects.sampling_rate_hz
    time = np.arange(period) / rate
    first = (period - effects.n_samples) / rate
    spread = effects.duration_s / effects.hits
    starts = first + spread * (np.arange(effects.hits) + 0.3)
    play = max(0.0, min(0.35 * spread, (spread - SHORTEST_HIT_DISTANCE_S) / 2))
    starts += random.uniform(-play, play, effects.hits)
    force = np.zeros(period)
    for start in starts:
        peak, length = random.uniform(*HIT_PEAK_N), random.uniform(*HIT_LENGTH_S)
        bounce, later = random.uniform(), random.uniform(*BOUNCE_S)
        second = random.uniform(*BOUNCE_PEAK) * (bounce < effects.double_hits)
        force += peak * _pulse(time - start, length)
        force += second * peak * _pulse(time - start - later, length)
    return force


def _pulse(time: Floats, length: float) -> Floats:
    """Haversine of unit height."""
    inside = (time >= 0) & (time < length)
    return np.where(inside, 0.5 - 0.5 * np.cos(2 * np.pi * time / length), 0.0)


def with_shaker(spectrum: Complexes, omega: Floats, drive_inertance: Complexes) -> Complexes:
    """Force on the tyre when the armature of the shaker moves with it."""
    s = 1j * np.where(omega > 0, omega, 1.0)
    own = 2 * np.pi * SUSPENSION_HZ
    moving = ARMATURE_KG * (1 + 2 * SUSPENSION_DAMPING * own / s + (own / s) ** 2)
    return np.asarray(spectrum / (1 + moving * drive_inertance))


def responses(driven: Driven) -> Floats:
    """Accelerations of a tyre that stays as it is, over the whole period."""
    return driven.seen(driven.system.inertance(driven.rows, driven.omega) * driven.spectrum)


def moving_responses(driven: Driven, shift: Complexes) -> Floats:
    """Accelerations of a tyre whose poles move: s_r(t) = s_r + shift_r(t), shapes as they are.

    `shift`, shape (n_shifted, n_samples of the period), is that of the first modes. The others
    stay, as do those so heavily damped that the substitution would lose its digits.
    """
    system, rows, spectrum, omega = driven.system, driven.rows, driven.spectrum, driven.omega
    period = driven.period
    step = 2 * np.pi / (omega[1] * period)
    mean = shift.mean(axis=1, keepdims=True)
    growth = (np.cumsum(shift - mean, axis=1) - (shift - mean) / 2) * step
    moving = np.flatnonzero(np.ptp(growth.real, axis=1) < LARGEST_GROWTH)
    still = np.setdiff1d(np.arange(system.poles.size), moving)
    found = scipy.fft.irfft(system.inertance(rows, omega, still) * spectrum, period, axis=1)
    force = scipy.fft.irfft(spectrum, period)
    force_rate = scipy.fft.irfft(1j * omega * spectrum, period)
    lines = np.concatenate([omega[:-1], -omega[:0:-1]])
    second = np.empty((moving.size, period), dtype=complex)
    for place, mode in enumerate(moving):
        own = growth[mode] - (growth[mode].real.max() + growth[mode].real.min()) / 2
        grown = np.exp(own)
        pole, now = system.poles[mode] + mean[mode], system.poles[mode] + shift[mode]
        amplitude = grown * scipy.fft.ifft(scipy.fft.fft(force / grown) / (1j * lines - pole))
        # x = 2 Re(A q) with q' = s q + f, differentiated twice.
        second[place] = (now**2 + np.gradient(now, step)) * amplitude + now * force + force_rate
    residues = system.residues(rows)[:, moving]
    found += 2 * (residues.real @ second.real - residues.imag @ second.imag)
    return driven.seen(scipy.fft.rfft(found, axis=1))


def level_over_time(found: Floats, rate_hz: float) -> Floats:
    """Response level smoothed over `LEVEL_TIME_S`, over its rms; periodic as the period is."""
    power = np.mean(found**2, axis=0)
    omega = 2 * np.pi * np.fft.rfftfreq(power.size, 1 / rate_hz)
    smooth = scipy.fft.irfft(scipy.fft.rfft(power) / (1 + (omega * LEVEL_TIME_S) ** 2), power.size)
    return np.asarray(np.sqrt(np.maximum(smooth, 0)))


def recorded_force(force: Floats, effects: Effects, random: np.random.Generator) -> Floats:
    """The force as its channel records it: preload, noise and converter."""
    noise = float(np.std(force)) * 10 ** (-effects.force_snr_db / 20)
    preload = 0.0 if effects.excitation is Excitation.HAMMER else effects.preload_n
    return _converted(force + preload + noise * random.standard_normal(force.size), effects.bits)


def with_faults(clean: Floats, effects: Effects) -> Floats:
    """Accelerations with the sensors that are dead, of wrong sign, too quiet or swapped."""
    found = clean.copy()
    numbers = effects.dead_sensor, effects.flipped_sensor, effects.scaled_sensor
    for number, factor in zip(numbers, (DEAD, -1.0, 0.5), strict=True):
        if number:
            found[number - 1] *= factor
    if effects.swapped_sensor:
        place = effects.swapped_sensor
        found[[place - 1, place]] = found[[place, place - 1]]
    return found


def recorded_responses(clean: Floats, effects: Effects, random: np.random.Generator) -> Floats:
    """Accelerations as the sensors record them: noise, hum, offset, clipping and converter."""
    count, samples = clean.shape
    mean = float(np.std(clean, axis=1).mean())
    clean = with_faults(clean, effects)
    noise = mean * 10 ** (-effects.snr_db / 20)
    seen = clean + noise * random.standard_normal(clean.shape)
    if effects.floor:
        white = scipy.fft.rfft(random.standard_normal(clean.shape), axis=1)
        white /= np.sqrt(np.maximum(np.arange(white.shape[1]), 1))
        low = scipy.fft.irfft(white, samples, axis=1)
        seen += effects.floor * mean * low / np.std(low, axis=1, keepdims=True)
    time = np.arange(samples) / effects.sampling_rate_hz
    phase = random.uniform(0, 2 * np.pi, (count, 1))
    seen += np.sqrt(2) * effects.hum * mean * np.sin(2 * np.pi * HUM_HZ * time + phase)
    seen += OFFSET_M_S2 * random.standard_normal((count, 1))
    if effects.clip:
        seen = np.clip(seen, -effects.clip * mean, effects.clip * mean)
    return _converted(seen, effects.bits)


def _converted(signal: Floats, bits: int) -> Floats:
    """Rounded to the steps of a converter whose range fits the largest sample."""
    if not bits:
        return signal
    step = 2 * RANGE_OVER_PEAK * float(np.abs(signal).max()) / 2**bits
    return np.asarray(np.round(signal / step) * step)
