"""Displacement fields on the circle as Fourier series, and the strains of eq 3 at its points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model._arrays import readonly
from model.parameters import RingParameters

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CircleFields:
    """Matrices that take Fourier coefficients of (u_r, u_θ) to fields at points of the circle.

    Coefficients are [constant, cosines 1…N, sines 1…N] of u_r, then those of u_θ, in a basis whose
    functions all have the same norm, ∫φ²dθ = π: the constant is 1/√2.

    Parameters
    ----------
    highest_order : int
        N.
    angles_rad : ndarray, shape (n_points,)
        Equidistant angles, rad.
    radial, circumferential : ndarray, shape (n_points, n_coefficients)
        u_r and u_θ.
    stretch, rotation, bending : ndarray, shape (n_points, n_coefficients)
        Linear parts of eq 3: (u_r + u_θ')/a, (u_θ − u_r')/a, (u_θ' − u_r'')/a².
    convection : ndarray, shape (n_coefficients, n_coefficients)
        W: a point of the turning ring moves at u̇ + ΩWu seen from space; antisymmetric.
    """

    highest_order: int
    angles_rad: Array
    radial: Array
    circumferential: Array
    stretch: Array
    rotation: Array
    bending: Array
    convection: Array

    def __post_init__(self) -> None:
        for name in (
            "angles_rad",
            "radial",
            "circumferential",
            "stretch",
            "rotation",
            "bending",
            "convection",
        ):
            object.__setattr__(self, name, readonly(getattr(self, name)))

    @property
    def weight_rad(self) -> float:
        """Angle that each point stands for, rad."""
        return 2.0 * np.pi / self.angles_rad.size

    @property
    def orders(self) -> NDArray[np.int_]:
        """Circumferential order of each coefficient."""
        half = np.arange(1, self.highest_order + 1)
        one = np.concatenate([[0], half, half])
        return np.concatenate([one, one])

    def uniform_radial(self, value: float) -> Array:
        """Coefficients of u_r = `value`, u_θ = 0."""
        coefficients = np.zeros(self.orders.size)
        coefficients[0] = np.sqrt(2.0) * value
        return coefficients


def circle_fields(ring: RingParameters, highest_order: int, n_points: int) -> CircleFields:
    """Build the matrices for harmonics up to `highest_order` at `n_points` equidistant angles."""
    a = ring.mean_radius_m
    angles = 2.0 * np.pi * np.arange(n_points) / n_points
    orders = np.arange(1, highest_order + 1)
    constant = np.full((n_points, 1), 1.0 / np.sqrt(2.0))
    around = angles[:, None] * orders
    basis = np.hstack([constant, np.cos(around), np.sin(around)])
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
