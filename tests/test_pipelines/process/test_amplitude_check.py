"""The modal masses that residues give against those of the ring."""

from dataclasses import replace

import numpy as np
import pytest
from results import ORDERS, ring_modes

from model.parameters import RingParameters
from model.ring import modal_mass_kg
from pipelines.process.validate import amplitude_finding, ring_orders
from pipelines.process.validate import modal_mass_kg as measured_mass_kg
from pipelines.simulate.laboratory import Laboratory
from pipelines.simulate.laboratory_effects import Effects

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


def uneven(seed, force_deg=30.0, **effects):
    """Exact modes of a tyre that varies, and the mass per order of an even one."""
    laboratory = Laboratory(Effects(seed=seed, force_deg=force_deg, **effects))
    modes = [m for m in laboratory.truth.modes if m.kind == "ring" and 1 <= m.order <= 8]
    model, found = ring_modes(np.arange(72) * 5.0), []
    at_force = int(force_deg / 5)
    for true in modes:
        residue_there = true.strength / (2 * abs(true.pole))
        residues = true.shape * (-1j * residue_there / true.shape[at_force])
        known = {"pole": true.pole, "order": true.order, "order_purity": true.purity}
        found.append(replace(model.modes[0], residues=residues, **known))
    ring = laboratory.truth.ring
    mass = modal_mass_kg(ring, np.arange(9)) * (1 + effects.get("splice", 0.0))
    return replace(model, modes=tuple(found), excitation_deg=force_deg), mass


def test_modal_masses_of_an_uneven_tyre_are_those_of_an_even_one():
    """Its shapes hold other orders, up to 10 % at the force: crests alone are off by that."""
    off, crests = [], []
    for seed in range(6):
        model, true = uneven(seed, splice=0.01, stiffness_variation=0.01)
        unknown = replace(model, excitation_deg=np.nan)
        for order in ring_orders(model):
            off.append(measured_mass_kg(model, order)[0] / true[order.order] - 1)
            mass, std = np.array(measured_mass_kg(unknown, order)) / true[order.order]
            crests.append((mass - 1, std))
    assert np.abs(off).max() < 0.025
    assert np.std(off) < 0.01
    by_crest, stds = np.transpose(crests)
    assert np.std(by_crest) > 3 * np.std(off)
    assert 0.5 < np.sqrt(np.mean((by_crest / stds) ** 2)) < 1.5


def test_the_mass_of_an_even_tyre_needs_no_angle():
    model, true = uneven(1, splice=0.0, stiffness_variation=0.0)
    for angle in (30.0, np.nan):
        seen = replace(model, excitation_deg=angle)
        for order in ring_orders(seen):
            mass, std = measured_mass_kg(seen, order)
            assert mass == pytest.approx(true[order.order], rel=0.002)
            assert std < 0.02 * mass
