"""Parameters of the ring, and what is known of them before they are tuned."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arguments import Array, ReadonlyArrays, measured_orders, readonly, require_number
from model.display import number, table
from model.errors import ParameterError

#: Thickness over radius up to which a ring is thin.
LARGEST_THICKNESS_RATIO = 0.2
#: Hoop strain beyond which the quadratic strain of eq 3 is not valid.
LARGEST_HOOP_STRAIN = 0.2
RING_NAMES = {
    "mean_radius_m": ("mean radius", "a", "m"),
    "belt_width_m": ("belt width", "b", "m"),
    "inflation_pressure_pa": ("inflation pressure", "p₀", "Pa"),
    "mass_per_area_kg_m2": ("mass per area", "ρh", "kg/m²"),
    "radial_stiffness_n_m3": ("radial stiffness", "k_r", "N/m³"),
    "circumferential_stiffness_n_m3": ("circumferential stiffness", "k_θ", "N/m³"),
    "axial_stiffness_n_m": ("axial stiffness", "K", "N/m"),
    "bending_stiffness_n_m": ("bending stiffness", "D", "N m"),
}
DAMPING_NAMES = {
    "radial_n_s_m3": ("radial damping", "c_r", "N s/m³"),
    "circumferential_n_s_m3": ("circumferential damping", "c_θ", "N s/m³"),
    "loss_factor": ("loss factor", "η", "1"),
}
DESIGNATION = "225/55R17"

#: Table 3: circumferential orders, natural frequencies in Hz and damping ratios, unloaded tyre.
TABLE_3_ORDERS = readonly([1, 2, 3, 4, 5, 6, 7], int)
TABLE_3_FREQUENCIES_HZ = readonly([78.73, 100.31, 121.40, 145.45, 170.78, 196.52, 224.40])
TABLE_3_DAMPING_RATIOS = readonly([0.039, 0.033, 0.024, 0.022, 0.021, 0.020, 0.018])

#: Deviation of a single modal mass from that of the ring, besides its own error.
_MASS_FORM_STD = 0.02


@dataclass(frozen=True)
class RingParameters:
    """A thin flexible ring on an elastic foundation under inflation pressure.

    All stiffnesses and the mass are per unit of belt width, as in the paper; `belt_width_m` turns
    them into those of a tyre.

    Parameters
    ----------
    mean_radius_m : float
        Mean radius a before inflation, m.
    mass_per_area_kg_m2 : float
        ρh, kg/m² (the paper's "density per unit width").
    radial_stiffness_n_m3 : float
        Radial stiffness k_r of the foundation, N/m³.
    circumferential_stiffness_n_m3 : float
        Circumferential stiffness k_θ of the foundation, N/m³.
    axial_stiffness_n_m : float
        Membrane stiffness K = Eh of the belt, N/m.
    bending_stiffness_n_m : float
        Bending stiffness D = Eh³/12 of the belt, N·m.
    inflation_pressure_pa : float
        Inflation pressure p_o, Pa.
    belt_width_m : float or None
        Belt width b, m; absolute amplitudes need it, frequencies do not.

    Raises
    ------
    ParameterError
        For a negative or non-finite value, a ring that is not thin (h/a above 0.2), or a pressure
        that no hoop strain up to 0.2 can carry.

    Examples
    --------
    >>> import ringmodal as rm
    >>> ring = rm.RingParameters(
    ...     mean_radius_m=0.33, mass_per_area_kg_m2=19.69, radial_stiffness_n_m3=8.27e6,
    ...     circumferential_stiffness_n_m3=6.56e5, axial_stiffness_n_m=2.52e7,
    ...     bending_stiffness_n_m=7.45, inflation_pressure_pa=2.2e5, belt_width_m=0.19,
    ... )
    >>> f"{1e3 * ring.thickness_m:.2f} mm"
    '1.88 mm'
    """

    mean_radius_m: float
    mass_per_area_kg_m2: float
    radial_stiffness_n_m3: float
    circumferential_stiffness_n_m3: float
    axial_stiffness_n_m: float
    bending_stiffness_n_m: float
    inflation_pressure_pa: float
    belt_width_m: float | None = None

    def __post_init__(self) -> None:
        positive = {"mean_radius_m", "mass_per_area_kg_m2", "axial_stiffness_n_m", "belt_width_m"}
        for entry in fields(self):
            allowed = entry.name not in positive
            require_number(entry.name, getattr(self, entry.name), zero_allowed=allowed)
        ratio = self.thickness_m / self.mean_radius_m
        if ratio > LARGEST_THICKNESS_RATIO:
            raise ParameterError(
                "bending_stiffness_n_m and axial_stiffness_n_m",
                f"D = {self.bending_stiffness_n_m:g}, K = {self.axial_stiffness_n_m:g}: thickness "
                f"√(12D/K) = {self.thickness_m:.3g} m, {ratio:.2g} of the radius",
                f"must be ≤ {LARGEST_THICKNESS_RATIO:g} of the radius for a thin ring",
                "Lower D or raise K",
            )
        bearable = self.radial_resistance_pa(LARGEST_HOOP_STRAIN)
        if self.inflation_pressure_pa > bearable:
            found, limit = f"{self.inflation_pressure_pa:g}", f"{LARGEST_HOOP_STRAIN:g}"
            rule = f"must be ≤ {bearable:g} Pa, where the hoop strain reaches {limit}"
            raise ParameterError("inflation_pressure_pa", found, rule, "Lower it or raise K or k_r")

    @property
    def thickness_m(self) -> float:
        """Thickness h = √(12D/K) that the two belt stiffnesses imply, m."""
        return math.sqrt(12.0 * self.bending_stiffness_n_m / self.axial_stiffness_n_m)

    def radial_resistance_pa(self, hoop_strain: float) -> float:
        """Pressure that holds the ring at rest at `hoop_strain` (eq 5 with Ω = 0, u_θ° = 0), Pa."""
        membrane = self.axial_stiffness_n_m / self.mean_radius_m
        bed = self.radial_stiffness_n_m3 * self.mean_radius_m
        e = hoop_strain
        return membrane * (e + 1.5 * e**2 + 0.5 * e**3) + bed * e

    def _repr_html_(self) -> str:
        """Every parameter with its symbol and unit."""
        rows = [
            (name, symbol, as_typed(value), unit)
            for _, name, symbol, value, unit in listed_parameters(self)
        ]
        return table("Ring", ("parameter", "symbol", "value", "unit"), rows, words=(0, 1, 3))


@dataclass(frozen=True, eq=False)
class ManyRings(RingParameters):
    """Rings of columns (n_rings, 1), for slopes around a ring that was checked."""

    def __post_init__(self) -> None:
        known = {name: value for name, value in vars(self).items() if value is not None}
        for name, column in zip(known, np.broadcast_arrays(*known.values()), strict=True):
            object.__setattr__(self, name, column)

    __hash__ = object.__hash__
    __eq__ = object.__eq__


@dataclass(frozen=True)
class RingDamping:
    """Damping of the foundation (viscous) and of the belt (loss factor), section 5.3.

    Parameters
    ----------
    radial_n_s_m3 : float
        Radial damping c_r of the foundation, N·s/m³.
    circumferential_n_s_m3 : float
        Circumferential damping c_θ of the foundation, N·s/m³.
    loss_factor : float
        η in E' = E(1 + iη); acts on K and D.
    on_pretension : bool
        Whether η also acts on the stiffness that the static hoop tension brings, as in the paper.

    Raises
    ------
    ParameterError
        For a negative or non-finite value.

    Examples
    --------
    >>> import ringmodal as rm
    >>> rm.RingDamping(radial_n_s_m3=1900.0, circumferential_n_s_m3=1500.0, loss_factor=0.025)
    RingDamping(radial_n_s_m3=1900.0, circumferential_n_s_m3=1500.0, loss_factor=0.025, ...)
    """

    radial_n_s_m3: float
    circumferential_n_s_m3: float
    loss_factor: float
    on_pretension: bool = True

    def __post_init__(self) -> None:
        for name in ("radial_n_s_m3", "circumferential_n_s_m3", "loss_factor"):
            require_number(name, getattr(self, name), zero_allowed=True)


@dataclass(frozen=True)
class Wheel:
    """The rigid wheel, which moves in its plane and turns about its axis.

    Parameters
    ----------
    mass_kg : float
        Mass of the wheel, kg (the paper's m times the belt width).
    inertia_kg_m2 : float
        Moment of inertia about the axis, kg·m² (the paper's I_r times the belt width).

    Raises
    ------
    ParameterError
        For a value that is not finite and greater than zero.
    """

    mass_kg: float
    inertia_kg_m2: float

    def __post_init__(self) -> None:
        for entry in fields(self):
            require_number(entry.name, getattr(self, entry.name))


def listed_parameters(ring: RingParameters) -> list[tuple[str, str, str, float, str]]:
    """Field, name, symbol, value and unit of every parameter that is given."""
    return [
        (key, name, symbol, getattr(ring, key), unit)
        for key, (name, symbol, unit) in RING_NAMES.items()
        if getattr(ring, key) is not None
    ]


def as_typed(value: float) -> str:
    """A short value as given, a long one with four significant digits."""
    text = f"{value:.10g}"
    return text if len(text) <= len("220000") else number(value)


#: Table 4 with the measured mean radius, and the pressure and width that are not in the paper.
TABLE_4_RING = RingParameters(
    mean_radius_m=0.33,
    mass_per_area_kg_m2=19.69,
    radial_stiffness_n_m3=8.27e6,
    circumferential_stiffness_n_m3=6.56e5,
    axial_stiffness_n_m=2.52e7,
    bending_stiffness_n_m=7.45,
    inflation_pressure_pa=2.2e5,
    belt_width_m=0.19,
)

#: Table 5. It gives damping ratios 2.3 to 2.7 times those of Table 3.
TABLE_5_DAMPING = RingDamping(radial_n_s_m3=1.9e3, circumferential_n_s_m3=1.5e3, loss_factor=2.5e-2)

#: Damping that fits the ratios of Table 3, rounded from `identify_damping`.
REFITTED_DAMPING = RingDamping(
    radial_n_s_m3=686.0, circumferential_n_s_m3=800.0, loss_factor=0.0140
)


#: Radial growth of a belt on inflation over its radius where it was not measured: mean and standard
#: deviation where any within 0.05 and 1 % is as likely as another in its logarithm.
GROWTH, GROWTH_STD = 0.0032, 0.0026


@dataclass(frozen=True)
class TuningPriors:
    """Standard deviations of what a tuning takes as known.

    All but `parameters` are shares of the value.

    Parameters
    ----------
    pressure_std : float
        Of the inflation pressure: gauge and temperature.
    radius_std : float
        Of the mean radius of the belt.
    width_std : float
        Of the mean belt width, where one is given.
    calibration_std : float
        Of force and acceleration together, the same for all modal masses.
    model_form_std : float
        Deviation of a tyre's frequencies from those of a ring; the paper's are within 0.5 %.
    order_1_std : float or None
        Of order 1 besides its own and that of the model form: this order alone moves the rim.
        None: where nothing tests order 1, the ± of k_θ alone holds 2.5 % of it, 1 σ.
    parameters : mapping of str to (float, float)
        Value and standard deviation in SI of parameters of `RingParameters` or of
        ``radial_growth_m``.

    Raises
    ------
    ParameterError
        For a negative or infinite standard deviation.
    """

    pressure_std: float = 0.01
    radius_std: float = 0.005
    width_std: float = 0.03
    calibration_std: float = 0.01
    model_form_std: float = 0.005
    order_1_std: float | None = None
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for entry in fields(self):
            if entry.name != "parameters":
                require_number(entry.name, getattr(self, entry.name), zero_allowed=True)
        for name, (value, std) in self.parameters.items():
            require_number(f"prior of {name}", value, zero_allowed=True)
            require_number(f"standard deviation of {name}", std)


@dataclass(frozen=True, eq=False)
class ModalMasses(ReadonlyArrays):
    """Measured modal masses, a share of the tuning's orders.

    Parameters
    ----------
    orders : ndarray of int, shape (n_masses,)
        Orders n ≥ 1.
    mass_kg : ndarray, shape (n_masses,)
        Modal masses of radial shapes cos nθ of unit amplitude, kg.
    relative_std : ndarray, shape (n_masses,)
        Relative standard deviations of each alone.
    """

    orders: NDArray[np.int_]
    mass_kg: Array
    relative_std: Array

    def without(self, order: int) -> ModalMasses:
        """Those of the other orders."""
        kept = self.orders != order
        return ModalMasses(self.orders[kept], self.mass_kg[kept], self.relative_std[kept])

    def errors(self, priors: TuningPriors, *, width_given: bool) -> Array:
        """Independent errors of the logarithms, one per column: single ones, common ones.

        The last column is that of the belt width.
        """
        single = np.hypot(self.relative_std, _MASS_FORM_STD)
        common = np.ones((self.orders.size, 1))
        width = priors.width_std if width_given else 0.0
        return np.hstack([np.diag(single), common * priors.calibration_std, common * width])


def modal_masses(
    orders: ArrayLike, mass_kg: ArrayLike | None, std_kg: ArrayLike | None
) -> ModalMasses | None:
    """Modal masses of these orders; the breathing mode is left out."""
    if mass_kg is None:
        return None
    numbers, masses, std = measured_orders(
        "modal_mass_kg", orders, mass_kg, "modal_mass_std_kg", std_kg
    )
    used = numbers > 0
    relative = np.zeros(numbers.size) if std is None else std
    return ModalMasses(numbers[used], masses[used], relative[used])
