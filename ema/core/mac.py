"""MAC, FRAC, MPC and MPD: similarity and complexity of shapes and FRFs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.core.errors import InputError


def mac(first: ArrayLike, second: ArrayLike) -> NDArray[np.float64]:
    """Modal assurance criterion of two sets of shapes.

    MAC = |φᴴψ|²/((φᴴφ)(ψᴴψ)) (Allemang & Brown 1982).

    Parameters
    ----------
    first : array_like, shape (n_first, n_positions)
    second : array_like, shape (n_second, n_positions)
        Shapes by row, real or complex. A single shape may be given as a vector.

    Returns
    -------
    ndarray, shape (n_first, n_second)
        Between 0 and 1; 0 where a shape is zero everywhere.

    Examples
    --------
    >>> import numpy as np
    >>> import ringmodal as rm
    >>> angle = np.radians(np.arange(0, 360, 30))
    >>> cosine, sine = np.cos(2 * angle), np.sin(2 * angle)
    >>> rm.mac([cosine], [cosine, sine]).round(3)
    array([[1., 0.]])
    """
    a, b = _rows("MAC", first), _rows("MAC", second)
    if a.shape[1] != b.shape[1]:
        found = f"shapes of {a.shape[1]} and {b.shape[1]} positions"
        rule = "both sets must have the same positions in the same order"
        raise InputError("MAC", found, rule, "One row is one shape: transpose or cut them")
    product = np.abs(a.conj() @ b.T) ** 2
    power = np.outer(_power(a), _power(b))
    return np.asarray(np.divide(product, power, out=np.zeros(product.shape), where=power > 0))


def auto_mac(shapes: ArrayLike) -> NDArray[np.float64]:
    """MAC of a set of shapes with itself, (n_shapes, n_shapes).

    Examples
    --------
    >>> import numpy as np
    >>> import ringmodal as rm
    >>> rm.auto_mac([[1.0, 0.0], [1.0, 1.0]]).round(3)
    array([[1. , 0.5],
           [0.5, 1. ]])
    """
    return mac(shapes, shapes)


def frac(measured: ArrayLike, fitted: ArrayLike) -> NDArray[np.float64]:
    """Frequency response assurance criterion of each FRF (Heylen & Lammens 1996).

    Parameters
    ----------
    measured, fitted : array_like, shape (n_positions, n_frequencies)

    Returns
    -------
    ndarray, shape (n_positions,)
        Between 0 and 1; 0 where an FRF is zero everywhere.

    Examples
    --------
    >>> import ringmodal as rm
    >>> measured = [[1.0, 2.0 + 1.0j, 3.0], [1.0, 0.0, 0.0]]
    >>> rm.frac(measured, [[2.0, 4.0 + 2.0j, 6.0], [0.0, 1.0, 0.0]]).round(3)
    array([1., 0.])
    """
    a, b = _rows("FRAC", measured), _rows("FRAC", fitted)
    if a.shape != b.shape:
        rule = "both sets must have the same positions and lines"
        raise InputError("FRAC", f"FRFs of {a.shape} and {b.shape}", rule, "Cut them alike")
    product = np.abs(np.sum(a.conj() * b, axis=1)) ** 2
    power = _power(a) * _power(b)
    return np.asarray(np.divide(product, power, out=np.zeros(product.shape), where=power > 0))


def mpc(shape: ArrayLike) -> float:
    """Modal phase collinearity: 1 for a real mode, towards 0 for a travelling wave.

    ((λ1−λ2)/(λ1+λ2))² with the eigenvalues of the covariance of real and imaginary parts
    (Pappa, Elliott & Schenk 1993); parts are not centred, a shape has no meaningful mean.

    Examples
    --------
    >>> import ringmodal as rm
    >>> round(rm.mpc([1.0, -2.0, 1.0]), 3), round(rm.mpc([1.0, 1.0j, -1.0, -1.0j]), 3)
    (1.0, 0.0)
    """
    phi = _one("MPC", shape)
    xx, yy, xy = phi.real @ phi.real, phi.imag @ phi.imag, phi.real @ phi.imag
    if xx + yy == 0:
        return 0.0
    return float(((xx - yy) ** 2 + 4 * xy**2) / (xx + yy) ** 2)


def mpd_deg(shape: ArrayLike) -> float:
    """Mean phase deviation in degrees from the straight line that suits the shape best.

    Amplitude-weighted angle to the first principal axis of (real, imaginary)
    (Reynders, Houbrechts & De Roeck 2012, eq. 8).

    Examples
    --------
    >>> import numpy as np
    >>> import ringmodal as rm
    >>> round(rm.mpd_deg([1.0j, -2.0j, 1.0j]), 3)  # all in one phase
    0.0
    >>> round(rm.mpd_deg(np.exp(1j * np.radians([10.0, -10.0]))), 3)
    10.0
    """
    phi = _one("MPD", shape)
    weight = np.abs(phi)
    if not np.any(weight):
        return 90.0
    _, _, axes = np.linalg.svd(np.column_stack([phi.real, phi.imag]), full_matrices=False)
    across = np.abs(phi.real * axes[0, 1] - phi.imag * axes[0, 0])
    ratio = np.divide(across, weight, out=np.zeros_like(weight), where=weight > 0)
    return float(np.rad2deg(np.sum(weight * np.arcsin(np.clip(ratio, 0, 1))) / np.sum(weight)))


def _rows(where: str, values: ArrayLike) -> NDArray[Any]:
    """Values row by row; NaN, texts and more than two axes are refused."""
    try:
        rows = np.atleast_2d(np.asarray(values))
        finite = rows.dtype != object and bool(np.all(np.isfinite(rows)))
    except (TypeError, ValueError):
        rows, finite = np.zeros((1, 1)), False
    if rows.ndim != 2 or not finite:
        found = (
            f"{type(values).__name__} of shape {np.shape(rows)}" if finite else "no numbers, or NaN"
        )
        rule = "finite numbers are needed, one row for each shape or FRF"
        raise InputError(where, found, rule, "Pass arrays such as mode.shape")
    return rows


def _one(where: str, shape: ArrayLike) -> NDArray[Any]:
    rows = _rows(where, shape)
    if len(rows) != 1:
        rule = "it is of one shape"
        raise InputError(where, f"{len(rows)} shapes", rule, "Call it for each of them")
    return np.asarray(rows[0])


def _power(rows: NDArray[np.generic]) -> NDArray[np.float64]:
    return np.asarray(np.sum(np.abs(rows) ** 2, axis=1))
