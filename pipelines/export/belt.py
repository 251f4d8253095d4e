"""The rigid belt of a ring: mass, inertia and in-plane modes; modal targets for tyre models."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from ema.core.errors import InputError, visible_line
from model.coefficients import PressureLoad
from model.damping import damping_ratios, torsion_damping_ratio
from model.errors import InstabilityError
from model.identifiability import AT_BOUND, GIVEN, NOT_IDENTIFIED
from model.parameters import DAMPING_NAMES, RING_NAMES, RingDamping, RingParameters
from model.ring import belt_width_m, natural_frequencies_hz, torsion_frequency_hz
from pipelines.results.parameter_set import Parameter, ParameterSet
from pipelines.results.provenance import software_version
from pipelines.results.verdict import Covariance, MeasuredOrder

WIDEST_M = 2.0  # tyres of the largest dump trucks are 1.5 m wide
_STEP = 1e-4  # relative change of a parameter for numerical derivatives
_MATTERS = 0.1  # sensitivity, % of a value per % of a parameter, from which a parameter is named
_ALONE = 0.05  # largest contribution of all other parameters, as share of the largest one
_NEEDS_WIDTH = ("BELT_MASS", "BELT_IYY")
_NEEDS_DAMPING = ("DAMP_LONG", "DAMP_WINDUP")
_ABOUT = """\
# Modal targets for an FTire-style parameter fit
# Free tyre on a fixed rim: no load, not rolling. Frequencies are undamped, damping ratios are of
# critical. frequency_hz and damping_ratio are measured where measured_hz is given, with their
# standard deviations; all others are those of a flexible ring with the parameters of this tyre.
# in_plane_rotation: the belt rotates against the rim; radial sensors do not detect it, so there is
#   no measured value.
# in_plane_translation: order 1; first_bending: order 2; second_bending: order 3.
"""


@dataclass(frozen=True)
class BeltValue:
    """A value of the rigid belt."""

    # SI. Without a covariance in the set, std is known only where one parameter dominates.
    value: float
    std: float | None
    basis: str  # formula or mode
    doubts: tuple[str, ...] = ()  # symbols of parameters that matter and were not identified


@dataclass(frozen=True)
class Belt:
    """A ring, its damping, if known, and the pressure model that both belong to."""

    ring: RingParameters
    damping: RingDamping | None
    pressure_load: PressureLoad | None = None

    @property
    def load(self) -> PressureLoad:
        """The pressure model of waves."""
        return self.pressure_load or "dead"

    @property
    def known_damping(self) -> RingDamping:
        """The damping; `ValueError` where it is unknown."""
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

    The belt does not bend in a translation: D affects only the eighth digit and is left out, so
    that k_r and k_θ can be found from the frequency without D.
    """
    ring = replace(belt.ring, bending_stiffness_n_m=0.0)
    return float(natural_frequencies_hz(ring, 1, pressure_load=belt.load))


def translation_damping_ratio(belt: Belt) -> float:
    """Damping ratio of order 1."""
    return _ratio(belt, 1)


def _ratio(belt: Belt, order: int) -> float:
    ratio = damping_ratios(belt.ring, belt.known_damping, order, pressure_load=belt.load)
    return float(ratio)


def rotation_hz(belt: Belt) -> float:
    """Undamped torsion frequency on a fixed rim, Hz.

    In the pressure model of the set: tuned on the same frequencies, k_θ of a dead load is smaller
    by p₀/a than that of a follower load, and the torsion is the same.
    """
    return torsion_frequency_hz(belt.ring, pressure_load=belt.pressure_load or "follower")


def rotation_damping_ratio(belt: Belt) -> float:
    """Damping ratio of the torsion, from the foundation only: the belt is not strained."""
    viscous = replace(belt.known_damping, on_pretension=False)
    load = belt.pressure_load or "follower"
    return torsion_damping_ratio(belt.ring, viscous, pressure_load=load)


#: Keys of a tyre property file: value and basis.
VALUES: dict[str, tuple[Callable[[Belt], float], str]] = {
    "INFLPRES": (lambda belt: belt.ring.inflation_pressure_pa, "pressure of the set"),
    "BELT_MASS": (mass_kg, "2πaρh·b"),
    "BELT_IYY": (inertia_kg_m2, "2πa³ρh·b"),
    "FREQ_LONG": (translation_hz, "order 1, rim fixed"),
    "FREQ_WINDUP": (rotation_hz, "torsion, rim fixed"),
    "DAMP_LONG": (translation_damping_ratio, "order 1: c_r, c_θ, η"),
    "DAMP_WINDUP": (rotation_damping_ratio, "torsion: c_θ"),
}


