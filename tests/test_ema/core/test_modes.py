"""Modes: what follows from a pole and residues, and the FRFs that follow from modes."""

import numpy as np
import pytest
import systems
from hypothesis import given
from hypothesis import strategies as st

from ema.core.modes import Mode, ResidualTerms, synthesise


def mode_of(residues, pole=-10 + 500j):
    return Mode(pole, 0.01, 0.001, residues, np.zeros(len(residues)))


@given(st.floats(0.5, 1000), st.floats(1e-5, 0.3))
def test_frequency_and_damping_come_back_from_the_pole(frequency_hz, damping_ratio):
    mode = mode_of([1.0], complex(systems.pole(frequency_hz, damping_ratio)))
    assert mode.frequency_hz == pytest.approx(frequency_hz)
    assert mode.damping_ratio == pytest.approx(damping_ratio)


@given(st.floats(0, 2 * np.pi), st.floats(0.01, 100))
def test_a_shape_has_its_largest_part_at_plus_one(phase, size):
    real = np.array([0.2, -0.4, 0.35])
    shape = mode_of(size * np.exp(1j * phase) * real).shape
    np.testing.assert_allclose(shape, real / -0.4, atol=1e-9)


def test_a_complex_shape_keeps_its_complexity():
    residues = np.array([1, 1j, 0.3 - 0.2j, 2])
    mode = mode_of(residues)
    assert mode_of(mode.shape).mpc == pytest.approx(mode.mpc)
    assert np.max(np.abs(mode.shape)) == pytest.approx(1)


def test_modes_cannot_be_changed_behind_their_back():
    residues = np.ones(3, dtype=complex)
    mode = mode_of(residues)
    residues[0] = 5
    assert mode.residues[0] == 1
    with pytest.raises(ValueError, match="read-only"):
        mode.residues[0] = 5
    with pytest.raises(ValueError, match="read-only"):
        ResidualTerms(np.ones(2), np.ones(2)).lower[0] = 5


def test_a_single_oscillator_is_synthesised_exactly():
    """−ω²/(k + jωc − mω²) with m = 4 kg."""
    frequency_hz, zeta, mass = 80.0, 0.03, 4.0
    omega_0 = 2 * np.pi * frequency_hz
    lines_hz = np.linspace(1, 200, 100)
    omega = 2 * np.pi * lines_hz
    expected = -(omega**2) / (mass * (omega_0**2 + 2j * zeta * omega_0 * omega - omega**2))
    poles = systems.pole([frequency_hz], [zeta])
    found = systems.inertance(lines_hz, poles, systems.residue(poles, mass)[None, :])
    np.testing.assert_allclose(found[0], expected, rtol=1e-12)


def test_residual_terms_are_a_mass_line_and_a_stiffness_line():
    lines_hz = np.array([1.0, 10.0, 100.0])
    omega = 2 * np.pi * lines_hz
    nothing = np.zeros(0, dtype=complex), np.zeros((2, 0), dtype=complex)
    found = synthesise(lines_hz, *nothing, np.array([0.5, 0]), np.array([0, 1e-5]))
    np.testing.assert_allclose(found[0], 0.5)
    np.testing.assert_allclose(found[1], -(omega**2) * 1e-5)


def test_lumped_masses_are_the_sum_of_their_modes():
    """Residues from mode shapes against −ω² (K + jωC − ω²M)⁻¹: the two ways agree."""
    system = systems.THREE_MASSES
    shapes = np.linalg.eigh(system.stiffness)[1]
    residues = shapes * shapes[0] / (2j * system.poles.imag)
    lines_hz = np.linspace(1, 200, 50)
    np.testing.assert_allclose(
        systems.inertance(lines_hz, system.poles, residues), system.inertance(lines_hz), rtol=1e-9
    )
