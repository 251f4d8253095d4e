"""Steady state of the spinning ring (eq 5) and its circumferential harmonics (eqs 12, 14)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arguments import Array, ReadonlyArrays, finite_array, require_one_of, whole_orders
from model.errors import ParameterError
from model.parameters import LARGEST_HOOP_STRAIN, RingDamping, RingParameters

#: ``"dead"``: pressure keeps its direction (as in the paper); ``"follower"``: normal to the belt.
PressureLoad = Literal["dead", "follower"]
#: Imaginary part over the largest root below which a root counts as real: a double root is
#: resolved to the square root of the machine precision only.
REAL_ROOT = 1e-6


@dataclass(frozen=True, eq=False)
class Equilibrium(ReadonlyArrays):
    """Axisymmetric steady state (u_r°, u_θ° = 0) of the ring at one or many speeds.

    Parameters
    ----------
    speed_rad_s : ndarray
        Angular speeds Ω, rad/s, any shape.
    hoop_strain : ndarray
        ε = u_r°/a, of the same shape.
    tension_stiffness_n_m3 : ndarray
        N0/a² with the hoop tension N0 = K(ε + ε²/2), N/m³, of the same shape.
    mean_radius_m : float
        Mean radius a before inflation, m.
    pressure_load : {"dead", "follower"}
        How the pressure follows the belt.
    """

    speed_rad_s: Array
    hoop_strain: Array
    tension_stiffness_n_m3: Array
    mean_radius_m: float
    pressure_load: PressureLoad

    @property
    def radial_displacement_m(self) -> Array:
        """u_r°, m."""
        return self.mean_radius_m * self.hoop_strain

    @property
    def radius_m(self) -> Array:
        """Radius a + u_r° of the spinning ring, m."""
        return self.mean_radius_m * (1.0 + self.hoop_strain)


def equilibrium(
    ring: RingParameters, speed_rad_s: ArrayLike = 0.0, *, pressure_load: PressureLoad = "dead"
) -> Equilibrium:
    """Solve eq 5 for the steady radial displacement (u_θ° = 0).

    With a radial load ≥ 0 the cubic has exactly one positive root, which is used; the other two are
    negative or complex (the ring inside out). A follower load replaces p_o by p_o(1 + ε).

    Parameters
    ----------
    ring : RingParameters
    speed_rad_s : array_like
        Angular speeds Ω, rad/s, any shape; the sign does not matter here.
    pressure_load : {"dead", "follower"}
        Pressure as the paper's dead load or normal to the deformed belt.

    Returns
    -------
    Equilibrium
        In the shape of `speed_rad_s`.

    Raises
    ------
    ParameterError
        Where the hoop strain would exceed 0.2.
    """
    require_pressure_load(pressure_load)
    speed = finite_array("speed_rad_s", speed_rad_s)
    strain = _positive_root(ring, speed, pressure_load)
    beyond = strain > LARGEST_HOOP_STRAIN
    if np.any(beyond):
        first = float(np.abs(np.broadcast_to(speed, beyond.shape)[beyond]).min())
        rule = f"no equilibrium with a hoop strain of at most {LARGEST_HOOP_STRAIN:g}"
        remedy = "Lower the speed or the pressure, or raise K or k_r"
        raise ParameterError("speed_rad_s", f"{first:g}", rule, remedy)
    tension = ring.axial_stiffness_n_m / ring.mean_radius_m**2 * (strain + 0.5 * strain**2)
    return Equilibrium(speed, strain, np.asarray(tension), ring.mean_radius_m, pressure_load)


def require_pressure_load(pressure_load: str) -> None:
    """Refuse anything but the two known pressure loads."""
    require_one_of("pressure_load", pressure_load, get_args(PressureLoad))


def _positive_root(ring: RingParameters, speed: Array, pressure_load: PressureLoad) -> Array:
    """Newton's method from the right of the root, where the cubic is convex: it converges."""
    membrane = ring.axial_stiffness_n_m / ring.mean_radius_m
    with np.errstate(over="ignore"):  # no equilibrium: refused below
        centrifugal = ring.mass_per_area_kg_m2 * ring.mean_radius_m * speed**2
    load = centrifugal + ring.inflation_pressure_pa
    softening = load if pressure_load == "follower" else centrifugal
    linear = membrane + ring.radial_stiffness_n_m3 * ring.mean_radius_m - softening
    with np.errstate(divide="ignore"):
        strain = np.where(linear > 0, load / np.where(linear > 0, linear, 1.0), np.inf)
    strain = np.minimum(strain, 10.0 * LARGEST_HOOP_STRAIN)  # farther right is refused anyway
    for _ in range(60):
        value = membrane * (1.5 + 0.5 * strain) * strain**2 + linear * strain - load
        slope = membrane * (3.0 + 1.5 * strain) * strain + linear
        step = np.where(slope > 0, value / np.where(slope > 0, slope, 1.0), 0.0)
        strain = strain - step
        if np.all(np.abs(step) <= 4.0 * np.finfo(float).eps * np.abs(strain)):
            break
    return np.asarray(strain)


