"""The modal masses that residues give against those of the ring."""

from dataclasses import replace

import numpy as np
import pytest
from results import ORDERS, ring_modes

from model.parameters import RingParameters
from model.ring import modal_mass_kg
from pipelines.process.validate import amplitude_finding, ring_orders

RING = RingParameters(
    mean_radius_m=0.33,
    inflation_pressure_pa=2.2e5,
    mass_per_area_kg_m2=19.69,
    radial_stiffness_n_m3=8.27e6,
    circumferential_stiffness_n_m3=6.56e5,
    axial_stiffness_n_m=2.52e7,
    bending_stiffness_n_m=7.45,
    belt_width_m=0.19,
)


def measured(scale: float = 1.0):
    """Modes with the ring's own modal masses; `scale` multiplies all accelerations."""
    model = ring_modes(np.arange(72) * 5.0)
    right = 4.0 / modal_mass_kg(RING, ORDERS)
    modes = tuple(
        replace(mode, residues=scale * factor * mode.residues)
        for mode, factor in zip(model.modes, right, strict=True)
    )
    return replace(model, modes=modes)


def finding(scale: float):
    model = measured(scale)
    (found,) = amplitude_finding(model, ring_orders(model), RING)
    return found


def test_amplitudes_of_the_ring_itself_are_confirmed():
    found = finding(1.0)
    assert found.verdict == "ok"
    assert float(found.detail.split()[3]) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("scale", "why"),
    [
        (1 / 9.80665, "accelerations in g taken for m/s²"),
        (9.80665, "accelerations in m/s² taken for g"),
        (1e-3, "a force in N taken for kN"),
        (1e3, "a force in kN taken for N"),
        (1 / 4.448, "a force in N taken for lbf"),
        (25.0, ""),
    ],
)
def test_a_wrong_unit_of_everything_is_named(scale, why):
    found = finding(scale)
    assert found.verdict == "warning"
    assert why in found.detail
    assert ("as with" in found.detail) == bool(why)


def test_the_sign_is_another_matter():
    assert finding(-1.0).verdict == "ok"


def test_a_ring_without_belt_width_has_no_mass():
    model = measured()
    ring = replace(RING, belt_width_m=None)
    assert amplitude_finding(model, ring_orders(model), ring) == []
