"""The tyre on the road: the uniform case, symmetry, small loads and the energies behind it."""

from dataclasses import replace

import numpy as np
import pytest

from model import (
    ContactPatch,
    InstabilityError,
    ParameterError,
    bifurcation,
    contact_patch,
    harmonics,
    load_ring,
    loaded_frequencies_hz,
    natural_frequencies_hz,
    torsion_frequency_hz,
)
from model.circle_fields import area_curvature, circle_fields, elastic_curvature, elastic_slope
from model.loaded import LoadedRing
from model.parameters import TABLE_4_RING

LOAD_N = 4000.0


@pytest.fixture(scope="module")
def pressed():
    return load_ring(TABLE_4_RING, contact_patch(TABLE_4_RING, LOAD_N), highest_order=40)


def pairs(frequencies):
    """Frequencies of the torsion and of each pair of an unloaded ring, ascending."""
    return np.sort(np.r_[frequencies[0], np.repeat(frequencies[1:], 2)])


@pytest.mark.parametrize("change", [0.0, -1e4, 2e4])
def test_a_uniform_load_is_a_change_of_pressure(change):
    found = load_ring(TABLE_4_RING, np.full(100, -change), highest_order=12).modes()
    ring = replace(TABLE_4_RING, inflation_pressure_pa=2.2e5 + change)
    expected = pairs(np.r_[torsion_frequency_hz(ring), natural_frequencies_hz(ring, range(1, 6))])
    np.testing.assert_allclose(found.frequency_hz[:11], expected, rtol=1e-9)
    np.testing.assert_array_equal(found.dominant_order[:11], [0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5])


def test_a_follower_pressure_unloaded_is_that_of_the_ring():
    found = load_ring(TABLE_4_RING, np.zeros(60), highest_order=8, pressure_load="follower")
    torsion = torsion_frequency_hz(TABLE_4_RING, pressure_load="follower")
    others = natural_frequencies_hz(TABLE_4_RING, range(1, 6), pressure_load="follower")
    expected = pairs(np.r_[torsion, others])
    np.testing.assert_allclose(found.modes().frequency_hz[:11], expected, rtol=1e-9)


@pytest.mark.parametrize("speed", [67.3, 200.0])
@pytest.mark.parametrize("load", ["dead", "follower"])
def test_unloaded_and_turning_it_shows_the_waves_seen_from_space(speed, load):
    found = load_ring(
        TABLE_4_RING, np.zeros(60), highest_order=6, speed_rad_s=speed, pressure_load=load
    ).modes()
    waves = bifurcation(TABLE_4_RING, range(1, 7), speed, frame="absolute", pressure_load=load)
    for expected in np.r_[waves.regressive_hz[:, 0], waves.progressive_hz[:, 0]]:
        assert np.abs(found.frequency_hz - expected).min() < 1e-6 * expected


def test_contact_carries_the_load(pressed):
    vertical = pressed.contact_pa @ np.cos(pressed.angles_rad) * pressed.fields.weight_rad
    assert vertical * 0.33 * 0.19 == pytest.approx(LOAD_N, rel=1e-5)
    assert pressed.radial_m.min() < -5e-3
    assert pressed.angles_rad[pressed.radial_m.argmin()] == 0.0


def test_the_state_is_in_equilibrium(pressed):
    line = TABLE_4_RING.mean_radius_m * pressed.fields.weight_rad
    applied = line * pressed.fields.radial.T @ pressed.contact_pa
    assert np.abs(pressed.imbalance).max() < 1e-9 * np.abs(applied).max()


def test_deflection_is_symmetric_about_the_contact(pressed):
    mirrored = (-np.arange(pressed.angles_rad.size)) % pressed.angles_rad.size
    np.testing.assert_allclose(pressed.radial_m, pressed.radial_m[mirrored], atol=1e-12)
    around = pressed.fields.circumferential @ pressed.coefficients
    np.testing.assert_allclose(around, -around[mirrored], atol=1e-12)


