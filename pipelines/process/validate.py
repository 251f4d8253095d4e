"""Measured modes against the ring model, and the ring against what tyres have.

The tuned mass per area ρh scales with the square of time and with pressure: a sampling rate too
high by a factor k divides ρh by k² and multiplies all frequencies by k; a pressure too high by q
multiplies ρh by q and leaves frequencies as they are. Modal masses depend on neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.circumference.orders import drive, family, further_resonances, order_content
from ema.core.errors import InputError
from ema.core.finding import Check, Finding, Verdict
from ema.core.mac import auto_mac, mac
from ema.core.modes import ModalModel, Mode
from model.damping import DampingResult, damping_ratios
from model.parameters import RingParameters
from model.ring import modal_mass_kg as ring_mass_kg
from model.tuning import TuningResult
from model.verdict import RingVerdict
from pipelines.results.result import Validation

_MOST_NAMED = 3  # warnings in the message of a strict run
# Values of tyres, wide enough for motorcycles and trucks: natural frequency of order 1 on a fixed
# rim (car tyres have 65 to 100 Hz: Gong 1993, Zegelaar 1998, Kindt 2009; truck tyres from 45 Hz),
# and mass of belt and tread per area (car tyres 12 to 25 kg/m², the same; truck tyres up to 50).
_ORDER_1_HZ = (40.0, 130.0)
_KG_M2 = (7.0, 60.0)
# A large tyre, of a truck or tractor by its belt radius, may be slower.
_LARGE_FROM_M, _LARGE_FROM_HZ = 0.42, 25.0
# Common errors of sampling rates, as factors: half or double (complex or real samples, Nyquist
# limit given as rate), decades, decimation, two common rates of acquisition hardware.
_RATE_FACTORS = (2.0, 0.5, 2.56, 1 / 2.56, 10.0, 0.1, 4.0, 0.25, 51.2 / 48, 1e3, 1e-3)
# Common errors of pressures: value used over the correct one.
_PRESSURES = (
    (1e-5, "bar taken for Pa"),
    (1e-3, "kPa taken for Pa"),
    (1e5 / 6894.757, "psi taken for bar"),
    (6894.757 / 1e5, "bar taken for psi"),
    (1e3 / 6894.757, "psi taken for kPa"),
)
# A cause has to bring the values within this factor of the usual ones.
_CAUSE_WITHIN = 1.8
# The ring's mass follows from a few frequencies: only a gross difference is a matter of units.
_AMPLITUDE_LIMIT = 3.0
_LEAST_MASS_STD = 1e-3  # of a modal mass, what virtual campaigns show
_FORCE_ANGLE_STD = np.deg2rad(0.5)  # of the angle of the force: 3 mm on the tread
# A mode of order 1 with a share of the ring's drive is that of a rim; the air's is driven far less.
_RIM_DRIVE = 0.1
# A wrong unit has to explain the modal masses within this factor.
_UNIT_WITHIN = 1.5
_UNITS = (
    (9.80665, "accelerations in g taken for m/s²"),
    (1 / 9.80665, "accelerations in m/s² taken for g, or a force in kgf for N"),
    (4.448, "a force in N taken for lbf"),
    (1 / 4.448, "a force in lbf taken for N"),
    (1e3, "a force in N taken for kN, or accelerations in mV for V"),
    (1e-3, "a force in kN taken for N"),
)


@dataclass(frozen=True, eq=False)
class RingOrder:
    """One circumferential order of the ring as measured: one mode, or both of a pair.

    The ring model has no split: a pair is compared by the mean of its two frequencies.
    """

    order: int
    modes: tuple[Mode, ...]  # the stronger one first
    frequency_hz: float
    damping_ratio: float
    frequency_std_hz: float
    damping_std: float


def ring_orders(model: ModalModel) -> tuple[RingOrder, ...]:
    """Ring modes by order."""
    found = []
    for order, members in sorted(family(model.modes).items()):
        modes = tuple(model.modes[k] for k in members)
        values = np.mean([(mode.frequency_hz, mode.damping_ratio) for mode in modes], axis=0)
        stds = np.array([(mode.frequency_std_hz, mode.damping_std) for mode in modes])
        std_of_mean = np.sqrt(np.sum(stds**2, axis=0)) / len(modes)
        found.append(RingOrder(order, modes, *values.tolist(), *std_of_mean.tolist()))
    return tuple(found)


def validate(
    model: ModalModel,
    orders: tuple[RingOrder, ...],
    tuning: TuningResult,
    damping: DampingResult | None,
) -> Validation:
    """Compare frequencies, damping and shapes of the measured modes with the tuned ring.

    Parameters
    ----------
    model : ModalModel
        All measured modes.
    orders : tuple of RingOrder
        From `ring_orders`.
    tuning : TuningResult
    damping : DampingResult or None
    """
    main, numbers = [order.modes[0] for order in orders], [order.order for order in orders]
    expected = [aligned_shape(mode, model.position_deg) for mode in main]
    damped = np.full(len(orders), np.nan)
    if damping:
        load = tuning.pressure_load
        damped = damping_ratios(tuning.ring, damping.damping, numbers, pressure_load=load)
    return Validation(
        order=np.array(numbers),
        measured_hz=np.array([order.frequency_hz for order in orders]),
        model_hz=tuning.model_hz,
        measured_damping=np.array([order.damping_ratio for order in orders]),
        model_damping=damped,
        mac=mac(np.array([mode.residues for mode in main]), np.array(expected)),
        auto_mac=auto_mac(np.array([mode.residues for mode in model.modes])),
    )


def aligned_shape(mode: Mode, position_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shape of the ring's mode of the same order, aligned with the measured one.

    The modes of an order span a (cos, sin) plane; the direction of a measured shape in it depends
    on the shaker, not on the ring.
    """
    content = order_content(mode.shape, position_deg)
    order = mode.order or 0
    cosine, sine = content.cosine[order].real, content.sine[order].real
    angle = np.deg2rad(position_deg) * order
    return np.asarray(cosine * np.cos(angle) + sine * np.sin(angle))


