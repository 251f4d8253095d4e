"""The stability diagram and its reading: every mode found, none invented."""

import numpy as np
import pytest
import systems
from scipy.signal import find_peaks

from ema.core.errors import FitError
from ema.poles.stability import build_stability, select_poles

BAND_HZ = (20.0, 260.0)
INNER_HZ = (40.0, 230.0)


def found_within(selection, band_hz=INNER_HZ):
    frequency_hz = systems.frequency_hz_of(selection.poles)
    return selection.poles[(frequency_hz > band_hz[0]) & (frequency_hz < band_hz[1])]


@pytest.fixture(scope="module")
def diagram():
    return build_stability(systems.tyre_frf(snr_db=20), BAND_HZ)


@pytest.mark.parametrize("snr_db", [np.inf, 40, 20, 10, 6])
@pytest.mark.parametrize("seed", [0, 1])
def test_no_mode_is_missed_and_none_invented(snr_db, seed):
    poles = found_within(
        select_poles(build_stability(systems.tyre_frf(snr_db, seed=seed), BAND_HZ))
    )
    assert poles.size == 7
    np.testing.assert_allclose(systems.frequency_hz_of(poles), systems.TABLE_3_HZ, rtol=5e-3)
    np.testing.assert_allclose(systems.damping_of(poles), systems.TABLE_3_DAMPING, rtol=0.15)


@pytest.mark.parametrize("positions", [12, 24])
def test_fewer_sensors_show_the_same_modes(positions):
    frf = systems.tyre_frf(snr_db=20, positions=positions)
    poles = found_within(select_poles(build_stability(frf, BAND_HZ)))
    assert poles.size == 7


@pytest.mark.parametrize("max_order", [30, 60, 100])
def test_the_highest_model_order_hardly_matters(max_order):
    frf = systems.tyre_frf(snr_db=20)
    poles = found_within(select_poles(build_stability(frf, BAND_HZ, max_order=max_order)))
    assert poles.size == 7
    np.testing.assert_allclose(systems.frequency_hz_of(poles), systems.TABLE_3_HZ, rtol=3e-3)


def test_noise_alone_has_no_modes():
    rng = np.random.default_rng(0)
    frequency_hz = np.arange(1, 1600) / 4
    noise = rng.standard_normal((12, frequency_hz.size, 2)) @ [1, 1j]
    frf = systems.noise_free_frf(frequency_hz, noise)
    with pytest.raises(FitError, match="no mode found between 20 and 260 Hz"):
        select_poles(build_stability(frf, BAND_HZ))


def test_the_diagram_holds_damped_poles_of_every_order(diagram):
    assert diagram.model_order.min() >= 2
    assert diagram.model_order.max() == 60
    assert np.all(diagram.poles.imag > 0)
    assert np.all((diagram.damping_ratio > 0) & (diagram.damping_ratio < 0.2))
    assert diagram.indicator.shape == diagram.indicator_hz.shape


def test_clusters_are_numbered_and_hold_each_order_once(diagram):
    assert [cluster.label for cluster in diagram.clusters] == list(range(len(diagram.clusters)))
    for cluster in diagram.clusters:
        rows = diagram.cluster == cluster.label
        assert cluster.size == np.unique(diagram.model_order[rows]).size > 0
        assert cluster.reason.startswith("kept" if cluster.kept else "dropped")


def test_modes_are_stable_over_the_orders(diagram):
    """In the upper half of the orders nearly every pole of a mode matches the order before."""
    for frequency_hz in systems.TABLE_3_HZ:
        near = np.abs(diagram.frequency_hz / frequency_hz - 1) < 0.005
        rows = near & (diagram.model_order > 30)
        assert np.unique(diagram.model_order[rows]).size >= 28
        assert np.mean(diagram.stable_frequency[rows]) > 0.9


def test_the_indicator_is_the_rms_inertance_and_peaks_near_the_modes():
    frf = systems.tyre_frf()
    diagram = build_stability(frf, BAND_HZ)
    lines = np.isin(frf.frequency_hz, diagram.indicator_hz)
    rms = np.sqrt(np.mean(np.abs(frf.values[:, lines]) ** 2, axis=0))
    np.testing.assert_allclose(diagram.indicator, rms)
    peaks_hz = diagram.indicator_hz[find_peaks(diagram.indicator)[0]]
    distance_hz = np.abs(peaks_hz[None, :] - systems.TABLE_3_HZ[:, None]).min(axis=1)
    assert np.all(distance_hz < 2)


def test_selected_poles_are_ascending_and_carry_the_band(diagram):
    selection = select_poles(diagram)
    assert selection.band_hz == BAND_HZ
    assert np.all(np.diff(np.abs(selection.poles)) > 0)


@pytest.mark.parametrize(("band_hz", "lines"), [((500, 600), 0), ((100, 103), 13)])
def test_a_band_without_enough_lines_is_refused(band_hz, lines):
    with pytest.raises(FitError, match=f"only {lines} frequency lines"):
        build_stability(systems.tyre_frf(), band_hz)


@pytest.mark.parametrize("percent_per_run", [0.05, 0.15])
@pytest.mark.parametrize("snr_db", [40, 10])
def test_runs_that_drifted_do_not_show_their_modes_several_times(percent_per_run, snr_db):
    """Six runs, each a little higher than the one before: one diagram with each mode once."""
    frf = systems.drifting_frf(percent_per_run, snr_db)
    poles = found_within(select_poles(build_stability(frf, BAND_HZ)))
    assert poles.size == 7
    np.testing.assert_allclose(systems.frequency_hz_of(poles), systems.TABLE_3_HZ, rtol=2e-3)
