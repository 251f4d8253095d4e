"""Faults in recordings, from the file to ``quality.csv``: nothing is left out silently."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from ema.core.finding import Check, Verdict
from ema.io.uff.write import write_time_series
from pipelines.process.run import process
from pipelines.report.write import save
from pipelines.results.options import Options
from pipelines.simulate.campaign import Setup, simulate_campaign, simulate_runs
from pipelines.simulate.laboratory import Laboratory
from pipelines.simulate.laboratory_effects import Effects
from pipelines.simulate.truth import truth_modes

DURATION_S = 6.0
STOP_AT_MODES = Options(tune=False)
TRUTH = {mode.order: mode for mode in truth_modes()}


def hum(samples):
    time_s = np.arange(samples.size) / 2000.0
    return samples + 2 * samples.std() * np.sin(2 * np.pi * 50 * time_s)


def clipped(samples):
    limit = 2 * samples.std()
    return np.clip(samples, samples.mean() - limit, samples.mean() + limit)


def something_else(samples):
    return samples.std() * np.random.default_rng(5).standard_normal(samples.size)


# What happens to which sensor of which run, and what has to be said about it.
FAULTS = {
    (0, "A03"): (lambda samples: 0 * samples, "dead", "excluded"),
    (1, "A07"): (lambda samples: -samples, "flipped", "warning"),
    (2, "A11"): (clipped, "clipped", "excluded"),
    (3, "A02"): (lambda samples: 0.1 * samples, "scaled", "warning"),
    (4, "A09"): (something_else, "incoherent", "excluded"),
    (5, "A05"): (hum, "hum", "warning"),
}


def spoiled(channels, run):
    """The run's channels with their faults; in the first run A05 and A06 are swapped."""
    changed = []
    for channel in channels:
        fault = FAULTS.get((run, channel.name))
        samples = channel.samples if fault is None else fault[0](channel.samples)
        changed.append(replace(channel, samples=samples.astype(np.float32)))
    if run == 0:
        names = [channel.name for channel in changed]
        first, second = names.index("A05"), names.index("A06")
        samples = changed[first].samples, changed[second].samples
        changed[first] = replace(changed[first], samples=samples[1])
        changed[second] = replace(changed[second], samples=samples[0])
    return changed


@pytest.fixture(scope="module")
def faulty(tmp_path_factory):
    folder = simulate_campaign(tmp_path_factory.mktemp("faulty") / "campaign", duration_s=1.0)
    for run, channels in enumerate(simulate_runs(truth_modes(), Setup(duration_s=DURATION_S))):
        path = folder / f"config_{run + 1}.uff"
        path.unlink()
        write_time_series(path, spoiled(channels, run), 2000.0)
    return process(folder, STOP_AT_MODES)


@pytest.fixture(scope="module")
def quality(faulty, tmp_path_factory):
    """Rows of quality.csv that say more than ok."""
    folder = tmp_path_factory.mktemp("quality") / "result"
    save(faulty, folder)
    with (folder / "quality.csv").open(newline="") as file:
        return [row for row in csv.DictReader(file) if row["verdict"] != "ok"]


@pytest.mark.parametrize("place", FAULTS)
def test_each_fault_is_named_in_quality_csv(quality, place):
    run, channel = place
    _, check, verdict = FAULTS[place]
    rows = [r for r in quality if (r["run"], r["channel"]) == (f"config_{run + 1}.uff", channel)]
    assert (check, verdict) in {(row["check"], row["verdict"]) for row in rows}


def test_swapped_sensors_are_named_in_quality_csv(quality):
    rows = [row for row in quality if row["check"] == "swapped"]
    assert {(row["run"], row["channel"], row["verdict"]) for row in rows} == {
        ("config_1.uff", "A05", "warning"),
        ("config_1.uff", "A06", "warning"),
    }


def test_no_healthy_sensor_is_accused(quality):
    accused = {(row["run"], row["channel"]) for row in quality if row["channel"].startswith("A")}
    known = {(f"config_{run + 1}.uff", channel) for run, channel in FAULTS}
    assert accused == known | {("config_1.uff", "A05"), ("config_1.uff", "A06")}


