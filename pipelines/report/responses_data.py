"""What the page needs to draw the FRFs of every position, in little room.

Measured FRFs go in as 16-bit numbers. Fitted ones and those of the ring follow in the page from
poles, residues and the ring's matrices, which are far smaller than the curves.
"""

from __future__ import annotations

from base64 import b64encode
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.core.frf import FRF
from ema.core.modes import ModalModel
from model.transfer import ForcedRing
from pipelines.plots.chart import packed
from pipelines.results.result import Result

MOST_POSITIONS = 600
MOST_VALUES = 450_000  # of all positions: some 2.4 MB in the page
STEPS_PER_UNIT = 100  # 0.01 dB and 0.01°
EVEN_SHARE = 0.5  # share of thinned lines that is spread evenly; the others crowd around the modes


def kept_positions(n_positions: int, wanted: tuple[int, ...]) -> NDArray[np.int_]:
    """Rows whose FRFs go into the page: all, or evenly chosen ones and those that are wanted."""
    if n_positions <= MOST_POSITIONS:
        return np.arange(n_positions)
    even = np.linspace(0, n_positions - 1, MOST_POSITIONS - len(wanted)).astype(int)
    return np.unique([*even, *wanted])


def kept_lines(
    frequency_hz: NDArray[np.float64], poles: NDArray[np.complex128], at_most: int
) -> NDArray[np.int_]:
    """Indices of the lines to draw: all where there is room, else closer at the resonances.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_lines,)
        Ascending.
    poles : ndarray of complex, shape (n_modes,)
        rad/s.
    at_most : int

    Returns
    -------
    ndarray of int, shape (n_kept,)
        Ascending; n_kept ≤ `at_most`.
    """
    if frequency_hz.size <= at_most:
        return np.arange(frequency_hz.size)
    centre_hz = poles.imag[:, None] / (2 * np.pi)
    width_hz = -poles.real[:, None] / np.pi
    near = np.sum(width_hz / ((frequency_hz - centre_hz) ** 2 + width_hz**2), axis=0)
    density = EVEN_SHARE / frequency_hz.size + (1 - EVEN_SHARE) * near / near.sum()
    reached = np.cumsum(density)
    steps = np.linspace(reached[0], reached[-1], at_most)
    return np.unique(np.minimum(np.searchsorted(reached, steps), frequency_hz.size - 1))


def measured_data(values: NDArray[np.complex128]) -> dict[str, str]:
    """Magnitude in dB and phase in degrees, in hundredths, 16 bit each, base64.

    Parameters
    ----------
    values : ndarray of complex, shape (n_positions, n_lines)
        (m/s²)/N. What is zero or not finite is marked by the lowest number, and not drawn.
    """
    known = np.isfinite(values) & (values != 0)
    safe = np.where(known, values, 1.0)
    level_db = np.where(known, 20 * np.log10(np.abs(safe)), -np.inf)
    return {"level_db": _hundredths(level_db), "phase_deg": _hundredths(np.angle(safe, deg=True))}


def fitted_data(frf: FRF, model: ModalModel, rows: NDArray[np.int_]) -> dict[str, Any]:
    """Poles, residues and residual terms, and each position's factor of the poles (drift).

    Parameters
    ----------
    frf : FRF
        Measured, (m/s²)/N; tells the run of each position.
    model : ModalModel
        Its poles are in rad/s.
    rows : ndarray of int, shape (n_shown,)
        Positions that go into the page.
    """
    everything = model.modes + model.guard_modes
    poles = np.array([mode.pole for mode in everything])
    residues = np.stack([mode.residues[rows] for mode in everything], axis=1)
    return {
        "band_hz": list(model.fit_band_hz),
        "poles": _parts(poles),
        "residues": {"real": packed(residues.real), "imag": packed(residues.imag)},
        "lower": packed(model.residual_terms.lower[rows]),
        "upper": packed(model.residual_terms.upper[rows]),
        "drift": [model.drift.factor(frf.run[row]) for row in rows],
    }


def ring_data(result: Result, rows: NDArray[np.int_]) -> dict[str, Any] | None:
    """Matrices of the tuned ring, order by order, and the angles from the force; None without ring.

    Inertance = −ω²/(2πab) Σ_n M22/(M11·M22 − C²) e^{inθ} with M11 = a_n + jωc_r − ρω²,
    M22 = b_n + jωc_θ − ρω² and C = c_n: the sum over all orders n of the ring at rest
    (`model.inertance`).

    Parameters
    ----------
    result : Result
    rows : ndarray of int, shape (n_shown,)
        Positions that go into the page.
    """
    tuning, damping = result.tuning, result.damping
    if tuning is None or damping is None or tuning.ring.belt_width_m is None:
        return None
    ring = tuning.ring
    forced = ForcedRing(ring, damping.damping)
    terms = forced.terms(np.arange(forced.highest_order + 1))
    width = tuning.ring.belt_width_m
    return {
        "m11": _parts(terms.m11),
        "m22": _parts(terms.m22),
        "coupling": _parts(terms.c),
        "mass_per_area_kg_m2": ring.mass_per_area_kg_m2,
        "radial_n_s_m3": damping.damping.radial_n_s_m3,
        "circumferential_n_s_m3": damping.damping.circumferential_n_s_m3,
        "area_m2": 2 * np.pi * ring.mean_radius_m * width,
        "angle_rad": [
            float(angle)
            for angle in np.deg2rad(result.frf.position_deg[rows] - (result.excitation_deg or 0.0))
        ],
    }


def _hundredths(values: NDArray[np.float64]) -> str:
    lowest = np.iinfo(np.int16).min
    scaled = np.clip(np.round(STEPS_PER_UNIT * values), lowest, -(lowest + 1))
    return b64encode(scaled.astype("<i2").tobytes()).decode("ascii")


def _parts(values: ArrayLike) -> dict[str, list[float]]:
    array = np.asarray(values, dtype=complex)
    return {"real": array.real.tolist(), "imag": array.imag.tolist()}
