"""Systems with exactly known modes, as frequency responses."""

from __future__ import annotations

import numpy as np

from ema.frf import FRF
from ema.modes import synthesise

TABLE_3_HZ = np.array([78.73, 100.31, 121.40, 145.45, 170.78, 196.52, 224.40])
TABLE_3_DAMPING = np.array([0.039, 0.033, 0.024, 0.022, 0.021, 0.020, 0.018])
BEYOND_HZ = np.array([253.1, 282.9, 313.9, 346.2])  # n = 8 … 11, outside the band of interest
BEYOND_DAMPING = np.full(4, 0.018)
MASS_KG = 4.0


def pole(frequency_hz, damping_ratio):
    omega = 2 * np.pi * np.asarray(frequency_hz)
    zeta = np.asarray(damping_ratio)
    return omega * (-zeta + 1j * np.sqrt(1 - zeta**2))


def residue(poles, mass_kg=MASS_KG):
    """Residue of a drive point, 1/(2jω_d m), of receptance."""
    return 1 / (2j * np.imag(poles) * mass_kg)


def table_3_poles():
    return pole(np.r_[TABLE_3_HZ, BEYOND_HZ], np.r_[TABLE_3_DAMPING, BEYOND_DAMPING])


def tyre_frf(
    snr_db=np.inf,
    averages=100,
    seed=0,
    positions=72,
    frequency_hz=None,
    poles=None,
    orders=None,
    split_percent=0.0,
    orientation=0.5,
):
    """FRFs of the paper's Table 3 at equidistant points, orders 8 … 11 outside the band.

    Noise is white over the lines, equal for all sensors, and known: `std` is exact.
    """
    frequency_hz = np.arange(1, 4 * 400) / 4 if frequency_hz is None else frequency_hz
    poles = table_3_poles() if poles is None else poles
    orders = np.arange(1, len(poles) + 1) if orders is None else orders
    angles = 2 * np.pi * np.arange(positions) / positions
    shapes = np.cos(np.outer(angles, orders))
    residues = shapes * residue(poles)
    zero = np.zeros(positions)
    clean = synthesise(frequency_hz, poles, residues, zero, zero)
    rng = np.random.default_rng(seed)
    band = (frequency_hz > 20) & (frequency_hz < 260)
    level = np.sqrt(np.mean(np.abs(clean[:, band]) ** 2)) * 10 ** (-snr_db / 20)
    std = np.full(clean.shape, max(level / np.sqrt(2 * averages), 1e-12))
    noise = std * (rng.standard_normal(clean.shape) + 1j * rng.standard_normal(clean.shape))
    coherence = np.abs(clean) ** 2 / (np.abs(clean) ** 2 + level**2)
    return FRF(
        frequency_hz=frequency_hz,
        values=clean + (noise if np.isfinite(snr_db) else 0),
        coherence=coherence,
        std=std,
        node=np.arange(positions),
        position_deg=np.rad2deg(angles),
        run=("run",) * positions,
    )
