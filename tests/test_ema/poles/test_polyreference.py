"""Poles from several forces: the same normal matrices in dense form, repeated roots, indicators."""

from dataclasses import replace

import numpy as np
import pytest

import ringmodal as rm
from ema.core.errors import InputError
from ema.core.references import References
from ema.poles.estimators import (
    driven_poles_of_order,
    normal_matrix,
    poles_of_order,
    reduced_normal_matrix,
)
from ema.poles.stability import build_stability

STEP_S, N_SAMPLES = 1 / 400, 200
POLES = np.array([-6.0 + 2j * np.pi * 100, -6.0 + 2j * np.pi * 100, -4.0 + 2j * np.pi * 130])
DRIVES = np.array([[1.0, 0.3], [-0.2, 1.0], [1.0, 0.5]])
SHAPES = np.random.default_rng(1).standard_normal((3, 5))


def decays():
    """Impulse responses of two forces, (2, 5, n_samples)."""
    waves = np.exp(np.outer(POLES, np.arange(N_SAMPLES) * STEP_S))
    return np.einsum("kr,ki,km->rim", DRIVES, SHAPES, waves)


def test_repeated_roots_come_back_with_the_plane_of_their_participations():
    found, drives = driven_poles_of_order(normal_matrix(decays(), 3), 3, STEP_S, 0.0, 2)
    for pole in POLES:
        assert np.abs(found - pole).min() < 1e-4 * abs(pole)
    twice = drives[np.abs(found - POLES[0]) < 1e-3 * abs(POLES[0])]
    assert twice.shape == (2, 2)
    assert np.linalg.svd(twice)[1][1] > 1e-3
    third = drives[np.argmin(np.abs(found - POLES[2]))]
    assert np.allclose(third, DRIVES[2], atol=1e-4)


def test_one_force_is_the_special_case():
    responses = decays()[:1]
    matrix = normal_matrix(responses, 6)
    assert np.array_equal(matrix, normal_matrix(responses[0], 6))
    alone, _ = driven_poles_of_order(matrix, 4, STEP_S, 0.0)
    assert np.array_equal(alone, poles_of_order(matrix, 4, STEP_S, 0.0))


def test_numerators_are_eliminated_as_in_dense_form():
    rng, order, n_lines = np.random.default_rng(2), 4, 60
    values = rng.standard_normal((2, 3, n_lines)) + 1j * rng.standard_normal((2, 3, n_lines))
    weight = rng.uniform(0.5, 1.0, n_lines)
    z = np.exp(-2j * np.pi * np.outer(np.arange(n_lines) / n_lines, np.arange(order + 1)))
    numerator = np.linalg.qr(weight[:, None] * z)[0]
    expected = np.zeros((2 * (order + 1),) * 2, dtype=complex)
    for row in values.swapaxes(0, 1):
        columns = [(weight * of * power) for power in z[:, ::-1].T for of in row]
        dense = np.array(columns).T
        rest = dense - numerator @ (numerator.conj().T @ dense)
        expected += rest.conj().T @ rest
    found = n_lines * reduced_normal_matrix(values, order, weight)
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.fixture(scope="module")
def references():
    """Two modes at 50 Hz and one at 80 Hz, driven by two forces."""
    lines_hz = np.arange(1, 401) / 4
    omega, found = 2 * np.pi * lines_hz, []
    own = 2 * np.pi * np.array([50.0, 50.0, 80.0])[:, None]
    answers = -(omega**2) / (own**2 - omega**2 + 0.02j * own * omega)
    for drive in DRIVES.T:
        values = (SHAPES * drive[:, None]).T @ answers
        std = np.full(values.shape, 1e-6)
        found.append(rm.FRF.from_arrays(lines_hz, values, std=std))
    return References(tuple(found))


def test_two_curves_of_the_cmif_peak_where_two_modes_are(references):
    cmif, lines_hz = references.cmif(), references.frequency_hz
    assert cmif.shape == (2, 400)
    np.testing.assert_allclose(
        np.sum(cmif**2, axis=0),
        np.sum(np.abs([frf.values for frf in references]) ** 2, axis=(0, 1)),
    )
    second = cmif[1]
    assert second[lines_hz == 50.0] > 10 * second[lines_hz == 80.0]


def test_two_curves_of_the_mif_fall_where_two_modes_are(references):
    mif, lines_hz = references.mif(), references.frequency_hz
    assert np.all(mif[:, lines_hz == 50.0] < 0.05)
    assert mif[0, lines_hz == 80.0] < 0.05
    assert mif[1, lines_hz == 80.0] > 0.5


@pytest.mark.parametrize("method", ["lsce", "plscf"])
def test_the_diagram_has_a_column_for_each_of_two_coinciding_modes(references, method):
    diagram = build_stability(references, (20.0, 95.0), method=method)
    kept = sorted(c.frequency_hz for c in diagram.clusters if c.kept)
    np.testing.assert_allclose(kept, [50.0, 50.0, 80.0], rtol=1e-5)
    assert diagram.cmif.shape == diagram.mif.shape == (2, diagram.indicator_hz.size)


def test_forces_need_a_position_in_common(references):
    first, second = references
    with pytest.raises(InputError, match="no place in common"):
        References((first, replace(second, node=second.node + 10))).common_rows()
