"""Poles over the model orders, each followed from one order to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.lsce import poles_of_order, shapes_of_poles
from ema.mac import mac


@dataclass(frozen=True, eq=False)
class PoleHistory:
    """Poles of all orders with their shapes and their match in the order before.

    Parameters
    ----------
    model_order : ndarray of int, shape (n_poles,)
    poles : ndarray of complex, shape (n_poles,)
    shapes : ndarray of complex, shape (n_poles, n_positions)
    step_frequency, step_damping : ndarray, shape (n_poles,)
        Relative change of frequency and damping ratio from the match; inf where there is none.
    step_total : ndarray, shape (n_poles,)
        |Δλ|/max|λ| + 1 − MAC to the match; inf where there is none.
    match : ndarray of int, shape (n_poles,)
        Index of the match; −1 where there is none.
    """

    model_order: NDArray[np.int_]
    poles: NDArray[np.complex128]
    shapes: NDArray[np.complex128]
    step_frequency: NDArray[np.float64]
    step_damping: NDArray[np.float64]
    step_total: NDArray[np.float64]
    match: NDArray[np.int_]


def pole_history(
    matrix: NDArray[np.complex128],
    piece: NDArray[np.complex128],
    step_s: float,
    lowest_hz: float,
    max_damping: float,
) -> PoleHistory:
    """Solve all model orders of one normal matrix and follow the stable poles through them.

    Parameters
    ----------
    matrix : ndarray of complex
        Normal matrix of the highest order.
    piece : ndarray of complex, shape (n_positions, n_samples)
        Impulse responses that give the shapes.
    step_s, lowest_hz : float
        As in `ema.lsce.poles_of_order`.
    max_damping : float
        Largest damping ratio of a pole worth following.
    """
    rows: list[tuple[NDArray[np.generic], ...]] = []
    old_poles = np.zeros(0, dtype=complex)
    old_shapes = np.zeros((0, piece.shape[0]), dtype=complex)
    first_old = 0
    for order in range(2, len(matrix)):
        poles = poles_of_order(matrix, order, step_s, lowest_hz)
        damping = -poles.real / np.abs(poles)
        poles = poles[(damping > 0) & (damping < max_damping) & (poles.imag > 0)]
        shapes = shapes_of_poles(piece, poles, step_s, lowest_hz)
        match, total = _matches(old_poles, old_shapes, poles, shapes)
        frequency, ratio = _changes(old_poles, poles, match)
        global_match = np.where(match >= 0, match + first_old, -1)
        rows.append(
            (np.full(poles.size, order), poles, shapes, frequency, ratio, total, global_match)
        )
        first_old += old_poles.size
        old_poles, old_shapes = poles, shapes
    return PoleHistory(*(np.concatenate(column) for column in zip(*rows, strict=True)))


def _matches(
    old_poles: NDArray[np.complex128],
    old_shapes: NDArray[np.complex128],
    poles: NDArray[np.complex128],
    shapes: NDArray[np.complex128],
) -> tuple[NDArray[np.int_], NDArray[np.float64]]:
    """Match of each pole in the order before, one to one, and the distance to it.

    Only mutual nearest neighbours match. Shapes count as much as poles, so that the two members of
    a pair are not mistaken for each other where they lie close together.
    """
    match, total = np.full(poles.size, -1), np.full(poles.size, np.inf)
    if not (old_poles.size and poles.size):
        return match, total
    largest = np.maximum(np.abs(old_poles)[:, None], np.abs(poles)[None, :])
    distance = np.abs(old_poles[:, None] - poles[None, :]) / largest
    distance = distance + 1 - mac(old_shapes, shapes)
    nearest_old, nearest_new = distance.argmin(axis=0), distance.argmin(axis=1)
    mutual = np.flatnonzero(nearest_new[nearest_old] == np.arange(poles.size))
    match[mutual] = nearest_old[mutual]
    total[mutual] = distance[nearest_old[mutual], mutual]
    return match, total


def _changes(
    old_poles: NDArray[np.complex128], poles: NDArray[np.complex128], match: NDArray[np.int_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Relative change of frequency and of damping ratio from the matches."""
    frequency, damping = np.full(poles.size, np.inf), np.full(poles.size, np.inf)
    new = np.flatnonzero(match >= 0)
    old = old_poles[match[new]]
    frequency[new] = np.abs(np.abs(poles[new]) / np.abs(old) - 1)
    ratio = (poles[new].real / np.abs(poles[new])) / (old.real / np.abs(old))
    damping[new] = np.abs(ratio - 1)
    return frequency, damping