def test_shapes_are_symmetric_or_antisymmetric_about_the_contact(pressed):
    modes = pressed.modes()
    mirrored = (-np.arange(pressed.angles_rad.size)) % pressed.angles_rad.size
    for mode in range(1, 12):
        shape = modes.fields.radial @ modes.shapes[:, mode]
        even = np.linalg.norm(shape + shape[mirrored])
        odd = np.linalg.norm(shape - shape[mirrored])
        assert min(even, odd) < 1e-6 * max(even, odd)
    np.testing.assert_allclose(modes.share_of_order.sum(axis=0), 1.0)


def test_the_place_of_the_contact_changes_no_frequency(pressed):
    turned = contact_patch(TABLE_4_RING, LOAD_N, contact_rad=pressed.angles_rad[77])
    found = load_ring(TABLE_4_RING, turned, highest_order=40)
    np.testing.assert_allclose(found.radial_m, np.roll(pressed.radial_m, 77), atol=1e-10)
    np.testing.assert_allclose(
        found.modes().frequency_hz[:20], pressed.modes().frequency_hz[:20], rtol=1e-8
    )


def test_a_small_load_deflects_as_the_harmonics_predict():
    patch = contact_patch(TABLE_4_RING, 500.0)
    shape = load_ring(TABLE_4_RING, patch, highest_order=30).contact_pa
    small = load_ring(TABLE_4_RING, 1e-6 * shape, highest_order=30)
    rest = load_ring(TABLE_4_RING, 0.0 * shape, highest_order=30)
    transform = np.fft.fft(shape) / shape.size
    expected = np.zeros(shape.size)
    for n in range(-30, 31):
        terms = harmonics(TABLE_4_RING, n)
        wave = transform[n] * np.exp(1j * n * small.angles_rad)
        expected -= (terms.m22 / terms.determinant * wave).real
    found = (small.radial_m - rest.radial_m) / 1e-6
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())


def test_frequencies_split_and_shift_with_the_load():
    loads = [4000.0, 0.0, 1.0]
    frequencies, orders = loaded_frequencies_hz(TABLE_4_RING, loads, 11, highest_order=40)
    free = pairs(
        np.r_[torsion_frequency_hz(TABLE_4_RING), natural_frequencies_hz(TABLE_4_RING, range(1, 6))]
    )
    np.testing.assert_allclose(frequencies[1], free, rtol=1e-9)
    np.testing.assert_allclose(frequencies[2], free, rtol=1e-4)
    split = frequencies[0][[4, 6]] - frequencies[0][[3, 5]]
    assert np.all(split > 0.05)
    np.testing.assert_array_equal(orders[1], [0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5])


def test_an_impossible_load_is_refused_before_any_is_solved(monkeypatch):
    solved = []
    monkeypatch.setattr("model.loaded.load_ring", lambda *_, **__: solved.append(1))
    with pytest.raises(ParameterError, match="contact patch"):
        loaded_frequencies_hz(TABLE_4_RING, [0.0, 1000.0, 1e7], 5)
    assert not solved


def test_a_continued_solution_is_the_direct_one(pressed):
    lighter = load_ring(TABLE_4_RING, contact_patch(TABLE_4_RING, 2500.0), highest_order=40)
    continued = load_ring(
        TABLE_4_RING, contact_patch(TABLE_4_RING, LOAD_N), highest_order=40, start=lighter
    )
    np.testing.assert_allclose(continued.coefficients, pressed.coefficients, atol=1e-10)


def test_more_harmonics_change_little(pressed):
    finer = load_ring(TABLE_4_RING, contact_patch(TABLE_4_RING, LOAD_N), highest_order=60)
    np.testing.assert_allclose(
        finer.modes().frequency_hz[:15], pressed.modes().frequency_hz[:15], rtol=2e-4
    )


