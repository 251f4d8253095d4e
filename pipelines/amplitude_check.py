"""Whether the measured amplitudes are those of a ring of this mass."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ema.circumference import order_content
from ema.modes import ModalModel
from ema.quality import OK, WARNING, Finding
from model.parameters import RingParameters
from model.ring import modal_mass_kg
from pipelines.validate import RingOrder

AMPLITUDE = "amplitude"

# The ring's mass rests on a few frequencies: only a gross difference says something on the scale.
_FACTOR = 3.0
_NEAR = 1.5
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
    likely = [says for value, says in _LIKELY if 1 / _NEAR < factor / value < _NEAR]
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
