"""Damping ratios of the ring, and the damping parameters that measured ratios determine."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from model.arguments import Array, ReadonlyArrays, measured_orders, whole_orders
from model.coefficients import PressureLoad, characteristic_roots
from model.identifiability import AT_BOUND, NOT_IDENTIFIED, Correlation, LinearFit, assess
from model.parameters import DAMPING_NAMES, RingDamping, RingParameters
from model.ring import natural_frequencies_hz, torsion_frequency_hz

_NAMES = tuple(DAMPING_NAMES)
_STEP = 1e-5  # relative change of a parameter of the ring for numerical derivatives
_NOMINAL = 0.05  # relative error of a ratio that decides on identifiability where none is known


@dataclass(frozen=True, eq=False)
class DampingResult(ReadonlyArrays):
    """Damping parameters identified from measured damping ratios.

    Parameters
    ----------
    damping : RingDamping
        The damping, each part zero or more.
    std : dict of str to float
        Standard deviation of each parameter; absent where unknown.
    how : dict of str to str
        ``"identified"``, ``"not identified"`` or ``"at bound"`` (zero), per parameter.
    orders : ndarray of int, shape (n_orders,)
        Circumferential orders used.
    measured, model : ndarray, shape (n_orders,)
        Measured damping ratios and those of the damped ring.
    correlation : Correlation
        Of the parameters that are not zero.
    notes : tuple of str
        Remarks for the reader, in sentences.
    """

    damping: RingDamping
    std: dict[str, float]
    how: dict[str, str]
    orders: NDArray[np.int_]
    measured: Array
    model: Array
    correlation: Correlation
    notes: tuple[str, ...]


def damping_ratios(
    ring: RingParameters,
    damping: RingDamping,
    orders: ArrayLike,
    speed_rad_s: ArrayLike = 0.0,
    *,
    pressure_load: PressureLoad = "dead",
) -> Array:
    """Damping ratios ζ = Im ω/|ω| of the regressive inextensional waves (n = 0: breathing).

    Exact roots of eq 14 with iωc_r and iωc_θ on its diagonal and K, D complex (section 5.3).

    Parameters
    ----------
    ring, damping, orders, speed_rad_s, pressure_load
        As `harmonics`, with n ≥ 0; at Ω = 0 both members of an order share the ratio.

    Returns
    -------
    ndarray
        In the broadcast shape of orders and speeds.
    """
    roots = characteristic_roots(
        ring, orders, speed_rad_s, pressure_load=pressure_load, damping=damping
    )
    breathing = np.broadcast_to(whole_orders(orders) == 0, roots.shape[:-1])
    root = np.where(breathing, roots[..., 2], roots[..., 0])
    return np.asarray(root.imag / np.abs(root))


def torsion_damping_ratio(
    ring: RingParameters, damping: RingDamping, *, pressure_load: PressureLoad = "dead"
) -> float:
    """Damping ratio ζ = Im ω/|ω| of order 0 in which the belt turns against a fixed hub.

    The belt does not strain in it: c_θ damps it, and η as far as it acts on the pretension.

    Parameters
    ----------
    ring, damping, pressure_load
        As `damping_ratios`.

    Raises
    ------
    InstabilityError
        Where the static stiffness of the torsion is negative.
    """
    torsion_frequency_hz(ring, pressure_load=pressure_load)  # raises where the ring has none
    root = characteristic_roots(ring, 0, pressure_load=pressure_load, damping=damping)[0]
    return float(root.imag / abs(root))


def identify_damping(
    ring: RingParameters,
    orders: ArrayLike,
    damping_ratios: ArrayLike,
    damping_std: ArrayLike | None = None,
    *,
    on_pretension: bool = True,
    pressure_load: PressureLoad = "dead",
    ring_covariance: tuple[Iterable[str], Array] | None = None,
) -> DampingResult:
    """Identify c_r, c_θ and η ≥ 0 from measured damping ratios, relative deviations squared.

    Parameters
    ----------
    ring : RingParameters
        The ring, tuned on the frequencies of the same tyre.
    orders : array_like of int, shape (n_orders,)
        Circumferential orders, each once.
    damping_ratios : array_like, shape (n_orders,)
        Measured damping ratios, greater than zero.
    damping_std : array_like, shape (n_orders,), or None
        Their standard deviations; those of the fit residuals are used where they are larger.
    on_pretension : bool
        Whether η acts on the stiffness from hoop tension too.
    pressure_load : {"dead", "follower"}
        See `equilibrium`.
    ring_covariance : (names, ndarray), or None
        Parameters of the ring and their covariance; c_r and c_θ are known no better than ρh.

    Returns
    -------
    DampingResult
        Parameters with standard deviations, and how each was obtained.

    Raises
    ------
    ParameterError
        For ratios that are not positive, or shapes that do not match.

    Examples
    --------
    >>> import ringmodal as rm
    >>> from model.parameters import TABLE_4_RING
    >>> found = rm.identify_damping(TABLE_4_RING, [1, 2, 3, 4], [0.039, 0.033, 0.024, 0.022])
    >>> found.damping.radial_n_s_m3 > 0
    True
    """
    numbers, measured, relative_given = measured_orders(
        "damping_ratios", orders, damping_ratios, "damping_std", damping_std
    )

    def damping(values: Array) -> RingDamping:
        radial, circumferential, loss_factor = map(float, values)
        return RingDamping(radial, circumferential, loss_factor, on_pretension)

    def model(values: Array) -> Array:
        return rings(ring, values)

    def rings(other: RingParameters, values: Array) -> Array:
        return _ratios(other, damping(values), numbers, pressure_load=pressure_load)

    scale = _scale(ring, numbers)
    values, slope = _fit(model, measured, scale)
    fitted = model(values)
    free = values > 0
    names = tuple(name for name, kept in zip(_NAMES, free, strict=True) if kept)
    fit = LinearFit(names, values[free], slope[:, free], -np.ones(measured.size))
    undetermined = replace(fit, names=_NAMES, values=scale, residual_slope=slope).undetermined()
    residual = fitted / measured - 1.0
    further: Array | float = 0.0
    if ring_covariance is not None:
        slopes = _ring_slopes(ring, ring_covariance[0], lambda other: rings(other, values))
        moved = fit.moved(slopes / measured[:, None])
        further = moved @ ring_covariance[1] @ moved.T
    found = assess(
        fit, residual, relative_given, nominal=_NOMINAL, undetermined=undetermined, further=further
    )
    how = {name: NOT_IDENTIFIED if undetermined[name] else AT_BOUND for name in _NAMES} | found.how
    return DampingResult(
        damping=damping(values),
        std=found.std,
        how=how,
        orders=numbers,
        measured=measured,
        model=fitted,
        correlation=found.correlation,
        notes=(f"Damping: {found.note[0].lower()}{found.note[1:]}", *_notes(how, measured.size)),
    )


_ratios = damping_ratios  # `identify_damping` has an argument of this name


def _ring_slopes(
    ring: RingParameters, names: Iterable[str], model: Callable[[RingParameters], Array]
) -> Array:
    """Slopes of the damping ratios over parameters of the ring, (n_ratios, n_parameters)."""
    columns = []
    for name in names:
        value = getattr(ring, name)
        step = _STEP * (value or 1.0)
        columns.append((model(replace(ring, **{name: value + step})) - model(ring)) / step)
    return np.column_stack(columns)


def _scale(ring: RingParameters, orders: NDArray[np.int_]) -> Array:
    """Amounts of c_r, c_θ and η that each give damping ratios of some percent."""
    omega = 2.0 * np.pi * float(np.mean(natural_frequencies_hz(ring, orders)))
    viscous = 0.05 * ring.mass_per_area_kg_m2 * omega
    return np.array([viscous, viscous, 0.05])


def _fit(model: Callable[[Array], Array], measured: Array, scale: Array) -> tuple[Array, Array]:
    """Least squares, parameters ≥ 0; they and d(model/measured)/d(parameter) there."""
    found = scipy.optimize.least_squares(
        lambda shares: model(shares * scale) / measured - 1.0,
        np.zeros(scale.size),
        bounds=(0.0, np.inf),
        method="dogbox",
        ftol=1e-15,
        xtol=1e-12,
        gtol=1e-15,
    )
    return found.x * scale, found.jac / scale


def _notes(how: dict[str, str], n_ratios: int) -> list[str]:
    notes = []
    if n_ratios < len(_NAMES):
        notes.append(f"{n_ratios} damping ratios cannot determine three damping parameters.")
    for word, text in ((NOT_IDENTIFIED, "Not identified"), (AT_BOUND, "At the lower bound, zero")):
        names = [name for name in _NAMES if how[name] == word]
        if names:
            notes.append(f"{text}: {', '.join(names)}.")
    return notes
