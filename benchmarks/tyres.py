"""Random tyres whose modes are known, and their FRFs as a campaign of six runs would give them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.core.frf import FRF
from model import RingParameters, modal_mass_kg, natural_frequencies_hz
from pipelines.simulate.campaign import FORCE_BAND_HZ, N_RUNS, POSITIONS, REFERENCE_DEG
from pipelines.simulate.truth import HIGHEST_ORDER, TruthMode, modal_sum

BAND_HZ = (20.0, 260.0)
ORDERS = range(1, 8)

# 250 s in 4 s blocks without a window or overlap: independent lines, independent averages. Hann
# blocks that overlap by half hold the same information in twice as many, correlated ones.
FREQUENCY_HZ = np.arange(1, 1401) / 4
AVERAGES = 62
NYQUIST_HZ = 1000.0

# Parameters of passenger-car tyres around those of the paper's 225/55R17, uniformly drawn.
RING_RANGES = {
    "mean_radius_m": (0.30, 0.36),
    "mass_per_area_kg_m2": (17.0, 23.0),
    "radial_stiffness_n_m3": (6.5e6, 1.0e7),
    "circumferential_stiffness_n_m3": (0.5e6, 1.7e6),
    "axial_stiffness_n_m": (2.0e7, 3.0e7),
    "bending_stiffness_n_m": (5.0, 12.0),
    "inflation_pressure_pa": (1.8e5, 2.8e5),
    "belt_width_m": (0.17, 0.23),
}
HIGHEST_ORDER_7_HZ = 240.0  # both members of order 7 stay clear of the band's end
DAMPING_RATIO = (0.015, 0.05)
SPLIT_PERCENT = (0.0, 4.0)
SNR_DB = (6.0, 40.0)
LOST_CHANNELS = (1, 6)
DRIFT_PERCENT = (0.0, 0.3)


@dataclass(frozen=True, eq=False)
class RandomTyre:
    """A tyre and the circumstances of its measurement.

    Parameters
    ----------
    modes : tuple of TruthMode
        Orders 0 to 16, two members each from 1 on, in the state of the first run.
    snr_db : float
        Response to a force between 10 and 900 Hz over sensor noise up to 1000 Hz, RMS; 10 dB gives
        a median coherence of about 0.8 in the band of interest.
    drift : ndarray, shape (N_RUNS,)
        Relative shift of all natural frequencies of each run; the first is 0.
    lost : ndarray of int
        Nodes without a usable sensor.
    """

    modes: tuple[TruthMode, ...]
    snr_db: float
    drift: NDArray[np.float64]
    lost: NDArray[np.int_]

    def pair(self, order: int) -> tuple[TruthMode, TruthMode]:
        """Both members of an order, the lower one first."""
        first, second = (mode for mode in self.modes if mode.order == order)
        return first, second

    def in_run(self, run: int) -> tuple[TruthMode, ...]:
        """Modes as they are in a run."""
        factor = 1 + self.drift[run]
        return tuple(replace(mode, frequency_hz=factor * mode.frequency_hz) for mode in self.modes)


def random_tyre(random: np.random.Generator) -> RandomTyre:
    """Draw a tyre: ring, damping, splits, orientations, noise, lost channels and drift."""
    ring = _random_ring(random)
    orders = np.arange(HIGHEST_ORDER + 1)
    frequencies, masses = natural_frequencies_hz(ring, orders), modal_mass_kg(ring, orders)
    modes = []
    for order, frequency_hz, mass_kg in zip(orders, frequencies, masses, strict=True):
        ratio = random.uniform(*DAMPING_RATIO)
        split = random.uniform(*SPLIT_PERCENT) / 200
        turned = random.uniform(0, 360)
        members = (("a", -split, 0.0), ("b", split, 90.0 / max(order, 1)))
        modes += [
            TruthMode(
                int(order), member, frequency_hz * (1 + shift), ratio, mass_kg, turned + angle
            )
            for member, shift, angle in members[: None if order else 1]
        ]
    steps = random.uniform(0, 1, N_RUNS - 1)
    total = random.uniform(*DRIFT_PERCENT) / 100 * random.choice([-1, 1])
    return RandomTyre(
        modes=tuple(modes),
        snr_db=random.uniform(*SNR_DB),
        drift=np.append(0.0, total * np.cumsum(steps) / steps.sum()),
        lost=random.choice(
            POSITIONS, random.integers(*LOST_CHANNELS, endpoint=True), replace=False
        ),
    )


def measured_frf(tyre: RandomTyre, random: np.random.Generator) -> FRF:
    """H1 of the remaining positions and of the reference sensor, with coherence and σ."""
    nodes = np.setdiff1d(np.arange(POSITIONS), tyre.lost)
    exact = np.empty((POSITIONS + N_RUNS, FREQUENCY_HZ.size), dtype=complex)
    for run in range(N_RUNS):
        rows = np.append(np.arange(run, POSITIONS, N_RUNS), POSITIONS + run)
        angles_deg = np.append(rows[:-1] * 5.0, REFERENCE_DEG)
        exact[rows] = _inertance(tyre.in_run(run), angles_deg, FREQUENCY_HZ)
    noise = _response_level(tyre.modes) * 10 ** (-tyre.snr_db / 20)
    run = np.append(np.arange(POSITIONS) % N_RUNS, np.arange(N_RUNS))
    measured = _averaged(exact, noise, run, random)
    reference = _frf(measured, np.arange(POSITIONS, POSITIONS + N_RUNS), run)
    return replace(_frf(measured, nodes, run), reference=reference)


def _random_ring(random: np.random.Generator) -> RingParameters:
    while True:
        ring = RingParameters(**{name: random.uniform(*ends) for name, ends in RING_RANGES.items()})
        if natural_frequencies_hz(ring, ORDERS[-1]) < HIGHEST_ORDER_7_HZ:
            return ring


def _inertance(
    modes: tuple[TruthMode, ...], angles_deg: NDArray[np.float64], frequency_hz: NDArray[np.float64]
) -> NDArray[np.complex128]:
    system = modal_sum(modes, angles_deg, 0.0)
    omega = 2 * np.pi * frequency_hz
    return np.array([system.inertance(row, omega) for row in range(angles_deg.size)])


def _response_level(modes: tuple[TruthMode, ...]) -> float:
    """Inertance of white noise as strong as the responses to a force in the shaker's band."""
    lines = np.arange(*FORCE_BAND_HZ)
    power = np.abs(_inertance(modes, np.arange(0.0, 360.0, 30.0), lines)) ** 2
    return float(np.sqrt(power.sum(axis=1).mean() / NYQUIST_HZ))


