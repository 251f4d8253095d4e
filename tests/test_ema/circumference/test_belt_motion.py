"""Motion of a belt along the circumference, in which masses on it take part."""

import numpy as np
import pytest

from ema.circumference.orders import circle_basis, stretch_hz
from model import modal_mass_kg
from pipelines.simulate.laboratory import Laboratory
from pipelines.simulate.laboratory_effects import Effects

LINES_HZ = np.arange(40, 600) / 2
ANGLES_DEG = np.arange(72) * 5.0


@pytest.mark.parametrize("seed", [1, 2, 5])
def test_order_0_tells_how_stiff_a_belt_is_against_extension(seed):
    """From 472 to 599 Hz, also with noise as large as order 0 itself at 70 Hz."""
    tyre = Laboratory(Effects(seed=seed)).tyre
    seen = tyre.solve().inertance(tyre.surface(ANGLES_DEG), 2 * np.pi * LINES_HZ)
    breathing = (np.linalg.pinv(circle_basis(ANGLES_DEG, 16)) @ seen)[0]
    ring = tyre.ring
    true_hz = np.sqrt(ring.axial_stiffness_n_m / ring.mass_per_area_kg_m2)
    true_hz /= 2 * np.pi * ring.mean_radius_m
    noise = np.full(LINES_HZ.size, np.abs(breathing[LINES_HZ == 70.0]))
    drawn = np.random.default_rng(1).standard_normal((2, LINES_HZ.size))
    noisy = breathing + noise * (drawn[0] + 1j * drawn[1])
    known = modal_mass_kg(ring, np.arange(1, 17)), noise
    assert stretch_hz(LINES_HZ, breathing, *known) == pytest.approx(true_hz, rel=0.01)
    assert stretch_hz(LINES_HZ, noisy, *known) == pytest.approx(true_hz, rel=0.02)
    nothing = np.zeros(LINES_HZ.size, dtype=complex)
    assert stretch_hz(LINES_HZ, nothing, *known) == 545.0
