"""Known modes of simulated tyres and structures, with their exact inertance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model import damping_ratios, modal_mass_kg, natural_frequencies_hz
from model.parameters import (
    REFITTED_DAMPING,
    TABLE_3_DAMPING_RATIOS,
    TABLE_3_FREQUENCIES_HZ,
    TABLE_3_ORDERS,
    TABLE_4_RING,
)

HIGHEST_ORDER = 16
_LINES_AT_ONCE = 8192


Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Modes = NDArray[np.int_] | slice


@dataclass(frozen=True)
class TruthMode:
    """One real mode of a tyre with radial shape cos(n(θ − orientation))."""

    order: int  # circumferential order n
    member: str  # "a" or "b" of a split pair; empty if both members of the order coincide
    frequency_hz: float  # undamped natural frequency
    damping_ratio: float
    modal_mass_kg: float  # for a unit amplitude of the shape
    orientation_deg: float = 0.0  # angle of an antinode

    def shape(self, angles_deg: Floats) -> Floats:
        """Radial shape at `angles_deg`."""
        return np.asarray(np.cos(self.order * np.deg2rad(angles_deg - self.orientation_deg)))


def truth_modes(
    *, split_percent: float = 0.0, shaker_between: float = 0.5, both: bool = False
) -> tuple[TruthMode, ...]:
    """Modes of the tyre of the paper.

    Orders 1 to 7 have the frequencies and damping ratios of Table 3; orders 8 to 16 and the
    breathing mode those of the ring of Table 4 with the damping refitted to Table 3. Modal masses
    are those of the ring.

    `split_percent` is the distance between the two frequencies of each order n ≥ 1 in percent of
    their mean; without it a force at 0° excites the cosine member alone, and `both` adds the other
    one for forces elsewhere. `shaker_between` is the
    place of that force on a split order: 0 on an antinode of member a, 1 on one of member b.
    """
    orders = np.arange(HIGHEST_ORDER + 1)
    frequencies = natural_frequencies_hz(TABLE_4_RING, orders)
    ratios = damping_ratios(TABLE_4_RING, REFITTED_DAMPING, orders)
    frequencies[TABLE_3_ORDERS] = TABLE_3_FREQUENCIES_HZ
    ratios[TABLE_3_ORDERS] = TABLE_3_DAMPING_RATIOS
    masses = modal_mass_kg(TABLE_4_RING, orders)
    modes: list[TruthMode] = []
    rows = zip(frequencies.tolist(), ratios.tolist(), masses.tolist(), strict=True)
    for order, (frequency, ratio, mass) in enumerate(rows):
        if order == 0 or not (split_percent or both):
            modes.append(TruthMode(order, "", frequency, ratio, mass))
            continue
        turned = -90.0 / order * shaker_between
        for member, sign, angle in (("a", -1, turned), ("b", 1, turned + 90.0 / order)):
            moved = frequency * (1.0 + sign * split_percent / 200.0)
            modes.append(TruthMode(order, member, moved, ratio, mass, angle))
    return tuple(modes)


@dataclass(frozen=True, eq=False)
class System:
    """Poles and residue vectors of a structure in one state, driven at one point."""

    poles: Complexes  # shape (n_modes,); poles in the upper half plane, ascending, rad/s
    vectors: Complexes  # shape (n_coordinates, n_modes); mode shapes
    participation: Complexes  # shape (n_modes,); from shape to residue of receptance, unit force
    left: Complexes  # shape (n_modes, n_coordinates); velocity part of left vectors over the mass

    def residues(self, rows: Floats) -> Complexes:
        """Residues of receptance at points whose motion is ``rows @ coordinates``."""
        return np.asarray((rows @ self.vectors) * self.participation, dtype=complex)

    def inertance(self, rows: Floats, omega: Floats, modes: Modes = slice(None)) -> Complexes:
        """Inertance at points, of all or some `modes`, shape (n_points, n_lines), (m/s²)/N."""
        return _inertance(self.poles[modes], self.residues(rows)[:, modes], omega)


def solve(mass: Floats, damping: Floats, stiffness: Floats, drive: Floats) -> System:
    """Exact poles and residue vectors for a force on ``drive @ coordinates``."""
    size = len(mass)
    inverse = np.linalg.inv(mass)
    below = np.hstack([-inverse @ stiffness, -inverse @ damping])
    poles, vectors = np.linalg.eig(np.vstack([np.eye(size, 2 * size, size), below]))
    left = np.linalg.inv(vectors)[:, size:] @ inverse
    upper = np.flatnonzero(poles.imag > 0)
    upper = upper[np.argsort(np.abs(poles[upper]))]
    return System(poles[upper], vectors[:size, upper], left[upper] @ drive, left[upper])


def _inertance(poles: Complexes, residues: Complexes, omega: Floats) -> Complexes:
    """H = −ω² Σ_r [A_r/(jω − s_r) + A*_r/(jω − s*_r)] of residues A, shape (..., n_modes)."""
    values = np.empty((*residues.shape[:-1], omega.size), dtype=complex)
    for start in range(0, omega.size, _LINES_AT_ONCE):
        lines = slice(start, start + _LINES_AT_ONCE)
        s = 1j * omega[lines]
        values[..., lines] = residues @ (1 / (s - poles[:, None]))
        values[..., lines] += residues.conj() @ (1 / (s - poles.conj()[:, None]))
    return np.asarray(values * -(omega**2))


@dataclass(frozen=True, eq=False)
class ModalSum:
    """Inertance as a sum over poles."""

    poles: Complexes  # shape (n_modes,); poles s_r in the upper half plane, rad/s
    residues: Complexes  # shape (n_positions, n_modes); residues A_ir of receptance

    def inertance(self, position: int, omega: Floats) -> Complexes:
        """Inertance of one position at angular frequencies `omega`, (m/s²)/N."""
        return _inertance(self.poles, self.residues[position], omega)


def _along(mode: TruthMode, angles_deg: Floats) -> Floats:
    """Tangential part of a shape: a quarter wave further on, 1/n of the radial one."""
    if not mode.order:
        return np.zeros(angles_deg.size)
    return np.asarray(mode.shape(angles_deg + 90.0 / mode.order) / mode.order)


def modal_sum(
    modes: tuple[TruthMode, ...],
    angles_deg: Floats,
    force_deg: float,
    *,
    sensor_mass_kg: float = 0.0,
) -> ModalSum:
    """Poles and residues of the tyre with a sensor of some mass at each of `angles_deg`.

    The mass of the sensors is added in modal coordinates, so poles and residues are exact for the
    modes given. Sensors move along the belt too, which does not stretch: v' = −w.
    """
    omega = 2.0 * np.pi * np.array([mode.frequency_hz for mode in modes])
    mass = np.array([mode.modal_mass_kg for mode in modes])
    ratio = np.array([mode.damping_ratio for mode in modes])
    shapes = np.column_stack([mode.shape(angles_deg) for mode in modes])
    at_force = np.array([mode.shape(np.array([force_deg]))[0] for mode in modes])
    along = np.column_stack([_along(mode, angles_deg) for mode in modes])
    inertia = np.diag(mass) + sensor_mass_kg * (shapes.T @ shapes + along.T @ along)
    stiffness, damping = np.diag(mass * omega**2), np.diag(2.0 * mass * ratio * omega)
    system = solve(inertia, damping, stiffness, at_force)
    return ModalSum(system.poles, system.residues(shapes))