def _averaged(
    exact: NDArray[np.complex128], noise: float, run: NDArray[np.int_], random: np.random.Generator
) -> tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.float64]]:
    """H1, coherence and σ as averages of a random force and independent sensor noise scatter.

    Given the force's auto spectrum, the cross spectrum of noise and force is normal, and what is
    left of the noise's auto spectrum is χ² with two degrees of freedom fewer (Goodman 1963). The
    sensors of a run share the force.
    """
    force = random.gamma(AVERAGES, 1 / AVERAGES, (N_RUNS, exact.shape[1]))[run]
    parts = random.standard_normal((2, *exact.shape)) / np.sqrt(2 * AVERAGES)
    values = exact + noise * (parts[0] + 1j * parts[1]) / np.sqrt(force)
    left = noise**2 * random.gamma(AVERAGES - 1, 1 / AVERAGES, exact.shape)
    explained = np.abs(values) ** 2 * force
    std = np.sqrt(left / force / (2 * (AVERAGES - 1)))
    return values, explained / (explained + left), std


def _frf(
    measured: tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.float64]],
    rows: NDArray[np.int_],
    run: NDArray[np.int_],
) -> FRF:
    values, coherence, std = (part[rows] for part in measured)
    fixed = rows >= POSITIONS
    return FRF(
        frequency_hz=FREQUENCY_HZ,
        values=values,
        coherence=coherence,
        std=std,
        node=np.where(fixed, -1, rows),
        position_deg=np.where(fixed, REFERENCE_DEG, rows * 360 / POSITIONS),
        run=tuple(f"run_{number + 1}" for number in run[rows]),
        n_effective=float(AVERAGES),
    )
