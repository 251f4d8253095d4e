"""Poles of systems whose poles are known exactly, found by LSCE and refined by the curve fit."""

import numpy as np
import pytest
import systems

from ema.checks.quality import period_finding
from ema.core.finding import Verdict
from ema.identify import fit_modes
from ema.poles.stability import build_stability, select_poles
from ema.signals.frf_estimation import estimate_frf

LUMPED = [
    pytest.param(systems.THREE_MASSES, id="three masses"),
    pytest.param(systems.TWO_MASSES, id="two masses"),
]
INSIDE = slice(0, 7)  # orders of Table 3; what follows lies beyond the band of interest


def in_band(poles, band_hz):
    frequency_hz = systems.frequency_hz_of(poles)
    return poles[(frequency_hz > band_hz[0]) & (frequency_hz < band_hz[1])]


@pytest.mark.parametrize("system", LUMPED)
def test_the_printed_answers_are_the_eigenvalues(system):
    np.testing.assert_allclose(
        systems.frequency_hz_of(system.poles), system.printed_hz, atol=system.digits_hz
    )
    np.testing.assert_allclose(
        systems.damping_of(system.poles), system.printed_damping, atol=system.digits_damping
    )


@pytest.mark.parametrize("system", LUMPED)
def test_lsce_finds_lumped_systems_to_the_digits_printed(system):
    selection = select_poles(build_stability(system.frf(), system.band_hz))
    poles = in_band(selection.poles, system.band_hz)
    assert poles.size == len(system.printed_hz)
    np.testing.assert_allclose(
        systems.frequency_hz_of(poles), system.printed_hz, atol=system.digits_hz
    )
    np.testing.assert_allclose(
        systems.damping_of(poles), system.printed_damping, atol=system.digits_damping
    )


@pytest.mark.parametrize("system", LUMPED)
def test_the_curve_fit_reproduces_lumped_systems(system):
    frf = system.frf()
    model = fit_modes(frf, select_poles(build_stability(frf, system.band_hz)))
    np.testing.assert_allclose([mode.pole for mode in model.modes], system.poles, rtol=1e-6)
    np.testing.assert_allclose(model.frac, 1, atol=1e-9)
    lines = frf.frequency_hz[
        (frf.frequency_hz > system.band_hz[0]) & (frf.frequency_hz < system.band_hz[1])
    ]
    exact = system.inertance(lines)
    np.testing.assert_allclose(model.synthesise(lines), exact, atol=1e-5 * np.abs(exact).max())


