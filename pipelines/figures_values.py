"""What figures and charts show, before anything draws it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.frf import FRF
from ema.stability import StabilityDiagram
from pipelines.figures_labels import row_names


@dataclass(frozen=True, eq=False)
class CoherenceMap:
    """Coherence by position and frequency, averaged where there are more lines than can be shown.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_columns,)
        Middle of each column.
    names : tuple of str
        Name of each row, in ascending angle.
    values : ndarray, shape (n_rows, n_columns)
        NaN where unknown.
    averaged : int
        Lines in one column.
    band_hz : tuple of float
        What is shown.
    """

    frequency_hz: NDArray[np.float64]
    names: tuple[str, ...]
    values: NDArray[np.float64]
    averaged: int
    band_hz: tuple[float, float]


def coherence_map(frf: FRF, band_hz: tuple[float, float], most_columns: int) -> CoherenceMap:
    """Sort the coherence by position and average neighbouring lines until they fit.

    Parameters
    ----------
    frf : FRF
    band_hz : tuple of float
    most_columns : int
        Largest number of columns.
    """
    inside = in_band(frf.frequency_hz, band_hz)
    rows = np.argsort(frf.position_deg, kind="stable")
    lines_hz, values = frf.frequency_hz[inside], frf.coherence[rows][:, inside]
    width = max(1, -(-lines_hz.size // most_columns))
    return CoherenceMap(
        _mean_by_column(lines_hz[None, :], width)[0],
        tuple(row_names(frf, rows)),
        _mean_by_column(values, width),
        width,
        band_hz,
    )


def in_band(frequency_hz: NDArray[np.float64], band_hz: tuple[float, float]) -> NDArray[np.bool_]:
    """Which frequencies, shape (n_lines,), lie in a band in Hz, its ends included."""
    return np.asarray((frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1]))


def pole_marks(diagram: StabilityDiagram) -> dict[str, NDArray[np.bool_]]:
    """Which poles of the band get which mark in the stability diagram; each pole gets one.

    Returns
    -------
    dict of str to ndarray of bool, shape (n_poles,)
        Legend entry → poles.
    """
    kept_labels = [cluster.label for cluster in diagram.clusters if cluster.kept]
    kept = np.isin(diagram.cluster, kept_labels)
    stable = diagram.stable_frequency & diagram.stable_damping
    inside = in_band(diagram.frequency_hz, diagram.band_hz)
    return {
        "not stable": ~stable & ~kept & inside,
        "stable, not in a mode": stable & ~kept & inside,
        "in a mode, not stable": ~stable & kept & inside,
        "in a mode": stable & kept & inside,
    }


def wrapped_phase_deg(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Phase of complex values in degrees, NaN where it wraps: no line crosses the picture there.

    Parameters
    ----------
    values : ndarray of complex, shape (n_lines,)
    """
    phase = np.rad2deg(np.angle(values))
    phase[1:][np.abs(np.diff(phase)) > 180] = np.nan
    return np.asarray(phase)


def _mean_by_column(values: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Mean over `width` neighbouring columns, unknown ones left out."""
    padding = -values.shape[1] % width
    padded = np.pad(values, ((0, 0), (0, padding)), constant_values=np.nan)
    bins = padded.reshape(values.shape[0], -1, width)
    known = np.isfinite(bins).sum(axis=2)
    total = np.nansum(bins, axis=2)
    mean = np.full(total.shape, np.nan)
    return np.asarray(np.divide(total, known, out=mean, where=known > 0))
