"""Poles by p-LSCF: known systems, what it shares with LSCE, and where it must do better."""

from dataclasses import replace

import numpy as np
import pytest
import systems
from hypothesis import given, settings
from hypothesis import strategies as st

from ema.core.errors import InputError
from ema.poles.estimators import (
    impulse_responses,
    line_weight,
    normal_matrix,
    poles_of_order,
    reduced_normal_matrix,
)
from ema.poles.stability import build_stability, select_poles

BAND_HZ = (20.0, 260.0)
INSIDE = slice(0, 7)  # orders of Table 3; what follows lies beyond the band of interest


def poles_in(frf, band_hz=BAND_HZ, method="plscf", **options):
    poles = select_poles(build_stability(frf, band_hz, method=method, **options)).poles
    frequency_hz = systems.frequency_hz_of(poles)
    return poles[(frequency_hz > band_hz[0]) & (frequency_hz < band_hz[1])]


def in_dense_form(values, max_order, weight):
    """The same normal matrix from the regression matrix that is never formed."""
    n_lines = values.shape[1]
    z = np.exp(-2j * np.pi * np.outer(np.arange(n_lines) / n_lines, np.arange(max_order + 1)))
    numerator, _ = np.linalg.qr(weight[:, None] * z)
    total = np.zeros((max_order + 1, max_order + 1), dtype=complex)
    for row in values:
        denominator = (weight * row)[:, None] * z[:, ::-1]
        rest = denominator - numerator @ (numerator.conj().T @ denominator)
        total += rest.conj().T @ rest
    return total


@pytest.mark.parametrize(
    "system",
    [
        pytest.param(systems.THREE_MASSES, id="three masses"),
        pytest.param(systems.TWO_MASSES, id="two masses"),
    ],
)
def test_lumped_systems_are_found_to_the_digits_printed(system):
    poles = poles_in(system.frf(), system.band_hz)
    assert poles.size == len(system.printed_hz)
    np.testing.assert_allclose(
        systems.frequency_hz_of(poles), system.printed_hz, atol=system.digits_hz
    )
    np.testing.assert_allclose(
        systems.damping_of(poles), system.printed_damping, atol=system.digits_damping
    )


def test_noise_free_frfs_give_table_3_back():
    poles = poles_in(systems.tyre_frf(), max_order=30)[INSIDE]
    np.testing.assert_allclose(systems.frequency_hz_of(poles), systems.TABLE_3_HZ, rtol=1e-8)
    np.testing.assert_allclose(systems.damping_of(poles), systems.TABLE_3_DAMPING, rtol=1e-6)


@pytest.mark.parametrize("order", [12, 20, 30, 60])
def test_a_system_of_few_exact_poles_is_exact_at_every_higher_order(order):
    """Sampled exponentials are rational in z: no band end, no residual terms, nothing to trade."""
    n_lines, step_s, lowest_hz = 400, 1 / 200, 20.0
    truth = systems.pole(np.array([60.0, 100.0, 170.0]), np.array([0.02, 0.03, 0.04]))
    z = np.exp((truth - 2j * np.pi * lowest_hz) * step_s)
    shapes = np.array([[1.0, 0.5, -0.7], [0.3j, 1.0, 0.4], [-0.6, 0.2, 1.0]])
    around = np.exp(-2j * np.pi * np.arange(n_lines) / n_lines)
    values = shapes @ (1 / (1 - z[:, None] * around))
    matrix = reduced_normal_matrix(values, 60)
    noise = 1e-12 * np.trace(matrix).real * np.eye(61)  # the system has no poles left to give
    poles = poles_of_order(matrix + noise, order, step_s, lowest_hz)
    nearest = poles[np.abs(poles - truth[:, None]).argmin(axis=1)]
    np.testing.assert_allclose(nearest, truth, rtol=1e-6)


@pytest.mark.parametrize("snr_db", [np.inf, 40, 20, 10, 6])
def test_no_mode_is_missed_and_none_invented(snr_db):
    poles = poles_in(systems.tyre_frf(snr_db, seed=3))
    table = poles[systems.frequency_hz_of(poles) < 240]  # order 8 lies at 253 Hz
    assert table.size == 7
    np.testing.assert_allclose(systems.frequency_hz_of(table), systems.TABLE_3_HZ, rtol=2e-3)
    np.testing.assert_allclose(systems.damping_of(table), systems.TABLE_3_DAMPING, rtol=0.05)


