"""What a ring says of a rigid belt: mass, inertia, and the two in-plane modes it moves in whole."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from ema.core.errors import InputError
from model.damping import damping_ratios, torsion_damping_ratio
from model.errors import InstabilityError
from model.parameters import DAMPING_NAMES, RING_NAMES, RingDamping, RingParameters
from model.ring import belt_width_m, natural_frequencies_hz, torsion_frequency_hz
from pipelines.results.parameter_set import Parameter, ParameterSet

_STEP = 1e-4  # relative change of a parameter that shows how much a value depends on it
_MATTERS = 0.1  # percent of a value per percent of a parameter
WIDEST_M = 2.0  # tyres of the largest dump trucks are 1.5 m wide
_ALONE = 0.05  # share of what one parameter does to a value that all others may have


@dataclass(frozen=True)
class BeltValue:
    """A value of the rigid belt.

    Parameters
    ----------
    value : float
        SI.
    std : float or None
        Standard deviation; None where unknown. A parameter set holds no correlations, so it is
        known where one parameter decides.
    basis : str
        Where it comes from, in few words.
    doubts : tuple of str
        Parameters that matter for it and were not identified.
    """

    value: float
    std: float | None
    basis: str
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True)
class Belt:
    """A ring with the damping that it has, if any."""

    ring: RingParameters
    damping: RingDamping | None

    @property
    def known_damping(self) -> RingDamping:
        """The damping of a ring that has one; asking another one is an internal error."""
        if self.damping is None:
            raise ValueError("this ring has no damping")
        return self.damping


def mass_kg(belt: Belt) -> float:
    """Mass of the belt, 2πaρh·b, kg."""
    ring = belt.ring
    return 2 * math.pi * ring.mean_radius_m * ring.mass_per_area_kg_m2 * belt_width_m(ring)


def inertia_kg_m2(belt: Belt) -> float:
    """Moment of inertia of the belt about the wheel's axis, 2πa³ρh·b, kg m²."""
    return mass_kg(belt) * belt.ring.mean_radius_m**2


def translation_hz(belt: Belt) -> float:
    """Undamped frequency of order 1 on a fixed rim, Hz.

    In a translation the belt does not bend: D, which would move the eighth digit, is left out, so
    that the frequency can be turned back without knowing it.
    """
    return float(natural_frequencies_hz(replace(belt.ring, bending_stiffness_n_m=0.0), 1))


def translation_damping_ratio(belt: Belt) -> float:
    """Damping ratio of order 1."""
    return float(damping_ratios(belt.ring, belt.known_damping, 1))


def rotation_hz(belt: Belt) -> float:
    """Undamped frequency of the torsion on a fixed rim, under a pressure normal to the belt, Hz.

    A turning belt turns the pressure with it: a pressure of fixed direction would hold it back.
    """
    return torsion_frequency_hz(belt.ring, pressure_load="follower")


def rotation_damping_ratio(belt: Belt) -> float:
    """Damping ratio of the torsion: of the foundation alone, as nothing strains the belt."""
    viscous = replace(belt.known_damping, on_pretension=False)
    return torsion_damping_ratio(belt.ring, viscous, pressure_load="follower")


#: Keys of a tyre property file: their value, and where it comes from.
VALUES: dict[str, tuple[Callable[[Belt], float], str]] = {
    "INFLPRES": (lambda belt: belt.ring.inflation_pressure_pa, "pressure of the set"),
    "BELT_MASS": (mass_kg, "2πaρh·b"),
    "BELT_IYY": (inertia_kg_m2, "2πa³ρh·b"),
    "FREQ_LONG": (translation_hz, "order 1, rim fixed"),
    "FREQ_WINDUP": (rotation_hz, "torsion, rim fixed"),
    "DAMP_LONG": (translation_damping_ratio, "order 1: c_r, c_θ, η"),
    "DAMP_WINDUP": (rotation_damping_ratio, "torsion: c_θ"),
}
_NEEDS_WIDTH = ("BELT_MASS", "BELT_IYY")
_NEEDS_DAMPING = ("DAMP_LONG", "DAMP_WINDUP")


