"""Displacement fields on the circle as Fourier series, modes in them, and the strains of eq 3."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.arguments import Array, ReadonlyArrays
from model.coefficients import PressureLoad
from model.parameters import RingParameters


@dataclass(frozen=True, eq=False)
class CircleFields(ReadonlyArrays):
    """Matrices that take Fourier coefficients of (u_r, u_θ) to fields at points of the circle.

    Coefficients are [constant, cosines 1…N, sines 1…N] of u_r, then those of u_θ, in a basis whose
    functions all have the same norm, ∫φ²dθ = π: the constant is 1/√2.
    Fields have the shape (n_points, n_coefficients).
    """

    highest_order: int  # N
    angles_rad: Array  # equidistant
    radial: Array  # u_r
    circumferential: Array  # u_θ
    stretch: Array  # linear parts of eq 3: (u_r + u_θ')/a
    rotation: Array  # (u_θ − u_r')/a
    bending: Array  # (u_θ' − u_r'')/a²
    convection: Array  # W: a point of the turning ring moves at u̇ + ΩWu in space; antisymmetric

    @property
    def weight_rad(self) -> float:
        """Angle between points, rad."""
        return 2.0 * np.pi / self.angles_rad.size

    @property
    def orders(self) -> NDArray[np.int_]:
        """Circumferential order of each coefficient."""
        half = np.arange(1, self.highest_order + 1)
        return np.tile(np.concatenate([[0], half, half]), 2)

    def uniform_radial(self, value: float) -> Array:
        """Coefficients of u_r = `value`, u_θ = 0."""
        coefficients = np.zeros(self.orders.size)
        coefficients[0] = np.sqrt(2.0) * value
        return coefficients


@dataclass(frozen=True, eq=False)
class LoadedModes(ReadonlyArrays):
    """Modes of a loaded ring.

    Parameters
    ----------
    fields : CircleFields
        Basis of the shapes.
    frequency_hz : ndarray, shape (n_modes,)
        Natural frequencies seen from space, ascending, Hz.
    shapes : ndarray, shape (n_coefficients, n_modes)
        Shapes in the coefficients of the fields; complex where the ring turns.
    """

    fields: CircleFields
    frequency_hz: Array
    shapes: NDArray[np.inexact[Any]]

    @property
    def share_of_order(self) -> Array:
        """Share of each order in the power of each shape, (highest_order + 1, n_modes)."""
        shares = np.zeros((self.fields.highest_order + 1, self.shapes.shape[1]))
        np.add.at(shares, self.fields.orders, np.abs(self.shapes) ** 2)
        return np.asarray(shares / shares.sum(axis=0))

    @property
    def dominant_order(self) -> NDArray[np.int_]:
        """Order with the largest share, per mode."""
        return np.asarray(self.share_of_order.argmax(axis=0))


def circle_fields(ring: RingParameters, highest_order: int, n_points: int) -> CircleFields:
    """Build the matrices for harmonics up to `highest_order` at `n_points` equidistant angles."""
    a = ring.mean_radius_m
    angles = 2.0 * np.pi * np.arange(n_points) / n_points
    orders = np.arange(1, highest_order + 1)
    basis = fourier_basis(highest_order, angles)
    slope = np.zeros((basis.shape[1], basis.shape[1]))
    cosine, sine = orders, orders + highest_order
    slope[sine, cosine], slope[cosine, sine] = -orders, orders
    none, one = np.zeros_like(basis), np.eye(slope.shape[0])
    radial, circumferential = np.hstack([basis, none]), np.hstack([none, basis])
    radial_slope = np.hstack([basis @ slope, none])
    circumferential_slope = np.hstack([none, basis @ slope])
    radial_curvature = np.hstack([basis @ slope @ slope, none])
    return CircleFields(
        highest_order=highest_order,
        angles_rad=angles,
        radial=radial,
        circumferential=circumferential,
        stretch=(radial + circumferential_slope) / a,
        rotation=(circumferential - radial_slope) / a,
        bending=(circumferential_slope - radial_curvature) / a**2,
        convection=np.block([[slope, -one], [one, slope]]),
    )


def fourier_basis(highest_order: int, angles_rad: Array) -> Array:
    """Constant, cosines and sines at any angles, (n_angles, 2·highest_order + 1)."""
    around = angles_rad[:, None] * np.arange(1, highest_order + 1)
    constant = np.full((angles_rad.size, 1), 1.0 / np.sqrt(2.0))
    return np.hstack([constant, np.cos(around), np.sin(around)])


def elastic_slope(ring: RingParameters, fields: CircleFields, coefficients: Array) -> Array:
    """First derivative of the strain energies of belt and foundation (eqs 43, 46 as corrected).

    `coefficients` are those of the total displacement, u_r° included. Shape (n_coefficients,), per
    unit of belt width, N/m.
    """
    stretch, rotation, strain = _strains(fields, coefficients)
    force = ring.axial_stiffness_n_m * strain
    moment = ring.bending_stiffness_n_m * (fields.bending @ coefficients)
    outward = ring.radial_stiffness_n_m3 * (fields.radial @ coefficients)
    around = ring.circumferential_stiffness_n_m3 * (fields.circumferential @ coefficients)
    slope = (
        fields.stretch.T @ (force * (1.0 + stretch))
        + fields.rotation.T @ (force * rotation)
        + fields.bending.T @ moment
        + fields.radial.T @ outward
        + fields.circumferential.T @ around
    )
    return np.asarray(slope * ring.mean_radius_m * fields.weight_rad)


def elastic_curvature(ring: RingParameters, fields: CircleFields, coefficients: Array) -> Array:
    """Second derivative of the same energies, shape (n_coefficients, n_coefficients), N/m²."""
    stretch, rotation, strain = _strains(fields, coefficients)
    slope = (1.0 + stretch)[:, None] * fields.stretch + rotation[:, None] * fields.rotation
    tension = (ring.axial_stiffness_n_m * strain)[:, None]
    matrix = (
        ring.axial_stiffness_n_m * slope.T @ slope
        + fields.stretch.T @ (tension * fields.stretch)
        + fields.rotation.T @ (tension * fields.rotation)
        + ring.bending_stiffness_n_m * fields.bending.T @ fields.bending
        + ring.radial_stiffness_n_m3 * fields.radial.T @ fields.radial
        + ring.circumferential_stiffness_n_m3 * fields.circumferential.T @ fields.circumferential
    )
    return np.asarray(matrix * ring.mean_radius_m * fields.weight_rad)


def pressure_force(
    ring: RingParameters, fields: CircleFields, place: Array, pressure_load: PressureLoad
) -> Array:
    """Generalised force of the inflation pressure (eq 47), N/m.

    `place` holds the coefficients of (a + u_r, u_θ). A follower load is the pressure times the
    slope of the enclosed area.
    """
    if pressure_load == "follower":
        return np.asarray(ring.inflation_pressure_pa * area_curvature(fields) @ place)
    line = ring.inflation_pressure_pa * ring.mean_radius_m * fields.weight_rad
    return np.asarray(line * fields.radial.sum(axis=0))


def area_curvature(fields: CircleFields) -> Array:
    """Second derivative of the enclosed area ½∮r × dr, which is quadratic in the belt's place."""
    half = fields.orders.size // 2
    turn = np.zeros((2 * half, 2 * half))
    turn[:half, half:], turn[half:, :half] = np.eye(half), -np.eye(half)
    return np.asarray(np.pi * turn @ fields.convection)


def _strains(fields: CircleFields, coefficients: Array) -> tuple[Array, Array, Array]:
    """Linear stretch and rotation, and the hoop strain of eq 3 at the middle line."""
    stretch, rotation = fields.stretch @ coefficients, fields.rotation @ coefficients
    return stretch, rotation, stretch + 0.5 * (stretch**2 + rotation**2)
