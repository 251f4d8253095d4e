"""Whether frequencies and ring are those of a tyre, and what is most likely wrong if they are not.

The tuned ring scales with the square of time and with pressure: a sampling rate wrong by a factor k
divides ρh by k² and multiplies all frequencies by k; a pressure wrong by q multiplies ρh by q and
leaves frequencies as they are. Modal masses depend on neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ema.circumference.orders import order_content
from ema.core.finding import OK, WARNING, Finding
from ema.core.modes import ModalModel
from model.parameters import RingParameters
from model.ring import modal_mass_kg
from pipelines.process.validate import RingOrder

PLAUSIBILITY = "plausibility"


@dataclass(frozen=True)
class TyreLimits:
    """What is known of tyres, wide enough for motorcycles and trucks.

    Parameters
    ----------
    lowest_order_1_hz, highest_order_1_hz : float
        Natural frequency of order 1 on a fixed rim, Hz. Car tyres have 65 to 100 Hz (Gong 1993;
        Zegelaar 1998; Kindt 2009), truck tyres from 45 Hz.
    lightest_kg_m2, heaviest_kg_m2 : float
        Mass of belt and tread per area. Car tyres have 12 to 25 kg/m² (the same), truck tyres up to
        50.
    usual_hz, usual_kg_m2 : float
        Of a car tyre; a likely cause has to bring the values near these.
    """

    lowest_order_1_hz: float = 40.0
    highest_order_1_hz: float = 130.0
    lightest_kg_m2: float = 7.0
    heaviest_kg_m2: float = 60.0
    usual_hz: float = 80.0
    usual_kg_m2: float = 18.0


# Factors by which rates are mistaken: half or double (complex or real samples, Nyquist limit given
# as rate), decades, a decimation, two common rates of acquisition hardware.
_RATE_FACTORS = (2.0, 0.5, 2.56, 1 / 2.56, 10.0, 0.1, 4.0, 0.25, 51.2 / 48, 1e3, 1e-3)
# Factors by which pressures are mistaken, the value used over the right one.
_PRESSURES = (
    (1e-5, "bar taken for Pa"),
    (1e-3, "kPa taken for Pa"),
    (1e5 / 6894.757, "psi taken for bar"),
    (6894.757 / 1e5, "bar taken for psi"),
    (1e3 / 6894.757, "psi taken for kPa"),
)
# A cause has to bring the values within this factor of the usual ones.
_NEAR = 1.8


def plausibility_finding(
    orders: Sequence[RingOrder],
    mass_per_area_kg_m2: float | None,
    limits: TyreLimits | None = None,
) -> Finding | None:
    """Compare the lowest ring mode and the tuned mass with what tyres have.

    Parameters
    ----------
    orders : sequence of RingOrder
        Of a tyre on a fixed rim.
    mass_per_area_kg_m2 : float or None
        ρh that follows from frequencies and pressure; None where it was given or not determined.
    limits : TyreLimits, optional

    Returns
    -------
    Finding or None
        None where there is nothing to compare.
    """
    limits = limits or TyreLimits()
    first_hz = next((order.frequency_hz for order in orders if order.order == 1), None)
    seen = _Seen(first_hz, mass_per_area_kg_m2)
    if first_hz is None and mass_per_area_kg_m2 is None:
        return None
    if seen.is_usual(limits):
        return Finding("", "", None, PLAUSIBILITY, OK, f"{seen.text()}, as tyres have")
    detail = f"{seen.text()}, where tyres have {_text(limits, seen)}. {_cause(seen, limits)}"
    return Finding("", "", None, PLAUSIBILITY, WARNING, detail)


@dataclass(frozen=True)
class _Seen:
    """Natural frequency of order 1, Hz, and mass per area, kg/m²; None where unknown."""

    first_hz: float | None
    mass: float | None

    def scaled(self, *, rate: float = 1.0, pressure: float = 1.0) -> _Seen:
        """What a rate and a pressure that are smaller by these factors would have given."""
        return _Seen(
            None if self.first_hz is None else self.first_hz / rate,
            None if self.mass is None else self.mass * rate**2 / pressure,
        )

    def is_usual(self, limits: TyreLimits) -> bool:
        usual_hz = (
            self.first_hz is None
            or limits.lowest_order_1_hz <= self.first_hz <= limits.highest_order_1_hz
        )
        usual_mass = (
            self.mass is None or limits.lightest_kg_m2 <= self.mass <= limits.heaviest_kg_m2
        )
        return usual_hz and usual_mass

    def distance(self, limits: TyreLimits) -> float:
        """How far it is from a usual tyre: the largest |log| of a ratio."""
        ratios = [
            *([self.first_hz / limits.usual_hz] if self.first_hz else []),
            # The mass goes with the square of the rate: half of its logarithm compares.
            *([np.sqrt(self.mass / limits.usual_kg_m2)] if self.mass else []),
        ]
        return float(max(np.abs(np.log(ratios)), default=0.0))

    def text(self) -> str:
        words = []
        if self.first_hz is not None:
            words.append(f"order 1 at {self.first_hz:.4g} Hz")
        if self.mass is not None:
            words.append(f"a mass per area of {self.mass:.3g} kg/m²")
        return " and ".join(words)


def _text(limits: TyreLimits, seen: _Seen) -> str:
    words = []
    if seen.first_hz is not None:
        words.append(f"{limits.lowest_order_1_hz:g} to {limits.highest_order_1_hz:g} Hz")
    if seen.mass is not None:
        words.append(f"{limits.lightest_kg_m2:g} to {limits.heaviest_kg_m2:g} kg/m²")
    return " and ".join(words)


def _cause(seen: _Seen, limits: TyreLimits) -> str:
    causes = {_rate_text(factor, seen): seen.scaled(rate=factor) for factor in _RATE_FACTORS}
    if seen.mass is not None:
        causes |= {
            f"the inflation pressure is wrong ({what})": seen.scaled(pressure=factor)
            for factor, what in _PRESSURES
        }
    distance = {text: state.distance(limits) for text, state in causes.items()}
    best = min(distance, key=lambda text: distance[text])
    if distance[best] < np.log(_NEAR):
        return f"Most likely {best}"
    return "Check the sampling rate, the inflation pressure and the mean radius"


def _rate_text(factor: float, seen: _Seen) -> str:
    right = seen.scaled(rate=factor)
    high, times = ("high", factor) if factor > 1 else ("low", 1 / factor)
    return (
        f"the sampling rate is too {high} by a factor of {times:.4g} (with the right one: "
        f"{right.text()}). Compare sampling_rate_hz and the files' headers with the acquisition"
    )


AMPLITUDE = "amplitude"

# The ring's mass rests on a few frequencies: only a gross difference says something on the scale.
_FACTOR = 3.0
_CHECK_NEAR = 1.5
_LIKELY = (
    (9.80665, "accelerations in g taken for m/s²"),
    (1 / 9.80665, "accelerations in m/s² taken for g, or a force in kgf for N"),
    (4.448, "a force in N taken for lbf"),
    (1 / 4.448, "a force in lbf taken for N"),
    (1e3, "a force in N taken for kN, or accelerations in mV for V"),
    (1e-3, "a force in kN taken for N"),
)


def amplitude_finding(
    modal_model: ModalModel,
    orders: Sequence[RingOrder],
    ring: RingParameters,
    *,
    ring_is_doubted: bool = False,
) -> list[Finding]:
    """Compare the modal masses that the residues give with those of the tuned ring.

    At the crest of its wave an order answers with A = 1/(2jωm), m its modal mass, both members of
    a pair together. The ring's mass comes from frequencies and pressure alone, so a wrong unit or
    sensitivity of all sensors or of the force shows as a common factor.

    Parameters
    ----------
    modal_model : ModalModel
    orders : tuple of RingOrder
    ring : RingParameters
    ring_is_doubted : bool
        Whether something else makes the ring's mass implausible: then no unit is blamed.

    Returns
    -------
    list of Finding
        Nothing for a ring without belt width.
    """
    if ring.belt_width_m is None:
        return []
    expected = modal_mass_kg(ring, [order.order for order in orders])
    ratio = np.array([_modal_mass_kg(modal_model, order) for order in orders]) / expected
    factor = float(np.exp(np.median(np.log(ratio))))
    detail = f"modal masses are {factor:.3g} times those of the ring"
    if 1 / _FACTOR < factor < _FACTOR:
        return [Finding("", "", None, AMPLITUDE, OK, detail)]
    if ring_is_doubted:
        detail += ": the mass of the ring is in doubt, see there, not the amplitudes"
        return [Finding("", "", None, AMPLITUDE, OK, detail)]
    likely = [says for value, says in _LIKELY if 1 / _CHECK_NEAR < factor / value < _CHECK_NEAR]
    why = f", as with {likely[0]}" if likely else ""
    detail += (
        f" (limit {_FACTOR:g}){why}: check units and sensitivities of all sensors and of the "
        "force, and the belt width. Frequencies and damping do not depend on it"
    )
    return [Finding("", "", None, AMPLITUDE, WARNING, detail)]


def _modal_mass_kg(modal_model: ModalModel, order: RingOrder) -> float:
    content = [order_content(mode.residues, modal_model.position_deg) for mode in order.modes]
    cosine = sum(each.cosine[order.order] for each in content)
    sine = sum(each.sine[order.order] for each in content)
    crest = float(np.sqrt(abs(cosine) ** 2 + abs(sine) ** 2))
    return 1 / (4 * np.pi * order.frequency_hz * crest)