@dataclass(frozen=True, eq=False)
class Harmonics(ReadonlyArrays):
    """Coefficients of eqs 12 and 14 for orders and speeds of one common (broadcast) shape.

    The matrix of eq 12 is [[m11 − ρhω², i(c − 2ρhΩω)], [−i(c − 2ρhΩω), m22 − ρhω²]], to which
    damping adds iωc_r and iωc_θ on the diagonal. With a loss factor the coefficients are complex.

    Parameters
    ----------
    orders : ndarray of int
        Circumferential orders n, of either sign.
    speed_rad_s : ndarray
        Angular speeds Ω, rad/s.
    m11, m22, c : ndarray
        Static part of M11, M22 and M12/i, N/m³.
    determinant : ndarray
        m11·m22 − c² (a_0 of eq 14), N²/m⁶, formed without the cancellation of the membrane terms.
    inextensional : ndarray
        n²·m11 − 2n·c + m22, N/m³: the static stiffness that is left for u_r = −u_θ' (eq 33), times
        n². It does not contain K.
    mass_per_area_kg_m2 : float
        ρh, kg/m².
    rest : Equilibrium
        The steady state around which eqs 6 and 7 are linearised.
    """

    orders: NDArray[np.int_]
    speed_rad_s: Array
    m11: NDArray[Any]
    m22: NDArray[Any]
    c: NDArray[Any]
    determinant: NDArray[Any]
    inextensional: NDArray[Any]
    mass_per_area_kg_m2: float
    rest: Equilibrium

    @property
    def polynomial(self) -> tuple[float, NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Coefficients a_3, a_2, a_1, a_0 of eq 14: a_3ω⁴ + a_2ω² + a_1ω + a_0 = 0."""
        mass, speed = self.mass_per_area_kg_m2, self.speed_rad_s
        a2 = -mass * (self.m11 + self.m22) - 4.0 * mass**2 * speed**2
        return mass**2, a2, 4.0 * mass * speed * self.c, self.determinant


def harmonics(
    ring: RingParameters,
    orders: ArrayLike,
    speed_rad_s: ArrayLike = 0.0,
    *,
    pressure_load: PressureLoad = "dead",
    damping: RingDamping | None = None,
) -> Harmonics:
    """Coefficients of eq 12 around the equilibrium (eqs 6 and 7, the latter as corrected).

    With S = K/a² + 4N0/a² + Dn²/a⁴ the coefficients are c = nS, m11 = S + P, m22 = n²S + Q, where
    P and Q do not contain K: a_0 = S(n²P + Q) + PQ loses no digits, however stiff the membrane.

    Parameters
    ----------
    ring : RingParameters
    orders, speed_rad_s : array_like
        Orders n and angular speeds Ω in rad/s; the result has their broadcast shape.
    pressure_load : {"dead", "follower"}
        See `equilibrium`. A follower load takes p_o/a from m11 and m22 and n·p_o/a from c.
    damping : RingDamping or None
        Makes K and D complex by its loss factor (section 5.3); the viscous part is not in here.

    Raises
    ------
    ParameterError
        Where a speed has no equilibrium or an order is not a whole number.
    """
    n, speed = np.broadcast_arrays(whole_orders(orders), finite_array("speed_rad_s", speed_rad_s))
    rest = equilibrium(ring, speed, pressure_load=pressure_load)
    elastic = 1.0 if damping is None else 1.0 + 1j * damping.loss_factor
    strained = 1.0 if damping is None or not damping.on_pretension else elastic
    membrane = elastic * ring.axial_stiffness_n_m / ring.mean_radius_m**2
    bending = elastic * ring.bending_stiffness_n_m / ring.mean_radius_m**4 * n**2
    tension = strained * rest.tension_stiffness_n_m3
    normal = ring.inflation_pressure_pa / ring.mean_radius_m if pressure_load == "follower" else 0.0
    spin = ring.mass_per_area_kg_m2 * speed**2
    bed_r, bed_t = ring.radial_stiffness_n_m3, ring.circumferential_stiffness_n_m3

    s = membrane + 4.0 * tension + bending - normal
    arch = (n**2 - 1) * (tension + bending)
    p = arch + bed_r - spin
    q = (n**2 - 1) * normal - arch + bed_t - spin
    inextensional = (n**2 - 1) * (arch + normal) + n**2 * bed_r + bed_t - (n**2 + 1) * spin
    return Harmonics(
        orders=n,
        speed_rad_s=speed,
        m11=np.asarray(s + p),
        m22=np.asarray(n**2 * s + q),
        c=np.asarray(n * s),
        determinant=np.asarray(s * inextensional + p * q),
        inextensional=np.asarray(inextensional),
        mass_per_area_kg_m2=ring.mass_per_area_kg_m2,
        rest=rest,
    )


def inextensional_roots(terms: Harmonics) -> Array:
    """Smaller squared roots ω² of eq 14 (undamped, Ω = 0), rad²/s²."""
    total = terms.m11 + terms.m22
    root = np.sqrt((terms.m11 - terms.m22) ** 2 + 4.0 * terms.c**2)
    larger = 0.5 * (total + root)
    return np.asarray(terms.determinant / larger / terms.mass_per_area_kg_m2)


def characteristic_roots(
    ring: RingParameters,
    orders: ArrayLike,
    speed_rad_s: ArrayLike = 0.0,
    *,
    pressure_load: PressureLoad = "dead",
    damping: RingDamping | None = None,
) -> NDArray[np.complex128]:
    """Roots ω of the characteristic polynomial (eq 14) in the order k = 1…4 of Table 1.

    For n ≥ 1: k = 1 inextensional and positive (regressive wave), k = 2 inextensional and
    negative (progressive wave), k = 3 and 4 the same for the extensional pair. For n ≤ −1 (Table 1
    as corrected) all signs are inverted. For n = 0 the first pair is the torsion, the second the
    breathing. Above a critical speed a sign may change; the sequence by size does not.

    Parameters
    ----------
    ring, orders, speed_rad_s, pressure_load
        As `harmonics`.
    damping : RingDamping or None
        Viscous foundation and loss factor. A loss factor holds for e^{+iωt} with Re ω > 0.

    Returns
    -------
    ndarray of complex, shape (..., 4)
        ω in rad/s, rotating frame. An undamped stable root is exactly real; a root with Im ω < 0
        grows in time: an instability, not a frequency.
    """
    terms = harmonics(ring, orders, speed_rad_s, pressure_load=pressure_load, damping=damping)
    polynomial = _polynomial(terms, damping)
    roots = _polish(polynomial, _companion_eigenvalues(polynomial))
    if damping is None:
        size = np.abs(roots).max(axis=-1, keepdims=True)
        roots = np.where(np.abs(roots.imag) <= REAL_ROOT * size, roots.real, roots)
    return _in_table_order(roots, terms.orders)


def eigenvector_ratios(
    ring: RingParameters,
    orders: ArrayLike,
    speed_rad_s: ArrayLike = 0.0,
    *,
    pressure_load: PressureLoad = "dead",
) -> Array:
    """Ratios b_k of the eigenvectors [1, i·b_k] of eq 12, in the order k = 1…4 of Table 2.

    Table 2 writes the sign out: b = B_{n,k} for the inextensional pair of n ≥ 1, −B_{n,k} for the
    extensional one; both change sign with n (as corrected: n ≤ −1).

    Parameters
    ----------
    ring, orders, speed_rad_s, pressure_load
        As `harmonics`, with n ≠ 0.

    Returns
    -------
    ndarray, shape (..., 4)
        NaN where the root is unstable.

    Raises
    ------
    ParameterError
        For order 0, whose torsion has no radial part to be scaled by.
    """
    terms = harmonics(ring, orders, speed_rad_s, pressure_load=pressure_load)
    if np.any(terms.orders == 0):
        raise ParameterError("orders", "0", "only orders n ≠ 0 have a ratio u_θ/u_r", "Drop it")
    roots = characteristic_roots(ring, orders, speed_rad_s, pressure_load=pressure_load)
    omega = np.where(roots.imag == 0, roots.real, np.nan)
    mass, speed = terms.mass_per_area_kg_m2, terms.speed_rad_s[..., None]
    coupling = terms.c[..., None] - 2.0 * mass * speed * omega
    return np.asarray(coupling / (terms.m22[..., None] - mass * omega**2))


def _polynomial(terms: Harmonics, damping: RingDamping | None) -> NDArray[Any]:
    """Monic coefficients of ω³, ω², ω, 1, shape (..., 4)."""
    mass, a2, a1, a0 = terms.polynomial
    if damping is None:
        zero = np.zeros_like(a2)
        return np.stack([zero, a2, a1, a0], axis=-1) / mass
    c_r, c_t = damping.radial_n_s_m3, damping.circumferential_n_s_m3
    cubic = np.full(a2.shape, -1j * terms.mass_per_area_kg_m2 * (c_r + c_t))
    linear = a1 + 1j * (c_r * terms.m22 + c_t * terms.m11)
    return np.stack([cubic, a2 - c_r * c_t, linear, a0.astype(complex)], axis=-1) / mass


def _companion_eigenvalues(polynomial: NDArray[Any]) -> NDArray[np.complex128]:
    """Roots as eigenvalues of companion matrices in ω/size, so that no entry overflows."""
    powers = np.arange(1, 5)
    size = np.maximum.reduce([np.abs(polynomial[..., k - 1]) ** (1.0 / k) for k in powers])
    scaled = polynomial / size[..., None] ** powers
    companion = np.zeros((*scaled.shape, 4), dtype=scaled.dtype)
    companion[..., 0, :] = -scaled
    companion[..., [1, 2, 3], [0, 1, 2]] = 1.0
    return np.asarray(np.linalg.eigvals(companion) * size[..., None], dtype=complex)


def _polish(polynomial: NDArray[Any], roots: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Two Newton steps: the inner roots are small beside the outer ones that set the scale."""
    b3, b2, b1, b0 = (polynomial[..., k, None] for k in range(4))
    size = np.abs(roots).max(axis=-1, keepdims=True)
    for _ in range(2):
        value = (((roots + b3) * roots + b2) * roots + b1) * roots + b0
        slope = ((4.0 * roots + 3.0 * b3) * roots + 2.0 * b2) * roots + b1
        step = np.where(slope == 0, 0.0, value / np.where(slope == 0, 1.0, slope))
        roots = roots - np.where(np.abs(step) < 1e-6 * size, step, 0.0)
    return roots


def _in_table_order(
    roots: NDArray[np.complex128], orders: NDArray[np.int_]
) -> NDArray[np.complex128]:
    """Sort: inner pair first, and in each pair the positive root first for n ≥ 0."""
    ascending = np.take_along_axis(roots, np.lexsort((roots.imag, roots.real), axis=-1), axis=-1)
    positive = (orders >= 0)[..., None]
    return np.where(positive, ascending[..., [2, 1, 3, 0]], ascending[..., [1, 2, 0, 3]])
