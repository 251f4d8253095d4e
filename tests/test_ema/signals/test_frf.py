"""FRFs from recordings: estimators, coherence, σ, order and pooling of positions."""

from dataclasses import replace

import numpy as np
import pytest
import systems
from systems import campaign_of, run_of, white

from ema.core.campaign import Campaign, Processing
from ema.core.errors import InputError
from ema.signals.frf_estimation import estimate_frf
from ema.signals.leakage import noise_level

GAIN = 2.5
N_SAMPLES = 1 << 16
NOISE = 0.7  # rms of the noise added, relative to the signal


@pytest.fixture(scope="module")
def force():
    return white(N_SAMPLES, seed=1)


def frf_of(force, responses, *, estimator="H1", block_seconds=0.256, **options):
    run = run_of(force, responses, **options)
    return estimate_frf(campaign_of(run, block_seconds=block_seconds), estimator=estimator)


def level(values):
    return float(np.abs(values).mean())


@pytest.mark.parametrize("estimator", ["H1", "H2", "Hv"])
def test_all_estimators_agree_without_noise(force, estimator):
    frf = frf_of(force, GAIN * force, estimator=estimator)
    np.testing.assert_allclose(frf.values, GAIN, rtol=1e-12)
    np.testing.assert_allclose(frf.coherence, 1, rtol=1e-12)


def test_noise_on_the_response_leaves_h1_alone_and_raises_h2(force):
    response = GAIN * (force + NOISE * white(N_SAMPLES, seed=2))
    assert level(frf_of(force, response).values.mean(axis=1)) == pytest.approx(GAIN, rel=0.01)
    raised = GAIN * (1 + NOISE**2)
    assert level(frf_of(force, response, estimator="H2").values) == pytest.approx(raised, rel=0.03)


def test_noise_on_the_force_leaves_h2_alone_and_lowers_h1(force):
    seen = force + NOISE * white(N_SAMPLES, seed=3)
    lowered = GAIN / (1 + NOISE**2)
    assert level(frf_of(seen, GAIN * force).values.mean(axis=1)) == pytest.approx(lowered, rel=0.01)
    unbiased = 1 / frf_of(seen, GAIN * force, estimator="H2").values
    assert 1 / level(unbiased.mean(axis=1)) == pytest.approx(GAIN, rel=0.01)


def test_equal_noise_on_both_leaves_hv_alone(force):
    seen = force + NOISE * white(N_SAMPLES, seed=4)
    response = GAIN * (force + NOISE * white(N_SAMPLES, seed=5))
    frf = frf_of(seen, response, estimator="Hv")
    assert np.exp(np.mean(np.log(np.abs(frf.values)))) == pytest.approx(GAIN, rel=0.01)


def test_h1_over_h2_is_the_coherence_and_hv_their_geometric_mean(force):
    response = GAIN * (force + NOISE * white(N_SAMPLES, seed=6))
    h1, h2, hv = (frf_of(force, response, estimator=name) for name in ("H1", "H2", "Hv"))
    np.testing.assert_allclose(h1.values / h2.values, h1.coherence, rtol=1e-9)
    np.testing.assert_allclose(hv.values**2, h1.values * h2.values, rtol=1e-9)


def test_coherence_is_the_share_of_the_signal(force):
    response = force + NOISE * white(N_SAMPLES, seed=7)
    expected = 1 / (1 + NOISE**2)
    frf = frf_of(force, response)
    bias = (1 - expected) ** 2 / frf.n_effective  # Bendat & Piersol 2010, eq. 9.75
    assert frf.coherence.mean() == pytest.approx(expected + bias, abs=0.005)


def test_a_delay_turns_the_phase_backwards(force):
    """e^{+jωt}: what comes later has a negative phase."""
    delay_s = 1e-3
    frf = frf_of(force, np.roll(force, 1))
    expected = np.exp(-2j * np.pi * frf.frequency_hz * delay_s)
    np.testing.assert_allclose(frf.values[0], expected, atol=0.1)


def test_an_accelerating_mass_has_its_inverse_as_inertance(force):
    frf = frf_of(force, force / 8.0)
    np.testing.assert_allclose(frf.values, 1 / 8.0, rtol=1e-12)