@pytest.mark.parametrize("snr_db", [40, 20, 10])
def test_both_methods_agree(snr_db):
    frf = systems.tyre_frf(snr_db, seed=4)
    second, first = (poles_in(frf, method=method) for method in ("plscf", "lsce"))
    assert second.size == first.size
    np.testing.assert_allclose(
        systems.frequency_hz_of(second), systems.frequency_hz_of(first), rtol=2e-3
    )
    np.testing.assert_allclose(systems.damping_of(second), systems.damping_of(first), rtol=0.05)


@pytest.mark.parametrize("weighted", [False, True])
def test_ffts_give_the_matrix_of_the_dense_regression(weighted):
    rng = np.random.default_rng(1)
    values = rng.standard_normal((3, 90)) + 1j * rng.standard_normal((3, 90))
    weight = rng.uniform(0.3, 1, 90) if weighted else np.ones(90)
    ours = reduced_normal_matrix(values, 8, weight if weighted else None)
    dense = in_dense_form(values, 8, weight)
    np.testing.assert_allclose(ours / ours[0, 0], dense / dense[0, 0], atol=1e-12)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 12), st.integers(30, 90))
def test_with_equal_weights_it_is_lsce_on_whole_impulse_responses(seed, max_order, n_lines):
    """Parseval: around the whole circle, what the numerators leave over is LSCE's prediction."""
    rng = np.random.default_rng(seed)
    values = rng.standard_normal((2, n_lines)) + 1j * rng.standard_normal((2, n_lines))
    responses, _ = impulse_responses(np.arange(1.0, n_lines + 1), values)
    ours = reduced_normal_matrix(values, max_order)
    lsce = normal_matrix(responses[:, 1:], max_order)
    np.testing.assert_allclose(ours / ours[0, 0], lsce / lsce[0, 0], atol=1e-10)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.01, 100), st.integers(0, 10_000))
def test_units_and_common_weights_do_not_move_poles(factor, seed):
    frf = systems.tyre_frf(20, seed=seed, positions=6)
    lines = (frf.frequency_hz > 20) & (frf.frequency_hz < 260)
    values, weight = frf.values[:, lines], np.ones(lines.sum())
    poles, scaled = (
        np.sort_complex(poles_of_order(matrix, 20, 1 / 240, 20.0))
        for matrix in (
            reduced_normal_matrix(values, 20, weight),
            reduced_normal_matrix(factor * values, 20, factor * weight),
        )
    )
    np.testing.assert_allclose(scaled, poles, rtol=1e-6)


def coloured(frf, band_hz, factor, seed):
    """The same FRFs with noise of known level on a part of the band."""
    part = (frf.frequency_hz > band_hz[0]) & (frf.frequency_hz < band_hz[1])
    level = np.where(part, factor, 1.0) * frf.std
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(level.shape) + 1j * rng.standard_normal(level.shape)
    return replace(frf, values=frf.values + level * noise, std=np.hypot(level, frf.std))


def test_noisy_lines_count_less_where_their_noise_is_known():
    frf = coloured(systems.tyre_frf(20, seed=5), (85, 95), 300.0, seed=6)  # between two modes
    unknown = replace(frf, std=np.full(frf.std.shape, np.nan))
    errors = []
    for case in (frf, unknown):
        diagram = build_stability(case, BAND_HZ, method="plscf")
        poles = diagram.poles[diagram.model_order == 40]
        nearest = poles[np.abs(poles - systems.table_3_poles()[:3, None]).argmin(axis=1)]
        errors.append(np.max(np.abs(nearest / systems.table_3_poles()[:3] - 1)))
    assert errors[0] < 1e-3
    assert errors[0] < errors[1] / 2


def test_weights_follow_the_noise_and_need_to_know_it():
    std = np.repeat([1.0, 4.0], 200) * np.ones((5, 1))
    weight = line_weight(std)
    np.testing.assert_allclose(weight[[0, -1]], [1.0, 0.25])
    std[:, 50] = 100.0  # a tone, not the level around it
    np.testing.assert_allclose(line_weight(std), weight)
    assert line_weight(np.full((5, 400), np.nan)) is None
    assert line_weight(np.where(np.arange(400) == 7, np.nan, std)) is None


def test_an_unknown_method_is_refused_by_name():
    with pytest.raises(InputError, match=r"lscf.*lsce, plscf"):
        build_stability(systems.tyre_frf(), BAND_HZ, method="lscf")
