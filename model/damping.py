"""Damping ratios of the ring, and the damping parameters that measured ratios determine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

from model.arrays import finite_array, readonly, require_one_each, require_positive, whole_orders
from model.coefficients import characteristic_roots, harmonics
from model.identifiability import (
    AT_BOUND,
    NOT_IDENTIFIED,
    Correlation,
    LinearFit,
    correlation,
    error_level,
    verdicts,
)
from model.parameters import RingDamping, RingParameters
from model.ring import natural_frequencies_hz, torsion_frequency_hz
from model.steady_state import PressureLoad

_NAMES = ("radial_n_s_m3", "circumferential_n_s_m3", "loss_factor")
_NOMINAL = 0.05  # relative error of a damping ratio that judges identifiability where none is known


@dataclass(frozen=True, eq=False)
class DampingResult:
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
        What a reader must know, in sentences.
    """

    damping: RingDamping
    std: dict[str, float]
    how: dict[str, str]
    orders: NDArray[np.int_]
    measured: NDArray[np.float64]
    model: NDArray[np.float64]
    correlation: Correlation
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "orders", readonly(self.orders, int))
        for name in ("measured", "model"):
            object.__setattr__(self, name, readonly(getattr(self, name)))


def damping_ratios(
    ring: RingParameters,
    damping: RingDamping,
    orders: ArrayLike,
    speed_rad_s: ArrayLike = 0.0,
    *,
    pressure_load: PressureLoad = "dead",
) -> NDArray[np.float64]:
    """Damping ratios ζ = Im ω/|ω| of the regressive inextensional waves (n = 0: breathing).

    Exact roots of eq 14 with iωc_r and iωc_θ on its diagonal and K, D complex (section 5.3).

    Parameters
    ----------
    ring : RingParameters
        The ring.
    damping : RingDamping
        Its damping.
    orders, speed_rad_s : array_like
        Orders n ≥ 0 and angular speeds Ω in rad/s, of shapes that broadcast; at Ω = 0 both members
        of an order share the ratio.
    pressure_load : {"dead", "follower"}
        See `equilibrium`.

    Returns
    -------
    ndarray
        In the broadcast shape.
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
    ring : RingParameters
        The ring.
    damping : RingDamping
        Its damping.
    pressure_load : {"dead", "follower"}
        See `equilibrium`.

    Raises
    ------
    InstabilityError
        Where the static stiffness of the torsion is negative.
    """
    torsion_frequency_hz(ring, pressure_load=pressure_load)  # refuses a ring that has none
    terms = harmonics(ring, 0, pressure_load=pressure_load, damping=damping)
    stiffness = complex(terms.m22) / ring.mass_per_area_kg_m2
    rate = 0.5 * damping.circumferential_n_s_m3 / ring.mass_per_area_kg_m2
    root = 1j * rate + np.sqrt(stiffness - rate**2)  # m22 − ρhω² + iωc_θ = 0
    return float(root.imag / abs(root))