def belt_values(
    parameters: ParameterSet, width_m: float | None = None
) -> tuple[dict[str, BeltValue], dict[str, str]]:
    """Values of the rigid belt by the keys of `VALUES`; keys not determined, with the reason.

    The default belt width is that of the set.
    """
    ring = parameters.ring_parameters
    if width_m is not None:
        require_belt_width(width_m)
        ring = replace(ring, belt_width_m=width_m)
    known = parameters.ring_and_damping
    if width_m is not None:
        known["belt_width_m"] = Parameter(width_m)
    belt = Belt(ring, parameters.ring_damping, parameters.basis.pressure_load)
    values, open_ones = {}, _not_determined(belt)
    for key, (value_of, basis) in VALUES.items():
        if key in open_ones:
            continue
        value = value_of(belt)
        slopes = {name: _slope(value_of, belt, name) for name in known}
        doubts = tuple(
            {**RING_NAMES, **DAMPING_NAMES}[name][1]
            for name, slope in slopes.items()
            if abs(slope) >= _MATTERS and known[name].how in (NOT_IDENTIFIED, AT_BOUND)
        )
        own = parameters.basis.covariance
        if own is not None and width_m is not None:  # it replaces that of the set
            own = own.without("belt_width_m")
        std = _std(value, slopes, known) if own is None else _joint_std(value_of, belt, known, own)
        values[key] = BeltValue(value, std, basis, doubts)
    return values, open_ones


def require_belt_width(width_m: float) -> None:
    """Refuse an impossible width, such as one in millimetres."""
    if not 0 < width_m <= WIDEST_M:
        rule = f"belt width must be > 0 and at most {WIDEST_M:g} m"
        raise InputError("--belt-width-m", f"{width_m:g} m", rule, "Give it in m, e.g. 0.19")


def _not_determined(belt: Belt) -> dict[str, str]:
    open_ones = {}
    if belt.ring.belt_width_m is None:
        reason = "the set has no belt width; give --belt-width-m"
        open_ones.update(dict.fromkeys(_NEEDS_WIDTH, reason))
    if belt.damping is None:
        open_ones.update(dict.fromkeys(_NEEDS_DAMPING, "the set has no damping"))
    try:
        rotation_hz(belt)
    except InstabilityError:
        reason = "k_θ of the set is too small: torsion mode unstable"
        open_ones.update(dict.fromkeys(("FREQ_WINDUP", "DAMP_WINDUP"), reason))
    return open_ones


def _slope(value_of: Callable[[Belt], float], belt: Belt, name: str) -> float:
    """D ln value / d ln parameter."""
    part = "damping" if name in DAMPING_NAMES else "ring"
    held = getattr(belt, part)
    raised = replace(held, **{name: getattr(held, name) * (1.0 + _STEP)})
    value = value_of(belt)
    changed = value_of(replace(belt, **{part: raised}))
    return (changed / value - 1.0) / _STEP if value else 0.0


def _joint_std(
    value_of: Callable[[Belt], float],
    belt: Belt,
    known: Mapping[str, Parameter],
    covariance: Covariance,
) -> float | None:
    """Standard deviation from the covariance of the set; damping is independent of it."""
    root = np.sqrt(np.diag(covariance.values))
    names, value, variance = covariance.parameters, value_of(belt), 0.0
    rises = [
        (_moved(value_of, belt, name, std) - value) / _STEP
        for name, std in zip(names, root.tolist(), strict=True)
    ]
    correlation = np.array(covariance.values) / np.outer(root, root)
    variance = float(np.array(rises) @ correlation @ np.array(rises))
    for name, entry in known.items():
        if name not in names and entry.how != GIVEN:
            rise = (_moved(value_of, belt, name, entry.std or entry.value) - value) / _STEP
            if rise and entry.std is None:
                return None
            variance += rise**2
    return math.sqrt(max(variance, 0.0))


def _moved(value_of: Callable[[Belt], float], belt: Belt, name: str, size: float) -> float:
    """The value where one parameter is larger by a small share of `size`."""
    part = "damping" if name in DAMPING_NAMES else "ring"
    held = getattr(belt, part)
    if held is None or getattr(held, name) is None:
        return value_of(belt)
    return value_of(
        replace(belt, **{part: replace(held, **{name: getattr(held, name) + _STEP * size})})
    )


def _std(value: float, slopes: dict[str, float], known: Mapping[str, Parameter]) -> float | None:
    """Standard deviation where one parameter dominates; without std it is taken as 100 %."""
    shares = {}
    for name, slope in slopes.items():
        entry = known[name]
        is_vague = entry.std is None and entry.how != GIVEN
        relative = 1.0 if is_vague else (entry.std or 0.0) / (abs(entry.value) or 1.0)
        shares[name] = abs(slope) * relative
    *others, largest = sorted(shares, key=lambda name: shares[name])
    if not shares[largest] or known[largest].std is None:
        return None
    if sum(shares[name] for name in others) > _ALONE * shares[largest]:
        return None
    return abs(value) * math.hypot(*shares.values())


