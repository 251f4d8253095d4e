"""The simulated campaign: its truth, its exactness and what a lab would find in its folder."""

import hashlib
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import csd, welch

import ema
from ema.core.errors import InputError
from model.parameters import (
    TABLE_3_DAMPING_RATIOS,
    TABLE_3_FREQUENCIES_HZ,
    TABLE_4_RING,
    TABLE_5_DAMPING,
)
from pipelines.results.parameter_set import read_parameter_set
from pipelines.simulate.campaign import Setup, simulate_campaign, simulate_runs
from pipelines.simulate.truth import modal_sum, truth_modes

SHORT = {"duration_s": 2.0}
SAMPLE = Path(__file__).parents[3] / "sample_data" / "tyre_225_55R17"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return simulate_campaign(tmp_path_factory.mktemp("campaign"), **SHORT)


def test_truth_is_table_3_and_the_ring_beyond():
    modes = truth_modes()
    assert [mode.order for mode in modes] == list(range(17))
    np.testing.assert_array_equal([m.frequency_hz for m in modes[1:8]], TABLE_3_FREQUENCIES_HZ)
    np.testing.assert_array_equal([m.damping_ratio for m in modes[1:8]], TABLE_3_DAMPING_RATIOS)
    assert modes[0].frequency_hz == pytest.approx(557.502, abs=1e-3)
    assert modes[0].modal_mass_kg == pytest.approx(2 * np.pi * 0.33 * 19.69 * 0.19)


def test_inertance_is_the_sum_of_single_modes():
    modes, angles = truth_modes(), np.array([0.0, 37.0, 100.0])
    omega = 2 * np.pi * np.linspace(1.0, 900.0, 500)
    expected = sum(
        -(omega**2)
        * np.cos(mode.order * np.deg2rad(angles[:, None]))
        / mode.modal_mass_kg
        / (w**2 - omega**2 + 2j * mode.damping_ratio * w * omega)
        for mode in modes
        for w in [2 * np.pi * mode.frequency_hz]
    )
    system = modal_sum(modes, angles, 0.0)
    for row in range(3):
        np.testing.assert_allclose(system.inertance(row, omega), expected[row], rtol=1e-9)


def test_sensors_load_a_mode_by_both_directions_of_their_motion():
    """Equidistant sensors add m Σ (cos² + sin²/n²) = m N (1 + 1/n²) / 2 to the modal mass."""
    mode = next(each for each in truth_modes() if each.order == 3)
    angles, mass = np.arange(0.0, 360.0, 30.0), 0.05
    loaded = modal_sum((mode,), angles, 0.0, sensor_mass_kg=mass)
    added = mass * angles.size * (1 + 1 / mode.order**2) / 2
    expected = mode.frequency_hz / np.sqrt(1 + added / mode.modal_mass_kg)
    np.testing.assert_allclose(np.abs(loaded.poles) / (2 * np.pi), expected, rtol=1e-12)


def test_a_split_pair_without_distance_is_the_single_mode():
    angles, omega = np.array([0.0, 35.0]), 2 * np.pi * np.linspace(50.0, 250.0, 40)
    single = modal_sum(truth_modes(), angles, 0.0)
    pair = modal_sum(truth_modes(split_percent=1e-7, shaker_between=0.3), angles, 0.0)
    for row in range(2):
        np.testing.assert_allclose(
            pair.inertance(row, omega), single.inertance(row, omega), rtol=1e-6
        )


def test_a_split_opens_symmetrically_and_turns_the_members():
    pair = [mode for mode in truth_modes(split_percent=2.0, shaker_between=0.5) if mode.order == 3]
    assert [mode.member for mode in pair] == ["a", "b"]
    np.testing.assert_allclose([m.frequency_hz / 121.40 for m in pair], [0.99, 1.01])
    np.testing.assert_allclose([m.orientation_deg for m in pair], [-15.0, 15.0])


