"""Ring and wheel: roots with a free hub, forces on the hub, its motion (eqs 8–10).

Order 0 turns the wheel and orders ±1 move it; no other order is coupled to it. Unknowns are
[A, B, θ_w] for order 0 and [A, B, (x_w ∓ iz_w)/2] for orders ±1, equations are divided by 2πa:

    n = +1: [[M11, M12, −κ_r], [−M12, M22, −iκ_θ], [−κ_r, iκ_θ, κ_r + κ_θ − (m/πa)(ω − Ω)²]]
    n = 0:  M23 = M32 = −Rκ_θ + k_r·u_r°,  M33 = R²κ_θ − R·k_r·u_r° − I_rω²/(2πa),  R = a + u_r°

with κ = k + iωc. Both hold for a foundation that turns with the wheel (objective). With the dead
load, the paper's eqs 10 and 45b apply instead: R → a and no k_r·u_r° terms.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arguments import Array, ReadonlyArrays, require_one_of
from model.coefficients import REAL_ROOT, PressureLoad
from model.errors import ParameterError
from model.forced import Complex, Direction, ForcedRing, angular_frequency
from model.parameters import RingDamping, RingParameters, Wheel
from model.ring import belt_width_m

_UNDAMPED = RingDamping(0.0, 0.0, 0.0)


def free_hub_roots(
    ring: RingParameters,
    wheel: Wheel,
    order: int,
    speed_rad_s: float = 0.0,
    *,
    damping: RingDamping | None = None,
    pressure_load: PressureLoad = "follower",
) -> NDArray[np.complex128]:
    """Characteristic roots of order 0 or 1 with a wheel that is free to move.

    Parameters
    ----------
    ring : RingParameters
        With its belt width.
    wheel : Wheel
    order : {0, 1}
        0: rotation of belt and wheel, and breathing; 1: translation of belt and wheel.
    speed_rad_s : float
        Angular speed Ω, rad/s.
    damping : RingDamping or None
        Viscous foundation and loss factor, the latter for Re ω > 0.
    pressure_load : {"dead", "follower"}
        A dead load and the paper's foundation hold the wheel against rotation, which is unphysical.

    Returns
    -------
    ndarray of complex, shape (6,)
        ω in rad/s, rotating frame, ascending real part. With a follower load a free wheel has the
        double root 0 (order 0, at any speed) and Ω (order 1, rigid translation).

    Raises
    ------
    ParameterError
        For another order, or a ring without belt width.
    """
    if order not in (0, 1):
        raise ParameterError("order", f"{order}", "the wheel couples to 0 and 1", "Use 0 or 1")
    forced = ForcedRing(ring, damping or _UNDAMPED, speed_rad_s, wheel, pressure_load)
    inertia, first, static = _matrix_polynomial(forced, order)
    below = np.hstack([static, first]) / inertia[:, None]
    roots = np.linalg.eigvals(np.vstack([np.eye(3, 6, 3), below]))
    if damping is None:
        flat = np.abs(roots.imag) <= REAL_ROOT * np.abs(roots).max()
        roots = np.where(flat, roots.real, roots)
    return np.asarray(np.sort_complex(roots))


def _matrix_polynomial(forced: ForcedRing, order: int) -> tuple[Array, Complex, Complex]:
    """Diagonal inertia J and matrices of −Jω² + first·ω + static, rows of unknowns as above."""
    ring, speed, damping = forced.ring, forced.speed_rad_s, forced.damping
    terms = forced.terms(order)
    rho = ring.mass_per_area_kg_m2
    own = float(forced.wheel_inertia(order, np.array([1.0 + order * speed]))[0])
    static = np.zeros((3, 3), dtype=complex)
    static[:2, :2] = [[terms.m11, 1j * terms.c], [-1j * terms.c, terms.m22]]
    viscous = np.diag([damping.radial_n_s_m3, damping.circumferential_n_s_m3, 0.0]).astype(complex)
    first = np.zeros((3, 3), dtype=complex)
    if order == 0:
        coupling, turning = (part[0] for part in forced.turning_terms(np.zeros(1)))
        arm, _ = forced.moment_arms()
        static[1:, 1:] += [[0.0, coupling], [coupling, turning]]
        around = damping.circumferential_n_s_m3
        viscous[1:, 1:] += np.array([[0.0, -arm * around], [-arm * around, arm**2 * around]])
    else:
        k_r, k_t = ring.radial_stiffness_n_m3, ring.circumferential_stiffness_n_m3
        c_r, c_t = damping.radial_n_s_m3, damping.circumferential_n_s_m3
        static += _translation(k_r, k_t) - np.diag([0.0, 0.0, own * speed**2])
        viscous += _translation(c_r, c_t)
        first[2, 2] = 2.0 * own * speed
    first += 1j * viscous
    first[0, 1] -= 2j * rho * speed
    first[1, 0] += 2j * rho * speed
    return np.array([rho, rho, own]), first, static


def _translation(radial: float, around: float) -> Complex:
    """Bed terms that a moving wheel adds to order 1."""
    return np.array(
        [[0.0, 0.0, -radial], [0.0, 0.0, -1j * around], [-radial, 1j * around, radial + around]]
    )


@dataclass(frozen=True, eq=False)
class HubResponse(ReadonlyArrays):
    """Forces at the hub and its motion for a unit force on the belt, over frequency.

    Forces and motion are along the axes of the observer's frame; z lies at θ = 90°.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_frequencies,)
        Frequencies, Hz.
    force_x, force_z : ndarray of complex, shape (n_frequencies,)
        Force on the hub over force on the belt, N/N (transmissibility).
    moment_m : ndarray of complex, shape (n_frequencies,)
        Moment on the hub over force on the belt, N·m/N.
    x_m_n, z_m_n, rotation_rad_n : ndarray of complex, shape (n_frequencies,)
        Displacements in m/N and rotation in rad/N of a free wheel; zero for a fixed one.
    """

    frequency_hz: Array
    force_x: Complex
    force_z: Complex
    moment_m: Complex
    x_m_n: Complex
    z_m_n: Complex
    rotation_rad_n: Complex


def hub_response(
    forced: ForcedRing,
    frequency_hz: ArrayLike,
    force_rad: float = 0.0,
    *,
    force_direction: Direction = "radial",
) -> HubResponse:
    """Transmissibility from a force on the belt to the hub, and the wheel's motion (eqs 8–10).

    Parameters
    ----------
    forced : ForcedRing
        Ring with belt width, damping, speed, hub and frame. In the absolute frame the force stays
        in space (the contact of a rolling tyre) and hub forces are along fixed axes.
    frequency_hz : array_like, shape (n_frequencies,)
        Frequencies above zero, Hz.
    force_rad : float
        Angle of the force on the belt, rad.
    force_direction : {"radial", "circumferential"}
        Direction of the force.

    Returns
    -------
    HubResponse
        Per unit of force.

    Raises
    ------
    ParameterError
        For a ring without belt width or an unknown direction.
    """
    require_one_of("force_direction", force_direction, get_args(Direction))
    omega = angular_frequency(frequency_hz)
    backward, turning, forward = (
        _one_order(forced, order, omega, force_rad, force_direction) for order in (-1, 0, 1)
    )
    (force_back, move_back), (force_on, move_on) = backward, forward
    return HubResponse(
        frequency_hz=omega / (2.0 * np.pi),
        force_x=force_on + force_back,
        force_z=1j * (force_on - force_back),
        moment_m=turning[0],
        x_m_n=move_on + move_back,
        z_m_n=1j * (move_on - move_back),
        rotation_rad_n=turning[1],
    )


def _one_order(
    forced: ForcedRing, order: int, omega: Array, force_rad: float, direction: Direction
) -> tuple[Complex, Complex]:
    """Force on the wheel and the wheel's motion in the unknown of one order."""
    found = forced.compliance(np.array([order]), omega)
    radial, cross, circumferential = (part[0] for part in found)
    line = np.pi * forced.ring.mean_radius_m * belt_width_m(forced.ring)
    load = np.exp(-1j * order * force_rad) / (2.0 * line)
    radial_u, around_u = (radial, cross) if direction == "radial" else (-cross, circumferential)
    turning = forced.rotating_omega(np.array([order]), omega)[0]
    inertia = forced.wheel_inertia(order, turning)
    if order == 0:
        coupling, own = forced.turning_terms(turning)
        pull, line = -coupling * load * around_u, 2.0 * line
    else:
        radial_bed, around_bed = forced.bed(turning)
        pull = load * (radial_bed * radial_u - 1j * order * around_bed * around_u)
        own = radial_bed + around_bed
    moved = pull / (own - inertia)
    return line * (pull - own * moved), moved