def test_the_preload_does_not_matter(force):
    response = systems.responses_to(force, 1000.0, systems.pole([100.0], [0.03]), np.ones((2, 1)))
    plain = frf_of(force, response)
    preloaded = frf_of(force + 50.0, response - 9.81)
    np.testing.assert_allclose(preloaded.values, plain.values, rtol=1e-9)
    np.testing.assert_allclose(preloaded.coherence, plain.coherence, rtol=1e-9)


def test_a_reversed_sensor_is_turned_back_by_its_scale(force):
    run = run_of(force, GAIN * force)
    response = run.responses[0]
    turned = replace(response, channel=replace(response.channel, scale_to_si=-9.81))
    frf = estimate_frf(campaign_of(replace(run, responses=(turned,)), block_seconds=0.256))
    np.testing.assert_allclose(frf.values, -9.81 * GAIN, rtol=1e-12)


@pytest.mark.parametrize("window", ["boxcar", "hann"])
def test_sigma_is_the_scatter_of_the_estimates(force, window):
    """200 sensors see the same signal, each with noise of its own."""
    n_sensors, n_samples = 200, 1 << 13
    force = force[:n_samples]
    noise = NOISE * white(n_samples, seed=8, n_rows=n_sensors)
    run = run_of(force, GAIN * (force + noise))
    frf = estimate_frf(campaign_of(run, block_seconds=0.512, window=window))
    scatter = np.concatenate([frf.values.real, frf.values.imag], axis=1) - np.tile(
        np.concatenate([frf.values.real, frf.values.imag], axis=1).mean(axis=0), (n_sensors, 1)
    )
    claimed = np.sqrt(np.mean(frf.std**2))
    assert np.sqrt(np.mean(scatter**2)) / claimed == pytest.approx(1, abs=0.03)


def test_sigma_follows_bendat_and_piersol(force):
    """σ(|H|)/|H| = √((1−γ²)/(2 n γ²)), eq. 9.89, for the true coherence."""
    coherence = 1 / (1 + NOISE**2)
    frf = frf_of(force, GAIN * (force + NOISE * white(N_SAMPLES, seed=9)))
    expected = GAIN * np.sqrt((1 - coherence) / (2 * frf.n_effective * coherence))
    assert np.sqrt(np.mean(frf.std**2)) == pytest.approx(expected, rel=0.03)
    errors = np.abs(frf.values - GAIN) / np.sqrt(2)
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(expected, rel=0.1)


def test_one_average_has_no_error_estimate(force):
    frf = estimate_frf(campaign_of(run_of(force, force), averages=1, window="boxcar"))
    assert frf.n_effective == 1
    assert np.all(np.isnan(frf.std))
    np.testing.assert_allclose(frf.coherence, 1)


def test_positions_of_all_runs_come_in_order_of_their_angle(force):
    gains = {0.0: 1.0, 60.0: 2.0, 120.0: 3.0, 180.0: 4.0, 240.0: 5.0, 300.0: 6.0}
    angles = ([120.0, 0.0, 240.0], [60.0, 300.0, 180.0])
    runs = [
        run_of(
            force,
            np.outer([gains[angle] for angle in chosen], force),
            name=f"run_{number}.uff",
            position_deg=chosen,
        )
        for number, chosen in enumerate(angles, start=1)
    ]
    frf = estimate_frf(campaign_of(*runs, block_seconds=0.256))
    np.testing.assert_array_equal(frf.position_deg, sorted(gains))
    np.testing.assert_allclose(frf.values[:, 5], sorted(gains.values()), rtol=1e-12)
    assert frf.run == ("run_1.uff", "run_2.uff") * 3
    assert frf.channel == ("A02", "A01", "A01", "A03", "A03", "A02")


def test_without_angles_the_node_numbers_give_the_order(force):
    run = run_of(force, np.outer([1, 2, 3], force), node=[30, 10, 20])
    frf = estimate_frf(campaign_of(run, block_seconds=0.256))
    np.testing.assert_array_equal(frf.node, [10, 20, 30])
    np.testing.assert_allclose(frf.values[:, 0], [2, 3, 1], rtol=1e-12)