def test_the_reader_finds_the_whole_campaign(folder):
    campaign = ema.read_campaign(folder)
    places = sorted(r.position_deg for run in campaign.runs for r in run.responses)
    np.testing.assert_allclose(places, np.arange(72) * 5.0)
    nodes = [r.node * 5.0 for run in campaign.runs for r in run.responses]
    assert nodes == [r.position_deg for run in campaign.runs for r in run.responses]
    assert campaign.tyre.belt_width_m == 0.19
    assert campaign.reference_deg == 2.5
    assert {run.reference.node for run in campaign.runs} == {999}
    assert campaign.runs[0].recording.sampling_rate_hz == 2000.0


def test_node_numbers_alone_place_the_sensors(folder, tmp_path):
    for file in folder.glob("config_*.uff"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    manifest = (folder / "campaign.toml").read_text()
    (tmp_path / "campaign.toml").write_text(re.sub(r"positions_deg = .*\n", "", manifest))
    campaign = ema.read_campaign(tmp_path)
    assert [r.position_deg for r in campaign.runs[1].responses[:2]] == [5.0, 35.0]


def test_same_seed_same_bytes_and_another_seed_others(folder, tmp_path):
    again = simulate_campaign(tmp_path / "again", **SHORT)
    other = simulate_campaign(tmp_path / "other", seed=2, **SHORT)
    for path in folder.iterdir():
        assert path.read_bytes() == (again / path.name).read_bytes()
    assert (folder / "config_1.uff").read_bytes() != (other / "config_1.uff").read_bytes()


def test_csv_holds_the_same_samples(folder, tmp_path):
    table = ema.read_campaign(
        simulate_campaign(tmp_path / "csv", file_format="csv", duration_s=2.0)
    )
    universal = ema.read_campaign(folder)
    for left, right in zip(universal.runs, table.runs, strict=True):
        np.testing.assert_allclose(
            left.recording.block(0, 4000), right.recording.block(0, 4000), rtol=1e-6
        )


@pytest.mark.parametrize("where", ["fresh", "sample"])
def test_checksums_are_those_of_the_files(folder, where):
    folder = folder if where == "fresh" else SAMPLE
    readme = (folder / "README.md").read_text(encoding="utf-8")
    listed = re.findall(r"^([0-9a-f]{64})  (\S+)$", readme, re.M)
    assert len(listed) == 8
    for digest, name in listed:
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest


def test_the_sample_is_small_and_its_parameter_set_is_the_papers():
    assert sum(path.stat().st_size for path in SAMPLE.glob("*.uff")) < 15e6
    parameters = read_parameter_set(SAMPLE.with_suffix(".toml"))
    assert parameters.ring_parameters == TABLE_4_RING
    assert parameters.ring_damping == TABLE_5_DAMPING


def test_truth_tells_set_up_and_modes(folder):
    truth = tomllib.loads((folder / "truth.toml").read_text())
    assert truth["setup"]["duration_s"] == 2.0
    assert [mode["order"] for mode in truth["modes"]] == list(range(17))


def test_force_is_band_limited_noise_on_a_preload():
    channels = next(iter(simulate_runs(truth_modes(), Setup(duration_s=10.0))))
    force = channels[0].samples.astype(float)
    assert force.mean() == pytest.approx(50.0, abs=0.2)
    assert force.std() == pytest.approx(10.0, rel=0.02)
    frequency, density = welch(force, 2000.0, nperseg=2000)
    inside = (frequency > 15) & (frequency < 895)
    assert density[~inside & (frequency > 905)].max() < 1e-3 * density[inside].mean()


def test_noise_has_the_stated_level_on_every_sensor():
    modes = truth_modes()
    quiet = next(iter(simulate_runs(modes, Setup(duration_s=5.0, snr_db=300.0))))
    noisy = next(iter(simulate_runs(modes, Setup(duration_s=5.0, snr_db=20.0))))
    mean_rms = np.mean([np.std(channel.samples, dtype=float) for channel in quiet[1:]])
    for left, right in zip(quiet[1:], noisy[1:], strict=True):
        noise = np.std(right.samples.astype(float) - left.samples)
        assert noise == pytest.approx(0.1 * np.hypot(1.0, 0.3) * mean_rms, rel=0.05)


def test_response_over_force_is_the_exact_inertance():
    modes = truth_modes()
    channels = next(iter(simulate_runs(modes, Setup(duration_s=30.0, snr_db=300.0))))
    force, response = (channels[row].samples.astype(float) for row in (0, 5))
    options = {"fs": 2000.0, "nperseg": 16000, "window": "hann"}
    frequency, cross = csd(force, response, **options)
    estimate = cross / welch(force, **options)[1]
    band = (frequency > 60) & (frequency < 400)
    system = modal_sum(modes, np.array([120.0]), 0.0)
    exact = system.inertance(0, 2 * np.pi * frequency[band])
    misfit = np.linalg.norm(estimate[band] - exact) / np.linalg.norm(exact)
    assert misfit < 0.01


def test_drift_raises_every_frequency_from_run_to_run():
    modes = truth_modes()
    still = list(simulate_runs(modes, Setup(duration_s=1.0)))
    drifting = list(simulate_runs(modes, Setup(duration_s=1.0, drift_percent=0.5)))
    np.testing.assert_array_equal(still[0][1].samples, drifting[0][1].samples)
    assert np.abs(still[5][1].samples - drifting[5][1].samples).max() > 1.0
    np.testing.assert_array_equal(still[5][0].samples, drifting[5][0].samples)


def test_sensor_mass_is_in_the_manifest(tmp_path):
    folder = simulate_campaign(tmp_path, sensor_mass_kg=0.004, **SHORT)
    assert ema.read_campaign(folder).sensor_mass_kg == 0.004


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        ({"duration_s": 0.0}, "duration_s: 0"),
        ({"duration_s": 1e5}, "duration_s: 100000 s"),
        ({"duration_s": float("inf")}, "duration_s: inf"),
        ({"sampling_rate_hz": 1000.0}, "sampling_rate_hz: 1000"),
        ({"sensor_mass_kg": -0.1}, "sensor_mass_kg"),
        ({"sensor_mass_kg": 1e300}, "sensor_mass_kg"),
        ({"snr_db": -1e308}, "snr_db"),
        ({"split_percent": float("nan")}, "split_percent"),
        ({"shaker_between": -1e308}, "shaker_between"),
        ({"drift_percent": float("inf")}, "drift_percent"),
        ({"seed": -1}, "seed"),
        ({"file_format": "wav"}, "file_format"),
    ],
)
def test_refusals(tmp_path, options, rule):
    with pytest.raises(InputError, match=rule):
        simulate_campaign(tmp_path / "new", **options)
    assert not (tmp_path / "new").exists()


