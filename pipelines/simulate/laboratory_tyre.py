"""The structure of a laboratory tyre: mass, damping and stiffness matrices, poles and residues.

Ring energies are integrated over the angle in Fourier orders of radial and tangential motion, so
that mass, stiffness and damping may vary around the tyre. Nothing is taken from `model` but the
parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from model.parameters import RingDamping, RingParameters
from pipelines.simulate.laboratory_effects import Effects
from pipelines.simulate.truth import Complexes, Floats, System, solve

# To twelve sensors orders n and n ± 12 look alike: what a mass does to orders that a tyre has and
# the laboratory has not would not be tested.
HIGHEST_ORDER = 28
# Orders of the coordinates of a direction, and whether each is a sine.
ORDERS = np.append(0, np.repeat(np.arange(1, HIGHEST_ORDER + 1), 2))
SINE = np.append(0, np.tile([0, 1], HIGHEST_ORDER))
GRID = 256  # points of the integration; exact up to order 128 of integrand
_VARIED_ORDERS = 28  # order 2n of a variation splits the pair n
SPLICE_DEG = 8.0

# Rubber and steel of passenger-car tyres around a 225/55R17, uniformly drawn.
RING_RANGES = {
    "mean_radius_m": (0.30, 0.36),
    "mass_per_area_kg_m2": (16.5, 22.0),
    "radial_stiffness_n_m3": (6.5e6, 9.5e6),
    "circumferential_stiffness_n_m3": (5.5e5, 1.2e6),
    "axial_stiffness_n_m": (2.2e7, 2.8e7),
    "bending_stiffness_n_m": (5.0, 9.0),
    "inflation_pressure_pa": (2.0e5, 2.7e5),
    "belt_width_m": (0.17, 0.22),
}
DAMPING_RANGES = {
    "radial_n_s_m3": (350.0, 800.0),
    "circumferential_n_s_m3": (400.0, 900.0),
    "loss_factor": (0.018, 0.032),
}
STIFFNESSES = (
    "radial_stiffness_n_m3",
    "circumferential_stiffness_n_m3",
    "axial_stiffness_n_m",
    "bending_stiffness_n_m",
    "inflation_pressure_pa",
)
HIGHEST_ORDER_7_HZ = 255.0  # order 7 stays clear of the default band's end

RIM_DAMPING = 0.03  # damping ratio of the fixture
RIM_GYRATION_M = 0.17
LATERAL_DAMPING = 0.025
LATERAL_MASS_KG = 6.0
LATERAL_SEEN = 0.15  # radial part of a lateral mode's motion
CAVITY_DAMPING = 0.004
CAVITY_MASS_KG = 0.1
CAVITY_SPEED_M_S = 344.0
CAVITY_RADIUS = 0.82  # radius of the air's centre line over that of the belt
CAVITY_PAIR = np.array([0.996, 1.004])  # both frequencies over that of air alone


@dataclass(frozen=True)
class State:
    """What changes during a campaign: pressure, frequencies and damping ratios, as factors."""

    pressure: float = 1.0
    frequency: float = 1.0
    damping: float = 1.0


NOMINAL = State()


def random_ring(seed: int) -> tuple[RingParameters, RingDamping]:
    """Draw the uniform part of a tyre."""
    random = np.random.default_rng([seed, 0])
    while True:
        ring = RingParameters(**{name: random.uniform(*ends) for name, ends in RING_RANGES.items()})
        radial, around, loss = (random.uniform(*ends) for ends in DAMPING_RANGES.values())
        damping = RingDamping(radial, around, loss)
        poles = LaboratoryTyre(ring, damping, Effects()).solve().poles
        if np.sort(np.abs(poles))[2 * 7] < 2 * np.pi * HIGHEST_ORDER_7_HZ:
            return ring, damping


@dataclass(frozen=True, eq=False)
class LaboratoryTyre:
    """A ring with rim, lateral modes and air; uneven around the circumference where asked for."""

    ring: RingParameters  # means around the circumference
    damping: RingDamping  # its loss factor acts as the viscous damping of equal loss, per order
    effects: Effects

    @cached_property
    def labels(self) -> list[tuple[str, int]]:
        """Kind and order of every coordinate; sine and cosine share theirs."""
        ring = [(kind, n) for n in ORDERS.tolist() for kind in ("radial", "tangential")]
        rim = [("rim", 1)] * 2 if self.effects.rim_hz else []
        turning = [("turning", 0)] if self.effects.rim_turning_hz else []
        lateral = [("lateral", k) for k in range(len(self.effects.lateral_hz))]
        cavity = [("cavity", 1)] * 2 if self.effects.cavity_coupling else []
        return ring + rim + turning + lateral + cavity

    def columns(self, kind: str) -> NDArray[np.int_]:
        """Coordinates of a kind."""
        return np.array([k for k, label in enumerate(self.labels) if label[0] == kind], dtype=int)

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.labels)

    def _fields(self, angles_deg: Floats, derivative: int = 0) -> tuple[Floats, Floats]:
        """Radial and tangential motion of the belt by coordinate, or a derivative by the angle."""
        theta = np.deg2rad(np.asarray(angles_deg, dtype=float))[:, None]
        radial, around = (np.zeros((theta.size, self.size)) for _ in range(2))
        turn = (derivative - SINE) * np.pi / 2
        waves = np.cos(ORDERS * theta + turn) * ORDERS.astype(float) ** derivative
        radial[:, self.columns("radial")] = around[:, self.columns("tangential")] = waves
        return radial, around

    @cached_property
    def _grid(self) -> list[tuple[Floats, Floats]]:
        """Motion of the belt at the points of the integration, and two derivatives."""
        return [self._fields(np.arange(GRID) * 360.0 / GRID, k) for k in range(3)]

    def surface(self, angles_deg: Floats, tilt_deg: Floats | float = 0.0) -> Floats:
        """Motion seen by sensors, shape (n_angles, n_coordinates); tilted ones see tangential."""
        radial, around = self._fields(angles_deg)
        lateral = zip(self.columns("lateral"), self._draws["lateral"], strict=True)
        for column, (order, phase) in lateral:
            radial[:, column] = LATERAL_SEEN * np.cos(order * np.deg2rad(angles_deg) - phase)
        tilt = np.deg2rad(np.broadcast_to(tilt_deg, len(radial)))[:, None]
        return np.asarray(np.cos(tilt) * radial + np.sin(tilt) * around)

    @cached_property
    def _draws(self) -> dict[str, Floats]:
        """What is random around the tyre, drawn always so that one effect leaves others alone."""
        random = np.random.default_rng([self.effects.seed, 1])
        angles = np.arange(GRID) * 2 * np.pi / GRID
        waves = np.vstack(
            [f(n * angles) for n in range(1, _VARIED_ORDERS + 1) for f in (np.cos, np.sin)]
        )
        drawn = {}
        for name in ("radial", "tangential", "mass", "damping"):
            profile = random.standard_normal(len(waves)) @ waves
            drawn[name] = profile / np.sqrt(np.mean(profile**2))
        off = (angles - random.uniform(0, 2 * np.pi) + np.pi) % (2 * np.pi) - np.pi
        half = np.deg2rad(SPLICE_DEG)
        bump = np.where(np.abs(off) < half, np.cos(np.pi / 2 * off / half) ** 2, 0.0)
        drawn["splice"] = bump / bump.mean()
        count = len(self.effects.lateral_hz)
        orders, phases = np.arange(count) % 3, random.uniform(0, 2 * np.pi, count)
        drawn["lateral"] = np.column_stack([orders, phases])
        drawn["cavity"] = random.uniform(0, np.pi, 1)
        return drawn

    @cached_property
    def _arc(self) -> float:
        """Area of belt at each point of the grid."""
        ring = self.ring
        assert ring.belt_width_m is not None
        return 2 * np.pi * ring.mean_radius_m * ring.belt_width_m / GRID

    def _integral(self, fields: Floats, density: Floats | float) -> Floats:
        """∫ density · fieldsᵀ fields over the belt."""
        weights = self._arc * np.broadcast_to(density, GRID)
        return np.asarray(fields.T @ (weights[:, None] * fields))

    @cached_property
    def _splice(self) -> Floats:
        """Factor of the splice on mass and belt stiffness."""
        return np.asarray(1 + self.effects.splice * self._draws["splice"])

    @cached_property
    def mass(self) -> Floats:
        """Mass matrix of the bare tyre."""
        density = self._splice * (1 + self.effects.mass_variation * self._draws["mass"])
        own_kg, _, _ = self._oscillators
        return self._inertia(self.ring.mass_per_area_kg_m2 * density) + np.diag(own_kg)

    def _inertia(self, density: Floats | float) -> Floats:
        radial, around = self._grid[0]
        return self._integral(radial, density) + self._integral(around, density)

    @cached_property
    def _oscillators(self) -> Floats:
        """Mass, frequency in rad/s and damping ratio of what is not the ring; zeros elsewhere."""
        effects = self.effects
        alone_hz = CAVITY_SPEED_M_S / (2 * np.pi * CAVITY_RADIUS * self.ring.mean_radius_m)
        inertia = effects.rim_mass_kg * RIM_GYRATION_M**2
        parts = {
            "rim": (effects.rim_mass_kg, effects.rim_hz, RIM_DAMPING),
            "turning": (inertia, effects.rim_turning_hz, RIM_DAMPING),
            "lateral": (LATERAL_MASS_KG, effects.lateral_hz, LATERAL_DAMPING),
            "cavity": (CAVITY_MASS_KG, alone_hz * CAVITY_PAIR, CAVITY_DAMPING),
        }
        found = np.zeros((3, self.size))
        for kind, (mass, hz, ratio) in parts.items():
            columns = self.columns(kind)
            if columns.size:
                found[0, columns], found[2, columns] = mass, ratio
                found[1, columns] = 2 * np.pi * np.asarray(hz)
        return found

    def growth_strain(self, pressure: float) -> float:
        """Radial growth over the radius under a pressure factor."""
        ring, a = self.ring, self.ring.mean_radius_m

        def excess(e: float) -> float:
            membrane = ring.axial_stiffness_n_m / a * (1 + e) * (e + e**2 / 2)
            return membrane + ring.radial_stiffness_n_m3 * a * e - load

        load = pressure * ring.inflation_pressure_pa
        return float(scipy.optimize.brentq(excess, 0.0, 0.2, xtol=1e-15))

    def _belt(self, pressure: float, around: Floats | float) -> tuple[Floats, Floats]:
        """Stiffness of the strained belt, and the part of its extension."""
        ring, a = self.ring, self.ring.mean_radius_m
        e = self.growth_strain(pressure)
        tension = ring.axial_stiffness_n_m * (e + e**2 / 2)
        (w, v), (w1, v1), (w2, _) = self._grid
        membrane = ring.axial_stiffness_n_m * (1 + e) ** 2 * around
        extension = self._integral((w + v1) / a, membrane)
        pulled = self._integral((w + v1) / a, tension) + self._integral((v - w1) / a, tension)
        bent = self._integral((v1 - w2) / a**2, ring.bending_stiffness_n_m * around)
        return extension + pulled + bent, extension

    def _sidewall(self, radial: Floats | float, around: Floats | float) -> Floats:
        """∫ over the motion of the belt against the rim of radial and tangential densities."""
        w, v = (field.copy() for field in self._grid[0])
        theta = np.arange(GRID) * 2 * np.pi / GRID
        rim = self.columns("rim")
        if rim.size:
            w[:, rim] -= np.column_stack([np.cos(theta), np.sin(theta)])
            v[:, rim] += np.column_stack([np.sin(theta), -np.cos(theta)])
        v[:, self.columns("turning")] -= self.ring.mean_radius_m
        return self._integral(w, radial) + self._integral(v, around)

    def stiffness(self, state: State = NOMINAL) -> Floats:
        """Stiffness matrix."""
        ring, effects, drawn = self.ring, self.effects, self._draws
        varied = [1 + effects.stiffness_variation * drawn[k] for k in ("radial", "tangential")]
        stiff = self._belt(state.pressure, self._splice)[0] + self._sidewall(
            ring.radial_stiffness_n_m3 * varied[0], ring.circumferential_stiffness_n_m3 * varied[1]
        )
        mass, omega, _ = self._oscillators
        stiff += np.diag(mass * omega**2)
        cavity = self.columns("cavity")
        if cavity.size:
            angle = self._draws["cavity"][0]
            turned = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
            belt = [k for k in self.columns("radial") if self.labels[k][1] == 1]
            size = np.sqrt(stiff[cavity[0], cavity[0]] * self.ring.radial_stiffness_n_m3)
            size *= np.sqrt(self._arc * GRID / 2)
            stiff[np.ix_(cavity, belt)] = -effects.cavity_coupling * size * turned
            stiff[np.ix_(belt, cavity)] = stiff[np.ix_(cavity, belt)].T
        return stiff * state.frequency**2

    def damping_matrix(self, state: State = NOMINAL) -> Floats:
        """Viscous damping matrix."""
        varied = 1 + self.effects.damping_variation * self._draws["damping"]
        damping = self._sidewall(
            self.damping.radial_n_s_m3 * varied, self.damping.circumferential_n_s_m3 * varied
        )
        mass, omega, ratio = self._oscillators
        damping += self._belt_damping + np.diag(2 * ratio * mass * omega)
        return damping * state.frequency * state.damping

    @cached_property
    def _belt_damping(self) -> Floats:
        """η K/ω with ω of each order, that of the uniform tyre's lowest mode."""
        ring, belt = self.ring, self._belt(1.0, 1.0)[0]
        bed = self._sidewall(ring.radial_stiffness_n_m3, ring.circumferential_stiffness_n_m3)
        mass = self._inertia(ring.mass_per_area_kg_m2)
        damping = np.zeros_like(belt)
        for order in range(HIGHEST_ORDER + 1):
            kinds = ("radial", order), ("tangential", order)
            own = [k for k, label in enumerate(self.labels) if label in kinds]
            block = np.ix_(own, own)
            squares = np.linalg.eigvals(np.linalg.solve(mass[block], (belt + bed)[block])).real
            # Of order 0 the torsion does not strain the belt: the breathing counts.
            square = squares.max() if order == 0 else squares.min()
            damping[block] = self.damping.loss_factor * belt[block] / np.sqrt(square)
        return damping

    def extension_share(self, vector: Complexes) -> float:
        """Share of the belt's extension in the elastic energy of a shape."""
        extension, total = (np.real(vector.conj() @ part @ vector) for part in self._energies)
        return float(extension / total)

    @cached_property
    def _energies(self) -> tuple[Floats, Floats]:
        return self._belt(1.0, self._splice)[1], self.stiffness()

    def hung(self, rows: Floats, mass_kg: float) -> Floats:
        """Mass matrix of point masses that move with ``rows @ coordinates``."""
        return np.asarray(mass_kg * rows.T @ rows)

    def solve(
        self, state: State = NOMINAL, drive: Floats | None = None, extra_mass: Floats | None = None
    ) -> System:
        """Exact poles and residue vectors for a force on ``drive @ coordinates``; default: at 0°.

        `extra_mass` is the mass matrix of what hangs on the tyre.
        """
        drive = self.surface(np.zeros(1))[0] if drive is None else drive
        mass = self.mass if extra_mass is None else self.mass + extra_mass
        return solve(mass, self.damping_matrix(state), self.stiffness(state), drive)