@dataclass(frozen=True)
class ModalTarget:
    """Target for a mode of a tyre model, a line of the file; NaN where unknown."""

    mode: str
    order: int
    frequency_hz: float
    damping_ratio: float
    measured_hz: float = math.nan
    measured_damping: float = math.nan
    frequency_std_hz: float = math.nan
    damping_std: float = math.nan
    ring_hz: float = math.nan
    ring_damping: float = math.nan


def _bending(order: int) -> tuple[Callable[[Belt], float], Callable[[Belt], float]]:
    return (
        lambda belt: float(natural_frequencies_hz(belt.ring, order, pressure_load=belt.load)),
        lambda belt: _ratio(belt, order),
    )


_MODES = {
    ("in_plane_rotation", 0): (rotation_hz, rotation_damping_ratio),
    ("in_plane_translation", 1): (translation_hz, translation_damping_ratio),
    ("first_bending", 2): _bending(2),
    ("second_bending", 3): _bending(3),
}


def write_modal_targets(
    parameters: ParameterSet, path: Path, measured: Mapping[int, MeasuredOrder] | None = None
) -> tuple[ModalTarget, ...]:
    """Write modal targets as text: comment lines with #, then columns separated by blanks.

    Targets are rotation, translation and the first two bending modes of the belt on a fixed rim.

    Parameters
    ----------
    parameters : ParameterSet
    path : Path
    measured : mapping of int to MeasuredOrder, optional
        By order. Order 0 is ignored: a radial sensor does not detect the rotation. Default: those
        that the set states; without any there are no such columns.
    """
    belt = Belt(parameters.ring_parameters, parameters.ring_damping, parameters.basis.pressure_load)
    measured = parameters.basis.on_fixed_rim or measured or {}
    targets = []
    for (mode, order), functions in _MODES.items():
        ring = _values(belt, *functions)
        targets.append(_target(mode, order, ring, measured.get(order) if order else None))
    names = [each.name for each in fields(ModalTarget)][: None if measured else 4]
    rows = [names, *([_cell(getattr(each, name)) for name in names] for each in targets)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    conditions = {"tyre": parameters.designation, **parameters.conditions}
    conditions["software"] = f"ringmodal {software_version()}"
    origin = parameters.provenance
    if isinstance(place := origin.get("library"), dict):
        conditions["set"] = f"{place['tyre']}@{place['version']}, {place['created']}"
    conditions |= {key: origin[key] for key in ("campaign", "created") if key in origin}
    if (verdict := parameters.basis.verdict) is not None:
        conditions["verdict"] = verdict.text()
    stated = [
        f"# {name}: {visible_line(f'{value:.10g}' if isinstance(value, float) else str(value))}"
        for name, value in conditions.items()
    ]
    text = _ABOUT + "\n".join([*stated, *lines]) + "\n"
    path.write_text(text, encoding="utf-8", newline="\n")
    return tuple(targets)


def _target(
    mode: str, order: int, ring: tuple[float, float], measured: MeasuredOrder | None
) -> ModalTarget:
    if measured is None:
        return ModalTarget(mode, order, *ring)
    pair = measured.frequency_hz, measured.damping_ratio
    stds = measured.frequency_std_hz or math.nan, measured.damping_ratio_std or math.nan
    return ModalTarget(mode, order, *pair, *pair, *stds, *ring)


def measured_modes(result: Path) -> dict[int, MeasuredOrder] | None:
    """Measured orders of a result whose set does not state them; None without validation.csv."""
    path = result / "validation.csv"
    if not path.is_file():
        return None
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = [
                (int(row["order"]), float(row["measured_hz"]), float(row["measured_damping"]))
                for row in csv.DictReader(file)
            ]
    except (KeyError, ValueError) as error:
        rule = "each line must have order, measured_hz and measured_damping"
        raise InputError(str(path), str(error), rule, "Process the campaign again") from error
    return {order: MeasuredOrder(order, *pair) for order, *pair in rows}


def _values(
    belt: Belt, frequency_of: Callable[[Belt], float], damping_of: Callable[[Belt], float]
) -> tuple[float, float]:
    try:
        frequency_hz = frequency_of(belt)
    except InstabilityError:  # torsion: k_θ too small
        return math.nan, math.nan
    return frequency_hz, math.nan if belt.damping is None else damping_of(belt)


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:.6g}"
    return str(value)