def test_nothing_is_overwritten(folder):
    with pytest.raises(InputError, match="new or empty folder"):
        simulate_campaign(folder)


@pytest.mark.parametrize("at_once", [False, True])
def test_frfs_of_several_forces_are_right_to_their_error_bar(tmp_path, at_once):
    setup = {"split_percent": 1.0, "snr_db": 30.0, "duration_s": 6.0}
    folder = simulate_campaign(tmp_path / "c", force_deg=(0.0, 22.5), at_once=at_once, **setup)
    truth = tomllib.loads((folder / "truth.toml").read_text())
    assert truth["setup"]["force_deg"] == [0.0, 22.5]
    modes = truth_modes(split_percent=1.0)
    # Blocks long enough that leakage is small beside the noise.
    frfs = ema.estimate_frf(ema.read_campaign(folder), block_seconds=1.0)
    assert [frf.excitation_deg for frf in frfs] == [0.0, 22.5]
    band = (frfs.frequency_hz > 20) & (frfs.frequency_hz < 300)
    for frf in frfs:
        assert frf.n_positions == 72
        system = modal_sum(modes, frf.position_deg, frf.excitation_deg)
        omega = 2 * np.pi * frf.frequency_hz[band]
        exact = np.array([system.inertance(row, omega) for row in range(72)])
        error = np.abs(frf.values[:, band] - exact) / frf.std[:, band]
        assert np.median(error) / np.sqrt(np.log(4)) == pytest.approx(1.0, abs=0.15)


def test_an_even_tyre_moves_with_any_force():
    """The force is a crest: what is seen of the pair turns with it."""
    modes, omega = truth_modes(both=True), 2 * np.pi * np.linspace(20.0, 300.0, 50)
    at_force = [modal_sum(modes, np.array([angle]), angle).inertance(0, omega) for angle in (0, 50)]
    np.testing.assert_allclose(at_force[0], at_force[1], rtol=1e-9)