def identify_damping(
    ring: RingParameters,
    orders: ArrayLike,
    damping_ratios: ArrayLike,
    damping_std: ArrayLike | None = None,
    *,
    on_pretension: bool = True,
    pressure_load: PressureLoad = "dead",
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
        Their standard deviations. What is reported never falls below what the misfit implies.
    on_pretension : bool
        Whether η acts on the stiffness from hoop tension too.
    pressure_load : {"dead", "follower"}
        See `equilibrium`.

    Returns
    -------
    DampingResult
        Parameters, standard deviations and what is not identified.

    Raises
    ------
    ParameterError
        For ratios that are not positive, or shapes that do not match.

    Examples
    --------
    >>> import ringmodal as rm
    >>> ring = rm.RingParameters(
    ...     mean_radius_m=0.33,
    ...     mass_per_area_kg_m2=19.69,
    ...     radial_stiffness_n_m3=8.27e6,
    ...     circumferential_stiffness_n_m3=6.56e5,
    ...     axial_stiffness_n_m=2.52e7,
    ...     bending_stiffness_n_m=7.45,
    ...     inflation_pressure_pa=2.2e5,
    ...     belt_width_m=0.19,
    ... )
    >>> found = rm.identify_damping(ring, [1, 2, 3, 4], [0.039, 0.033, 0.024, 0.022])
    >>> found.damping.radial_n_s_m3 > 0
    True
    """
    numbers, measured, relative_given = _checked(orders, damping_ratios, damping_std)

    def damping(values: NDArray[np.float64]) -> RingDamping:
        radial, circumferential, loss_factor = map(float, values)
        return RingDamping(radial, circumferential, loss_factor, on_pretension)

    def model(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return _ratios(ring, damping(values), numbers, pressure_load=pressure_load)

    scale = _scale(ring, numbers)
    values, slope = _fit(model, measured, scale)
    fitted = model(values)
    free = values > 0
    names = tuple(name for name, kept in zip(_NAMES, free, strict=True) if kept)
    fit = LinearFit(names, values[free], slope[:, free], -np.ones(measured.size))
    relative, note = error_level(fit, fitted / measured - 1.0, relative_given)
    covariance = fit.covariance(np.where(np.isfinite(relative), relative, _NOMINAL))
    undetermined = replace(fit, names=_NAMES, values=scale, residual_slope=slope).undetermined()
    how, std = verdicts(fit, covariance, undetermined)
    for name in set(_NAMES) - set(names):
        how[name] = NOT_IDENTIFIED if undetermined[name] else AT_BOUND
    return DampingResult(
        damping=damping(values),
        std=std if np.all(np.isfinite(relative)) else {},
        how={name: how[name] for name in _NAMES},
        orders=numbers,
        measured=measured,
        model=fitted,
        correlation=correlation(names, covariance),
        notes=(f"Damping: {note[0].lower()}{note[1:]}", *_notes(how, measured.size)),
    )


_ratios = damping_ratios  # the name is an argument's in `identify_damping`


def _checked(
    orders: ArrayLike, ratios: ArrayLike, std: ArrayLike | None
) -> tuple[NDArray[np.int_], NDArray[np.float64], NDArray[np.float64] | None]:
    numbers = np.atleast_1d(whole_orders(orders))
    measured = np.atleast_1d(finite_array("damping_ratios", ratios))
    deviations = None if std is None else np.atleast_1d(finite_array("damping_std", std))
    require_one_each("damping_ratios", numbers, measured)
    require_positive("damping_ratios", measured)
    if deviations is None:
        return numbers, measured, None
    require_one_each("damping_std", numbers, deviations)
    require_positive("damping_std", deviations)
    return numbers, measured, deviations / measured


def _scale(ring: RingParameters, orders: NDArray[np.int_]) -> NDArray[np.float64]:
    """Amounts of c_r, c_θ and η that each give damping ratios of some percent."""
    omega = 2.0 * np.pi * float(np.mean(natural_frequencies_hz(ring, orders)))
    viscous = 0.05 * ring.mass_per_area_kg_m2 * omega
    return np.array([viscous, viscous, 0.05])


def _fit(
    model: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    measured: NDArray[np.float64],
    scale: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gauss-Newton with non-negative steps: ratios are nearly linear in light damping.

    Returns the parameters and d(model/measured)/d(parameter) there.
    """
    values = np.zeros(scale.size)
    for _ in range(20):
        at_values = model(values)
        slope = np.column_stack(
            [(model(values + 1e-4 * step) - at_values) / 1e-4 for step in np.diag(scale)]
        )
        slope /= measured[:, None]
        target = 1.0 - at_values / measured + slope @ (values / scale)
        updated = nnls(slope, target)[0] * scale
        done = np.allclose(updated, values, rtol=1e-9, atol=1e-12 * scale.max())
        values = updated
        if done:
            break
    return values, slope / scale


def _notes(how: dict[str, str], n_ratios: int) -> list[str]:
    notes = []
    if n_ratios < len(_NAMES):
        notes.append(f"{n_ratios} damping ratios cannot determine three damping parameters.")
    vague = [name for name in _NAMES if how[name] == NOT_IDENTIFIED]
    if vague:
        notes.append(f"Not identified from these damping ratios: {', '.join(vague)}.")
    bound = [name for name in _NAMES if how[name] == AT_BOUND]
    if bound:
        notes.append(f"The fit wants less than zero and stops there: {', '.join(bound)}.")
    return notes
