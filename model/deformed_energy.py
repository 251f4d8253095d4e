"""Slope and curvature of the energies of a ring deformed at will (eqs 43, 46, 47)."""

from __future__ import annotations

import numpy as np

from model.circle_fields import Array, CircleFields
from model.parameters import RingParameters
from model.steady_state import PressureLoad


def elastic_slope(ring: RingParameters, fields: CircleFields, coefficients: Array) -> Array:
    """First derivative of the strain energies of belt and foundation (eqs 43, 46 as corrected).

    Parameters
    ----------
    ring : RingParameters
        The ring.
    fields : CircleFields
        Basis and points.
    coefficients : ndarray, shape (n_coefficients,)
        Whole displacement, u_r° included.

    Returns
    -------
    ndarray, shape (n_coefficients,)
        Per unit of belt width, N/m.
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

    Parameters
    ----------
    ring, fields
        As `elastic_slope`.
    place : ndarray, shape (n_coefficients,)
        Coefficients of the belt's place (a + u_r, u_θ).
    pressure_load : {"dead", "follower"}
        The follower load is the pressure times the slope of the enclosed area.
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