# Of a car tyre; a likely cause brings the values near these.
_USUAL_HZ, _USUAL_KG_M2 = 80.0, 18.0


def plausibility_finding(
    orders: Sequence[RingOrder], mass_per_area_kg_m2: float | None, mean_radius_m: float = 0.0
) -> Finding | None:
    """Compare the lowest ring mode and the tuned mass with those of tyres on a fixed rim.

    The mass per area is None if it was given or not determined; without both there is no finding.
    """
    first_hz = next((order.frequency_hz for order in orders if order.order == 1), None)
    seen = _Tyre(first_hz, mass_per_area_kg_m2, mean_radius_m)
    if first_hz is None and mass_per_area_kg_m2 is None:
        return None
    if seen.is_usual:
        detail = f"{seen.text()}, as tyres have"
        return Finding("", "", None, Check.PLAUSIBILITY, Verdict.OK, detail)
    usual = seen.text("{1:g} to {2:g} Hz", "{1:g} to {2:g} kg/m²")
    detail = f"{seen.text()}; tyres have {usual}. {_cause(seen)}"
    return Finding("", "", None, Check.PLAUSIBILITY, Verdict.WARNING, detail)


@dataclass(frozen=True)
class _Tyre:
    """Natural frequency of order 1 and mass per area of a tyre; None if unknown."""

    first_hz: float | None
    mass: float | None
    radius_m: float = 0.0

    def scaled(self, *, rate: float = 1.0, pressure: float = 1.0) -> _Tyre:
        """Values with a rate and a pressure divided by these factors."""
        first_hz = None if self.first_hz is None else self.first_hz / rate
        mass = None if self.mass is None else self.mass * rate**2 / pressure
        return replace(self, first_hz=first_hz, mass=mass)

    @property
    def is_usual(self) -> bool:
        known = ((self.first_hz, self.usual_hz), (self.mass, _KG_M2))
        return all(value is None or low <= value <= high for value, (low, high) in known)

    @property
    def usual_hz(self) -> tuple[float, float]:
        """Order 1 of tyres of this size."""
        low, high = _ORDER_1_HZ
        return (_LARGE_FROM_HZ if self.radius_m >= _LARGE_FROM_M else low), high

    @property
    def distance(self) -> float:
        """Largest |log| of a ratio to a usual tyre; the mass scales with the rate squared."""
        ratios = [self.first_hz / _USUAL_HZ] if self.first_hz else []
        ratios += [np.sqrt(self.mass / _USUAL_KG_M2)] if self.mass else []
        return float(max(np.abs(np.log(ratios)), default=0.0))

    def text(
        self, hz: str = "order 1 at {0:.4g} Hz", mass: str = "a mass per area of {0:.3g} kg/m²"
    ) -> str:
        """Known values, or their limits, in words."""
        known = ((hz, self.first_hz, self.usual_hz), (mass, self.mass, _KG_M2))
        return " and ".join(
            words.format(value, *limits) for words, value, limits in known if value is not None
        )