def energy(ring, fields, coefficients):
    """Eqs 43 and 46 at the points, from the strain of eq 3."""
    stretch, rotation = fields.stretch @ coefficients, fields.rotation @ coefficients
    strain = stretch + 0.5 * (stretch**2 + rotation**2)
    density = (
        ring.axial_stiffness_n_m * strain**2
        + ring.bending_stiffness_n_m * (fields.bending @ coefficients) ** 2
        + ring.radial_stiffness_n_m3 * (fields.radial @ coefficients) ** 2
        + ring.circumferential_stiffness_n_m3 * (fields.circumferential @ coefficients) ** 2
    )
    return 0.5 * density.sum() * ring.mean_radius_m * fields.weight_rad


def test_slope_and_curvature_are_derivatives_of_the_energy():
    fields = circle_fields(TABLE_4_RING, 6, 90)
    rng = np.random.default_rng(3)
    place = 1e-3 * rng.standard_normal(26)
    step = 1e-6
    slope = elastic_slope(TABLE_4_RING, fields, place)
    curvature = elastic_curvature(TABLE_4_RING, fields, place)
    for index in range(26):
        move = np.eye(26)[index] * step
        ahead, behind = (energy(TABLE_4_RING, fields, place + s * move) for s in (1, -1))
        assert (ahead - behind) / (2 * step) == pytest.approx(slope[index], rel=1e-5, abs=1.0)
        rise = elastic_slope(TABLE_4_RING, fields, place + move) - elastic_slope(
            TABLE_4_RING, fields, place - move
        )
        np.testing.assert_allclose(
            rise / (2 * step), curvature[index], atol=1e-6 * np.abs(curvature).max()
        )


def test_enclosed_area_is_that_of_the_polygon_through_the_belt():
    fields = circle_fields(TABLE_4_RING, 6, 20000)
    rng = np.random.default_rng(4)
    place = fields.uniform_radial(0.33) + 1e-2 * rng.standard_normal(26)
    radius, around = fields.radial @ place, fields.circumferential @ place
    z = (radius + 1j * around) * np.exp(1j * fields.angles_rad)
    polygon = 0.5 * np.sum((z.conj() * np.roll(z, -1)).imag)
    assert 0.5 * place @ area_curvature(fields) @ place == pytest.approx(polygon, rel=1e-6)


def test_an_unstable_state_has_no_frequencies(pressed):
    compressed = LoadedRing(
        TABLE_4_RING,
        pressed.fields,
        pressed.fields.uniform_radial(-0.02),
        pressed.contact_pa,
        0.0,
        "dead",
    )
    with pytest.raises(InstabilityError, match="buckles"):
        compressed.modes()
    with pytest.raises(InstabilityError, match="grows"):
        replace(compressed, speed_rad_s=20.0).modes()


@pytest.mark.parametrize(
    ("call", "where"),
    [
        (lambda: contact_patch(TABLE_4_RING, 0.0), "load_n"),
        (lambda: contact_patch(TABLE_4_RING, 1e6), "contact patch"),
        (
            lambda: contact_patch(replace(TABLE_4_RING, inflation_pressure_pa=0.0), 1.0),
            "inflation_pressure_pa",
        ),
        (lambda: contact_patch(replace(TABLE_4_RING, belt_width_m=None), 1.0), "belt_width_m"),
        (lambda: ContactPatch(np.nan, 0.1), "mean_pressure_pa"),
        (lambda: load_ring(TABLE_4_RING, np.zeros(20), highest_order=10), "contact"),
        (lambda: load_ring(TABLE_4_RING, np.zeros(20), highest_order=0), "highest_order"),
        (lambda: loaded_frequencies_hz(TABLE_4_RING, 0.0, 43, highest_order=10), "n_modes"),
        (lambda: load_ring(TABLE_4_RING, np.full(40, 4e6), highest_order=8), "contact"),
        (lambda: load_ring(TABLE_4_RING, np.full(40, 1e8), highest_order=8), "contact"),
    ],
)
def test_refusals(call, where):
    with pytest.raises(ParameterError, match=f"^{where}:"):
        call()