def belt_values(
    parameters: ParameterSet, width_m: float | None = None
) -> tuple[dict[str, BeltValue], dict[str, str]]:
    """Values of the rigid belt, by the keys of `VALUES`.

    Parameters
    ----------
    parameters : ParameterSet
    width_m : float, optional
        Belt width b. Default: that of the set.

    Returns
    -------
    values : dict of str to BeltValue
    open_ones : dict of str to str
        Keys that this set does not determine, and why.

    Raises
    ------
    InputError
        If `width_m` is no belt's.
    ParameterError
        If the values of the set make no ring.
    """
    ring = parameters.ring_parameters
    if width_m is not None:
        require_belt_width(width_m)
        ring = replace(ring, belt_width_m=width_m)
        parameters = replace(
            parameters, ring={**parameters.ring, "belt_width_m": Parameter(width_m)}
        )
    belt = Belt(ring, parameters.ring_damping)
    values, open_ones = {}, _not_determined(belt)
    for key, (value_of, basis) in VALUES.items():
        if key not in open_ones:
            values[key] = _judged(value_of, basis, belt, {**parameters.ring, **parameters.damping})
    return values, open_ones


def require_belt_width(width_m: float) -> None:
    """Refuse a width that no belt has; one in millimetres would end in tonnes.

    Raises
    ------
    InputError
        If it is not above zero, or above `WIDEST_M`.
    """
    if not 0 < width_m <= WIDEST_M:
        rule = f"a belt is wider than nothing and up to {WIDEST_M:g} m"
        raise InputError("--belt-width-m", f"{width_m:g} m", rule, "Give it in m, e.g. 0.19")


def _not_determined(belt: Belt) -> dict[str, str]:
    open_ones = {}
    if belt.ring.belt_width_m is None:
        reason = "it needs the belt width, which the set does not hold; give --belt-width-m"
        open_ones.update(dict.fromkeys(_NEEDS_WIDTH, reason))
    if belt.damping is None:
        open_ones.update(dict.fromkeys(_NEEDS_DAMPING, "the set holds no damping"))
    try:
        rotation_hz(belt)
    except InstabilityError:
        reason = "k_θ of the set is too small: its belt would turn by itself"
        open_ones.update(dict.fromkeys(("FREQ_WINDUP", "DAMP_WINDUP"), reason))
    return open_ones


def _judged(
    value_of: Callable[[Belt], float], basis: str, belt: Belt, known: Mapping[str, Parameter]
) -> BeltValue:
    value = value_of(belt)
    slopes = {name: _slope(value_of, belt, name) for name in known}
    doubts = tuple(
        _symbol(name)
        for name, slope in slopes.items()
        if abs(slope) >= _MATTERS and known[name].how in ("not identified", "at bound")
    )
    return BeltValue(value, _std(value, slopes, known), basis, doubts)


def _slope(value_of: Callable[[Belt], float], belt: Belt, name: str) -> float:
    """D ln value / d ln parameter."""
    part = "damping" if name in DAMPING_NAMES else "ring"
    held = getattr(belt, part)
    raised = replace(held, **{name: getattr(held, name) * (1.0 + _STEP)})
    value = value_of(belt)
    changed = value_of(replace(belt, **{part: raised}))
    return (changed / value - 1.0) / _STEP if value else 0.0


def _std(value: float, slopes: dict[str, float], known: Mapping[str, Parameter]) -> float | None:
    """Standard deviation where one parameter decides; what is not known may be anything."""
    shares = {}
    for name, slope in slopes.items():
        entry = known[name]
        is_vague = entry.std is None and entry.how != "given"
        relative = 1.0 if is_vague else (entry.std or 0.0) / (abs(entry.value) or 1.0)
        shares[name] = abs(slope) * relative
    *others, largest = sorted(shares, key=lambda name: shares[name])
    if not shares[largest] or known[largest].std is None:
        return None
    if sum(shares[name] for name in others) > _ALONE * shares[largest]:
        return None
    return abs(value) * math.hypot(*shares.values())


def _symbol(name: str) -> str:
    return {**RING_NAMES, **DAMPING_NAMES}[name][1]