def test_a_position_measured_twice_is_averaged_over_all_blocks(force):
    half = N_SAMPLES // 2
    response = GAIN * (force + NOISE * white(N_SAMPLES, seed=10))
    parts = [
        run_of(force[here], response[here], name=f"run_{number}.uff", position_deg=[90.0])
        for number, here in enumerate((slice(0, half), slice(half, None)), start=1)
    ]
    settings = {"block_seconds": 0.256, "overlap": 0.0}
    pooled = estimate_frf(campaign_of(*parts, **settings))
    whole = estimate_frf(campaign_of(run_of(force, response, position_deg=[90.0]), **settings))
    assert pooled.run == ("run_1.uff+run_2.uff",)
    assert pooled.channel == ("A01",)
    assert pooled.n_effective == pytest.approx(2 * (half // 256))
    np.testing.assert_allclose(pooled.values, whole.values, rtol=1e-9)
    np.testing.assert_allclose(pooled.std, whole.std, rtol=1e-9)


def test_the_reference_sensor_is_kept_apart_run_by_run(force):
    runs = [
        run_of(force, force, name=f"run_{n}.uff", position_deg=[30.0 * n], reference=n * force)
        for n in (1, 2, 3)
    ]
    frf = estimate_frf(replace(campaign_of(*runs, block_seconds=0.256), reference_deg=2.5))
    assert frf.n_positions == 3
    assert frf.reference.run == ("run_1.uff", "run_2.uff", "run_3.uff")
    assert frf.reference.channel == ("REF",) * 3
    np.testing.assert_allclose(frf.reference.values[:, 7], [1, 2, 3], rtol=1e-12)
    np.testing.assert_array_equal(frf.reference.position_deg, [2.5] * 3)


def test_a_single_run_has_no_reference_to_compare(force):
    frf = estimate_frf(campaign_of(run_of(force, force, reference=force), block_seconds=0.256))
    assert frf.reference is None


def test_runs_of_different_length_share_their_lines(force):
    half = N_SAMPLES // 2
    short = run_of(force[:half], force[:half], name="short.uff", position_deg=[0.0])
    long = run_of(force, force, name="long.uff", position_deg=[90.0])
    frf = estimate_frf(campaign_of(long, short, averages=16))
    assert frf.blocks.n_blocks == 16
    np.testing.assert_allclose(frf.values, 1, rtol=1e-12)
    assert frf.std.shape == frf.values.shape


def test_runs_of_different_rate_are_refused(force):
    runs = [run_of(force, force, rate, name=f"{rate:g}.uff") for rate in (1000.0, 1024.0)]
    with pytest.raises(InputError, match=r"1024\.uff: 1024 Hz .* 1000 Hz"):
        estimate_frf(campaign_of(*runs))


def test_a_run_without_excitation_is_left_out_and_named(force):
    """Steady noise of its load cell does not decide on the blocks of the others' hits either."""
    hit = np.zeros(4096)
    hit[500:504] = 50.0
    runs = [
        run_of(0.01 * force[:4096], force[:4096], name="missed", position_deg=[0.0]),
        run_of(hit, GAIN * hit, name="one", position_deg=[90.0]),
        run_of(hit, GAIN * hit, name="two", position_deg=[180.0]),
    ]
    frf = estimate_frf(campaign_of(*runs))
    assert frf.run == ("one", "two")
    assert (frf.blocks.n_blocks, frf.blocks.window) == (1, "boxcar")
    found = [f for f in frf.findings if f.check == "excitation"]
    assert [(f.run, f.verdict) for f in found] == [("missed", "excluded")]


def test_a_silent_force_is_refused(force):
    silent = run_of(np.full(N_SAMPLES, 50.0), force)
    with pytest.raises(InputError, match=r"run_1\.uff, channel 'force': a constant signal"):
        estimate_frf(campaign_of(silent))


def test_an_unknown_estimator_is_refused(force):
    with pytest.raises(InputError, match="H1, H2, Hv"):
        frf_of(force, force, estimator="H3")


def test_frfs_of_a_file_are_handed_through_in_order():
    frf = systems.tyre_frf(positions=12)
    mixed = frf.rows(np.array([5, 0, 11, 3, 1, 2, 4, 6, 10, 9, 8, 7]))
    handed = estimate_frf(Campaign(name="file", frf=mixed))
    np.testing.assert_array_equal(handed.position_deg, frf.position_deg)
    np.testing.assert_array_equal(handed.values, frf.values)


def from_file(frf, **processing):
    unknown = np.full(frf.std.shape, np.nan)
    read = replace(frf, std=unknown, n_effective=np.nan, blocks=None, forces={})
    return estimate_frf(Campaign("file", frf=read, processing=Processing(**processing)))


def test_coherence_and_averages_of_a_file_give_sigma(force):
    """The one that the recordings themselves give."""
    responses = GAIN * force + NOISE * white(N_SAMPLES, seed=2, n_rows=3)
    run = run_of(force, responses)
    frf = estimate_frf(campaign_of(run, averages=50, window="boxcar"))
    given = from_file(frf, averages=50)
    np.testing.assert_allclose(given.std, frf.std, rtol=1e-9)
    assert given.n_effective == 50
    assert [finding.check for finding in given.findings] == ["coherence"]


def test_coherence_without_averages_gives_weights_only(force):
    quiet, loud = (GAIN * force + level * white(N_SAMPLES, seed=3) for level in (0.1, 1.0))
    run = run_of(force, [quiet, loud])
    frf = estimate_frf(campaign_of(run, averages=50, window="boxcar"))
    given = from_file(frf)
    assert np.isnan(given.std).all()
    weights = noise_level(given, slice(None))
    np.testing.assert_allclose(weights, noise_level(frf, slice(None)) * np.sqrt(2 * 49), rtol=0.05)
    without = from_file(replace(frf, coherence=np.full(frf.std.shape, np.nan)), averages=50)
    assert np.isnan(without.std).all()
    assert without.findings == ()


def test_an_frf_cannot_be_changed_behind_its_back():
    values = np.ones((1, 4), dtype=complex)
    frf = systems.noise_free_frf(np.arange(4.0), values)
    values[0, 0] = 7
    assert frf.values[0, 0] == 1
    with pytest.raises(ValueError, match="read-only"):
        frf.values[0, 0] = 7


@pytest.mark.parametrize("estimator", ["H1", "H2", "Hv"])
def test_what_is_too_small_for_a_power_is_nothing(estimator):
    force, motion = 1e-158 * white(4000, 1), 1e-158 * white(4000, 2, 3)
    frf = estimate_frf(campaign_of(run_of(force, motion)), estimator=estimator)
    assert np.all(frf.values == 0)


def test_many_sensors_are_those_of_several_runs():
    force = white(4000, 1)
    motion = white(4000, 2, 40)
    whole = estimate_frf(campaign_of(run_of(force, motion)))
    some = run_of(force, motion[17:35], node=range(18, 36))
    part = estimate_frf(campaign_of(some))
    for name in ("values", "coherence", "std"):
        np.testing.assert_allclose(getattr(whole, name)[17:35], getattr(part, name), rtol=1e-12)
    assert whole.n_positions == 40


def measured(order, seed, force_seed):
    """A run of one sensor that sees a resonance with the sign and size of its place."""
    force = white(20_000, force_seed)
    poles = systems.pole(np.array([80.0, 140.0]), np.array([0.03, 0.03]))
    residues = np.array([order]) * systems.residue(poles)
    motion = systems.responses_to(force, 1000.0, poles, residues)
    noise = 0.1 * motion.std() * white(20_000, seed, 1)
    return run_of(force, motion + noise, name=f"run_{seed}.uff", node=[1])


def test_runs_averaged_at_one_place_are_compared():
    same = estimate_frf(campaign_of(*(measured((1.0, 0.6), s, s + 10) for s in (1, 2, 3))))
    np.testing.assert_allclose(same.disagreement, 0.0, atol=1e-3)
    places = ((1.0, 0.6), (0.2, -0.9), (-0.8, 0.1))
    other = estimate_frf(
        campaign_of(*(measured(place, s, s + 10) for s, place in enumerate(places)))
    )
    assert other.disagreement[0] > 0.3
    once = estimate_frf(campaign_of(measured((1.0, 0.6), 1, 2)))
    np.testing.assert_array_equal(once.disagreement, 0.0)