def test_residues_of_a_lumped_system_follow_from_its_mode_shapes():
    """For proportional damping A_ir = φ_ir φ_0r / (2jω_d m_r)."""
    system = systems.THREE_MASSES
    _, shapes = np.linalg.eigh(system.stiffness)  # unit masses
    expected = shapes * shapes[0] / (2j * system.poles.imag)
    frf = system.frf()
    model = fit_modes(frf, select_poles(build_stability(frf, system.band_hz)))
    found = np.stack([mode.residues for mode in model.modes], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_lsce_alone_gives_table_3_back_from_noise_free_frfs():
    frf = systems.tyre_frf()
    diagram = build_stability(frf, (20, 260), max_order=30)
    poles = select_poles(diagram).poles[INSIDE]
    np.testing.assert_allclose(systems.frequency_hz_of(poles), systems.TABLE_3_HZ, rtol=1e-8)
    np.testing.assert_allclose(systems.damping_of(poles), systems.TABLE_3_DAMPING, rtol=1e-6)


def test_every_high_enough_model_order_holds_table_3():
    """Nine modes lie within the lines used; a few orders more stand for the band's ends."""
    diagram = build_stability(systems.tyre_frf(), (20, 260), max_order=30)
    truth = systems.table_3_poles()[INSIDE]
    for order in range(12, 31):
        poles = diagram.poles[diagram.model_order == order]
        nearest = poles[np.abs(poles[None, :] - truth[:, None]).argmin(axis=1)]
        np.testing.assert_allclose(
            systems.frequency_hz_of(nearest), systems.TABLE_3_HZ, rtol=1e-4, err_msg=f"{order}"
        )
        np.testing.assert_allclose(systems.damping_of(nearest), systems.TABLE_3_DAMPING, rtol=1e-2)


@pytest.mark.parametrize("band_hz", [(20, 260), (50, 260), (40, 240)])
def test_the_fit_gives_table_3_back_from_noise_free_frfs(band_hz):
    frf = systems.tyre_frf()
    model = fit_modes(frf, select_poles(build_stability(frf, band_hz)))
    np.testing.assert_allclose(model.frequencies_hz[INSIDE], systems.TABLE_3_HZ, rtol=1e-6)
    np.testing.assert_allclose(model.damping_ratios[INSIDE], systems.TABLE_3_DAMPING, rtol=1e-4)


def test_the_lower_band_limit_does_not_move_the_frequencies():
    """A time step that does not follow the inverted band would move them by 5 to 10 %."""
    frf = systems.tyre_frf(snr_db=20)
    wide, narrow = (
        fit_modes(frf, select_poles(build_stability(frf, (low, 260)))).frequencies_hz
        for low in (20, 50)
    )
    np.testing.assert_allclose(narrow[INSIDE], wide[INSIDE], rtol=5e-4)


@pytest.fixture(scope="module", params=["boxcar", "hann"])
def measured(request):
    """Twelve sensors for 100 s at 1 kHz, sensor noise 20 dB below the mean response."""
    rate_hz, n_samples, position_deg = 1000.0, 100_000, np.arange(12) * 30.0
    force = systems.white(n_samples, seed=5)
    clean = systems.responses_to(
        force, rate_hz, systems.table_3_poles(), systems.tyre_residues(position_deg)
    )
    noise = 0.1 * clean.std() * systems.white(n_samples, seed=6, n_rows=12)
    run = systems.run_of(force, clean + noise, rate_hz, position_deg=position_deg)
    return estimate_frf(systems.campaign_of(run, block_seconds=4.0, window=request.param))


def test_recordings_of_known_noise_give_table_3_back(measured):
    model = fit_modes(measured, select_poles(build_stability(measured, (20, 260))))
    assert np.sum(model.frequencies_hz < 240) == 7
    np.testing.assert_allclose(model.frequencies_hz[INSIDE], systems.TABLE_3_HZ, rtol=1e-3)
    np.testing.assert_allclose(model.damping_ratios[INSIDE], systems.TABLE_3_DAMPING, rtol=0.03)


def test_recordings_of_known_noise_err_within_their_error_bars(measured):
    modes = fit_modes(measured, select_poles(build_stability(measured, (20, 260)))).modes[INSIDE]
    frequency_z = [
        (mode.frequency_hz - true) / mode.frequency_std_hz
        for mode, true in zip(modes, systems.TABLE_3_HZ, strict=True)
    ]
    damping_z = [
        (mode.damping_ratio - true) / mode.damping_std
        for mode, true in zip(modes, systems.TABLE_3_DAMPING, strict=True)
    ]
    assert np.max(np.abs([frequency_z, damping_z])) < 4
    assert 0.3 < np.std([frequency_z, damping_z]) < 2  # 14 values: neither far off nor too good


@pytest.fixture(scope="module")
def swept():
    """A sweep of 4 s, ten times on end: no two blocks of another length hold the same."""
    rate_hz, position_deg = 1000.0, np.arange(12) * 30.0
    times_s = np.arange(4000) / rate_hz
    force = np.tile(np.sin(2 * np.pi * (15 * times_s + 35 * times_s**2)), 10)
    clean = systems.responses_to(
        force, rate_hz, systems.table_3_poles(), systems.tyre_residues(position_deg)
    )
    responses = clean + 0.02 * clean.std() * systems.white(force.size, seed=7, n_rows=12)
    return systems.run_of(force, responses, rate_hz, position_deg=position_deg)


def test_a_repeated_sweep_gives_damping_without_bias(swept):
    frf = estimate_frf(systems.campaign_of(swept))
    assert frf.blocks.is_one_period
    model = fit_modes(frf, select_poles(build_stability(frf, (20, 260))))
    np.testing.assert_allclose(model.frequencies_hz[INSIDE], systems.TABLE_3_HZ, rtol=2e-4)
    np.testing.assert_allclose(model.damping_ratios[INSIDE], systems.TABLE_3_DAMPING, rtol=2e-3)
    assert [finding.verdict for finding in period_finding(frf)] == [Verdict.OK]


def test_a_repeated_sweep_in_other_blocks_is_a_warning(swept):
    frf = estimate_frf(systems.campaign_of(swept, window="hann"))
    (finding,) = period_finding(frf)
    assert finding.verdict == Verdict.WARNING
    assert "the force repeats every 4 s, but blocks of 4 s with a hann window" in finding.detail