def _cause(seen: _Tyre) -> str:
    causes = {_rate_text(factor, seen): seen.scaled(rate=factor) for factor in _RATE_FACTORS}
    if seen.mass is not None:
        for factor, what in _PRESSURES:
            text = f"the inflation pressure is wrong ({what})"
            causes[text] = seen.scaled(pressure=factor)
    best = min(causes, key=lambda text: causes[text].distance)
    if causes[best].distance < np.log(_CAUSE_WITHIN):
        return f"Most likely {best}"
    return "Check the sampling rate, the inflation pressure and the mean radius"


def _rate_text(factor: float, seen: _Tyre) -> str:
    high, times = ("high", factor) if factor > 1 else ("low", 1 / factor)
    return (
        f"the sampling rate is too {high} by a factor of {times:.4g} (corrected: "
        f"{seen.scaled(rate=factor).text()}). Compare sampling_rate_hz and the files' headers with "
        "the acquisition"
    )


def amplitude_finding(
    modal_model: ModalModel,
    orders: Sequence[RingOrder],
    ring: RingParameters,
    *,
    ring_is_doubted: bool = False,
) -> list[Finding]:
    """Compare the modal masses from the residues with those of the tuned ring, if it has a width.

    At an antinode an order has the residue A = 1/(2jωm), m its modal mass, both members of a pair
    together. The ring's mass comes from frequencies and pressure alone, so a wrong unit or
    sensitivity of all sensors or of the force is a common factor. If the ring's mass is doubted
    itself, no unit is named as the cause.
    """
    if ring.belt_width_m is None:
        return []
    expected = ring_mass_kg(ring, [order.order for order in orders])
    ratio = np.array([modal_mass_kg(modal_model, order)[0] for order in orders]) / expected
    factor = float(np.exp(np.median(np.log(ratio))))
    detail = f"modal masses are {factor:.3g} times those of the ring"
    if 1 / _AMPLITUDE_LIMIT < factor < _AMPLITUDE_LIMIT:
        return [Finding("", "", None, Check.AMPLITUDE, Verdict.OK, detail)]
    if ring_is_doubted:
        detail += ": the mass of the ring is in doubt (see plausibility), not the amplitudes"
        return [Finding("", "", None, Check.AMPLITUDE, Verdict.OK, detail)]
    likely = [text for value, text in _UNITS if 1 / _UNIT_WITHIN < factor / value < _UNIT_WITHIN]
    why = f", as with {likely[0]}" if likely else ""
    detail += (
        f" (limit {_AMPLITUDE_LIMIT:g}){why}: check units and sensitivities of all sensors and of "
        "the force, and the belt width. Frequencies and damping do not depend on them"
    )
    return [Finding("", "", None, Check.AMPLITUDE, Verdict.WARNING, detail)]