def test_what_was_left_out_is_not_in_the_frfs(faulty):
    excluded = [place for place, (_, _, verdict) in FAULTS.items() if verdict == "excluded"]
    assert faulty.frf.n_positions == 72 - len(excluded)
    left = set(zip(faulty.frf.run, faulty.frf.channel, strict=True))
    assert not left & {(f"config_{run + 1}.uff", channel) for run, channel in excluded}


def assert_seven_orders(model, deviations=4.5):
    """Orders 1 … 7 once each, within their error bars."""
    modes = [mode for mode in model.modes if mode.frequency_hz < 235]
    assert [mode.order for mode in modes] == list(range(1, 8))
    for mode in modes:
        true = TRUTH[mode.order]
        off_hz = abs(mode.frequency_hz - true.frequency_hz)
        assert off_hz < deviations * mode.frequency_std_hz
        assert off_hz < 3e-3 * true.frequency_hz
        assert abs(mode.damping_ratio - true.damping_ratio) < deviations * mode.damping_std


def test_the_modes_do_not_suffer(faulty):
    assert_seven_orders(faulty.modal_model)


def test_drift_is_told_run_by_run(tmp_path):
    folder = simulate_campaign(tmp_path / "campaign", duration_s=DURATION_S, drift_percent=0.1)
    result = process(folder, STOP_AT_MODES)
    rows = [finding for finding in result.findings if finding.check == "drift"]
    assert [row.run for row in rows] == [f"config_{n}.uff" for n in range(2, 7)]
    assert {row.verdict for row in rows} == {"warning"}
    found = [float(row.detail.split()[2]) for row in rows]
    np.testing.assert_allclose(found, [0.1, 0.2, 0.3, 0.4, 0.5], atol=0.05)
    assert_seven_orders(result.modal_model)


def test_the_mass_in_the_manifest_is_taken_off(tmp_path):
    folder = simulate_campaign(tmp_path / "campaign", duration_s=DURATION_S, sensor_mass_kg=0.004)
    manifest = (folder / "campaign.toml").read_text()
    assert "mass_kg = 0.004" in manifest
    own = manifest.replace("mass_kg = 0.004", "mass_kg = { default = 0.004, REF = 0.0041 }")
    (folder / "campaign.toml").write_text(own)
    result = process(folder, STOP_AT_MODES)
    assert_seven_orders(result.modal_model)
    assert any("4 g (all others), 4.1 g (REF)" in note for note in result.notes)
    stated = result.provenance["corrections"]["sensor_mass_kg"]
    assert stated == {"default": 0.004, "REF": 0.0041}
    assert not [finding for finding in result.findings if finding.verdict == "excluded"]


def test_the_mass_cannot_be_taken_off_frfs_from_a_file(sample_folder, tmp_path):
    """They do not say which sensors sat on the tyre together: left in, and said so."""
    (tmp_path / "frf.uff").write_bytes((sample_folder / "frf.uff").read_bytes())
    (tmp_path / "campaign.toml").write_text(
        "schema = 1\n[sensors]\nmass_kg = 0.004\n[grid]\npositions = 72\n"
        '[[runs]]\nfile = "frf.uff"\n'
    )
    result = process(tmp_path, STOP_AT_MODES)
    assert [f.verdict for f in result.findings if f.check is Check.MASS] == [Verdict.WARNING]
    assert not any("bare tyre" in note for note in result.notes)


@pytest.mark.parametrize(("circle_deg", "left"), [((0.0, 180.0), 2), ((0.0, 360.0), 0)])
def test_stated_masses_that_cannot_be_taken_off_are_a_warning(circle_deg, left):
    """58 g at the load cell, stated and left in, moved a half circle by −0.7 %: 10 to 28 σ."""
    masses = {"sensor_mass_kg": 0.004, "live_mass_kg": 0.058}
    laboratory = Laboratory(
        Effects(seed=1, duration_s=10.0, runs=1, sensors=12, circle_deg=circle_deg, **masses)
    )
    campaign = replace(laboratory.campaign(), **masses)
    result = process(campaign, STOP_AT_MODES)
    assert len([f for f in result.findings if f.check is Check.MASS and not f.is_ok]) == left