def modal_mass_kg(modal_model: ModalModel, order: RingOrder) -> tuple[float, float]:
    """Modal mass of an order and its standard deviation, kg; both members of a pair together.

    For a unit crest of cos nθ the residue is φ(θ) φ(θ_F) / (2jωm), φ the shape. That of an uneven
    tyre holds other orders as well: 1 % of the tyre's mass in one spot changes its value at the
    force by up to a tenth. So φ(θ_F) takes all orders that rise from the noise, which is that of
    the orders too high for modes of the band. Where the angle of the force is unknown, φ(θ_F) is
    the crest, and its ± what the other orders may add.
    """
    n, position_deg = order.order, modal_model.position_deg
    contents = [order_content(mode.residues, position_deg) for mode in order.modes]
    waves = np.array([(each.cosine, each.sine) for each in contents]).sum(axis=0)
    power = np.sum(np.abs(waves) ** 2, axis=0)
    crest = float(np.sqrt(power[n]))
    squares = [np.nanmean(mode.residues_std**2) for mode in order.modes]
    std = np.sqrt(2 / position_deg.size * np.nansum(squares))
    high = np.arange(power.size) > max(power.size // 2, n)
    noise = max(float(np.mean(power[high])) if np.any(high) else 0.0, 2.0 * std**2)
    weight = np.where(high, 0.0, np.clip(1.0 - noise / np.maximum(power, noise), 0.0, 1.0))
    weight[n] = 1.0
    others = np.arange(power.size) != n
    error_of_others = noise / 2 * np.sum(weight[others] ** 2)
    if np.isfinite(modal_model.excitation_deg):
        angle = np.deg2rad(modal_model.excitation_deg)
        seen, moved = _at(waves * weight, angle), _at(waves * weight, angle + _FORCE_ANGLE_STD)
        error_of_others += abs(moved - seen) ** 2
        at_force = abs(seen)
    else:
        at_force = crest
        error_of_others += np.sum((weight * power)[others]) / 2
    mass_kg = at_force / (4 * np.pi * order.frequency_hz * crest**2)
    relative = np.hypot(std, np.sqrt(error_of_others)) / crest
    return mass_kg, mass_kg * max(float(relative), _LEAST_MASS_STD)


def _at(waves: NDArray[np.complex128], angle: float) -> complex:
    """Waves, cosines and sines by order, (2, n_orders), at an angle in radians."""
    phase = angle * np.arange(waves.shape[1])
    return complex(np.sum(waves[0] * np.cos(phase) + waves[1] * np.sin(phase)))


def rim_frequencies_hz(modal_model: ModalModel) -> tuple[float, ...]:
    """Further modes of order 1 that the force drives like those of the ring: the rim moves."""
    modes, members = modal_model.modes, family(modal_model.modes)
    if 1 not in members:
        return ()
    own = [k for chosen in members.values() for k in chosen]
    least = _RIM_DRIVE * drive(modes[members[1][0]])
    return tuple(
        modes[chosen[0]].frequency_hz
        for order, chosen in further_resonances(modes, own)
        if order == 1 and drive(modes[chosen[0]]) >= least
    )


def verdict_findings(verdict: RingVerdict) -> list[Finding]:
    """The verdict on the ring, one finding for each piece of evidence."""
    found = [
        (
            Verdict.WARNING if each in verdict.against else Verdict.OK,
            f"{each.reason}: {each.detail}",
        )
        for each in verdict.evidence
    ]
    if verdict.is_good:
        orders = ", ".join(map(str, verdict.orders_used))
        found.insert(0, (Verdict.OK, f"orders {orders} are those of a ring"))
    return [Finding("", "", None, Check.RING, *each) for each in found]


def refuse_warnings(findings: Sequence[Finding]) -> None:
    """Raise `InputError` if a finding is a warning or reports something left out."""
    doubtful = [finding for finding in findings if not finding.is_ok]
    if not doubtful:
        return
    texts = []
    for finding in doubtful[:_MOST_NAMED]:
        place = " ".join(part for part in (finding.run, finding.channel) if part)
        texts.append(f"{finding.check}, {place}: {finding.detail}" if place else finding.detail)
    if len(doubtful) > _MOST_NAMED:
        texts.append(f"and {len(doubtful) - _MOST_NAMED} more")
    remedy = "Fix the recordings or leave them out, or run without --strict: quality.csv lists all"
    raise InputError("--strict", "; ".join(texts), "a strict run accepts no warnings", remedy)
