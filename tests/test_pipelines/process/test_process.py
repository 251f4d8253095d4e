"""From campaigns to results: the sample's truth, structures that are no tyre, measured data."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from builders import SHARED_DATA

from ema.core.campaign import Campaign, Processing, Tyre
from ema.core.errors import InputError
from ema.core.files import stamp_of
from ema.core.frf import FRF
from ema.core.mac import mac
from ema.io.campaign.read import read_campaign
from pipelines.process.ring import tune
from pipelines.process.run import process
from pipelines.report.write import save
from pipelines.results.options import Options
from pipelines.results.provenance import checksummed
from pipelines.results.store import load

ORDERS = np.arange(1, 8)


def between(modal_model, low_hz, high_hz):
    return [mode for mode in modal_model.modes if low_hz < mode.frequency_hz < high_hz]


def assert_table_3(modal_model, truth, *, frequency=1e-3, damping=0.03):
    """Orders 1 … 7, each once, none missing and none invented."""
    modes = between(modal_model, 40, 230)
    assert [mode.order for mode in modes] == list(ORDERS)
    for mode in modes:
        true = truth[mode.order]
        assert mode.frequency_hz == pytest.approx(true["frequency_hz"], rel=frequency)
        assert mode.damping_ratio == pytest.approx(true["damping_ratio"], rel=damping)


def test_the_sample_campaign_gives_table_3_back(sample_result, truth):
    assert_table_3(sample_result.modal_model, truth)
    assert not any("bound" in mode.status for mode in sample_result.modal_model.modes)


def test_frfs_of_arrays_become_a_whole_result(sample_result, tmp_path):
    given = sample_result.measured
    angle_deg = np.arange(0.0, 360.0, 5.0)
    frf = FRF.from_arrays(given.frequency_hz, given.values, angles_deg=angle_deg)
    campaign = Campaign("arrays", frf=frf, tyre=sample_result.tyre, excitation_deg=0.0)
    result = process(campaign)
    assert [m.order for m in result.modal_model.modes] == list(range(1, 10))
    ring, expected = result.tuning.ring, sample_result.tuning.ring
    assert ring.radial_stiffness_n_m3 == pytest.approx(expected.radial_stiffness_n_m3, rel=0.01)
    save(result, tmp_path / "result")
    assert load(tmp_path / "result").tyre == sample_result.tyre
    with pytest.raises(InputError, match="arrays"):
        process(replace(campaign, tyre=Tyre("of unknown pressure")))


def test_its_shapes_are_those_of_the_truth(sample_result):
    position_deg = sample_result.frf.position_deg
    np.testing.assert_allclose(position_deg, np.arange(72) * 5.0)
    for mode in between(sample_result.modal_model, 40, 230):
        true = np.cos(mode.order * np.deg2rad(position_deg))
        assert mac(mode.residues, true)[0, 0] > 0.95
        assert mode.order_purity > 0.95
        assert mode.mpc > 0.95


def test_its_error_bars_are_honest(sample_result, truth):
    modes = between(sample_result.modal_model, 40, 230)
    z = [
        [
            (mode.frequency_hz - truth[mode.order]["frequency_hz"]) / mode.frequency_std_hz,
            (mode.damping_ratio - truth[mode.order]["damping_ratio"]) / mode.damping_std,
        ]
        for mode in modes
    ]
    assert np.max(np.abs(z)) < 4


def test_its_runs_show_one_and_the_same_tyre(sample_result):
    assert sample_result.reference.consistent
    assert sample_result.reference.ratio == pytest.approx(1, abs=0.2)
    assert len(sample_result.reference.run) == 6
    assert sample_result.reference_deg == 2.5


def test_its_ring_hits_the_measured_frequencies_within_one_percent(sample_result):
    validation = sample_result.validation
    np.testing.assert_array_equal(validation.order[:7], ORDERS)
    assert np.max(np.abs(validation.error_percent[:7])) < 1
    assert np.all(np.diag(validation.mac)[:7] > 0.95)
    off_diagonal = validation.mac - np.diag(np.diag(validation.mac))
    assert np.max(off_diagonal) < 0.1


def test_with_the_papers_objective_the_first_mode_may_be_off_by_five(sample_result):
    """Tuned on the seven modes of Table 3, as the paper did."""
    seven = replace(
        sample_result.modal_model, modes=tuple(between(sample_result.modal_model, 40, 230))
    )
    bare = replace(sample_result, modal_model=seven, tuning=None, damping=None, validation=None)
    error = np.abs(tune(bare, Options(objective="paper")).validation.error_percent)
    assert error[0] < 5
    assert np.max(error[1:]) < 1


def test_given_parameters_are_taken_over(sample_result):
    again = tune(sample_result, Options(given={"mass_per_area_kg_m2": 19.69}))
    assert again.tuning.ring.mass_per_area_kg_m2 == 19.69
    assert again.tuning.how["mass_per_area_kg_m2"] == "given"


def test_the_lower_band_limit_hardly_moves_the_frequencies(sample_campaign, sample_result):
    narrow = process(sample_campaign, Options(Processing(band_hz=(50.0, 260.0)), tune=False))
    wide_hz = [mode.frequency_hz for mode in between(sample_result.modal_model, 60, 230)]
    narrow_hz = [mode.frequency_hz for mode in between(narrow.modal_model, 60, 230)]
    np.testing.assert_allclose(narrow_hz, wide_hz, rtol=5e-4)


def test_the_papers_averaging_gives_table_3_too(sample_campaign, truth):
    options = Options(Processing(averages=10, window="boxcar"), tune=False)
    result = process(sample_campaign, options)
    assert result.frf.blocks.n_blocks == 10
    assert_table_3(result.modal_model, truth)


def test_every_stage_is_announced_and_timed(modes_once, sample_result, short_campaign):
    announced = []
    result = process(short_campaign, Options(tune=False), announced.append)
    assert announced[0].startswith("Reading")
    assert list(result.provenance["stage_seconds"]) == list(
        sample_result.provenance["stage_seconds"]
    )
    assert len(announced) == len(result.provenance["stage_seconds"])
    assert all(seconds >= 0 for seconds in result.provenance["stage_seconds"].values())


def test_the_truth_beside_the_recordings_is_not_read(sample_result):
    names = [entry["file"] for entry in sample_result.provenance["inputs"]]
    assert names == ["campaign.toml", *(f"config_{n}.uff" for n in range(1, 7))]


def test_a_recording_that_changes_meanwhile_is_refused(tmp_path):
    """A checksum of other samples than those of the modes would be a wrong record."""
    path = tmp_path / "a.csv"
    path.write_text("1")
    with checksummed({path: stamp_of(path.stat())}) as inputs:
        assert inputs()[0]["bytes"] == 1
    with checksummed({path: (1, 0)}) as inputs, pytest.raises(InputError, match="changed since"):
        inputs()


def test_options_in_force_are_recorded(sample_result):
    options = sample_result.provenance["options"]
    assert options["estimator"] == "H1"
    assert tuple(options["processing"]["band_hz"]) == (20.0, 300.0)
    assert options["processing"]["window"] == "hann"
    assert options["processing"]["block_seconds"] == 4.0


def test_pinned_frequencies_are_the_modes(short_campaign):
    result = process(short_campaign, Options(pinned_hz=(100.3, 145.4, 196.5), tune=False))
    modes = between(result.modal_model, 40, 230)
    assert [mode.order for mode in modes] == [2, 4, 6]


def test_the_same_recordings_give_the_same_numbers(short_campaign, short_result):
    again = process(short_campaign)
    assert [m.pole for m in again.modal_model.modes] == [
        m.pole for m in short_result.modal_model.modes
    ]
    np.testing.assert_array_equal(again.frf.values, short_result.frf.values)
    np.testing.assert_array_equal(again.validation.model_hz, short_result.validation.model_hz)


def test_without_a_manifest_there_are_modes_but_no_ring(short_campaign, truth):
    result = process(sorted(short_campaign.glob("*.uff")))
    found_hz = result.modal_model.frequencies_hz
    for order in ORDERS:
        true = truth[order]["frequency_hz"]
        assert np.min(np.abs(found_hz / true - 1)) < 2e-3
    assert result.tyre is None
    assert result.tuning is None
    assert all(mode.order is None for mode in result.modal_model.modes)
    assert any("[tyre]" in note for note in result.notes)


def test_without_a_tyre_there_are_orders_but_no_ring(modes_once, campaign_copy):
    manifest = campaign_copy / "campaign.toml"
    sections = manifest.read_text().split("\n\n")
    manifest.write_text("\n\n".join(s for s in sections if not s.startswith("[tyre]")))
    result = process(campaign_copy)
    assert [mode.order for mode in between(result.modal_model, 40, 230)] == list(ORDERS)
    assert result.validation is None
    assert any("[tyre]" in note for note in result.notes)


def test_a_tyre_without_pressure_has_modes_where_no_ring_is_asked_for(modes_once, edit_manifest):
    campaign = edit_manifest("inflation_pressure_pa = 220000.0\n", "")
    result = process(campaign, Options(tune=False))
    assert [mode.order for mode in between(result.modal_model, 40, 230)] == list(ORDERS)
    assert result.tuning is None
    assert any("--no-tune" in note for note in result.notes)


def test_a_band_beyond_the_lines_is_refused(short_campaign):
    too_wide = Options(processing=replace(Processing(), band_hz=(20.0, 2000.0)))
    with pytest.raises(InputError, match=r"FRFs end at 999.*half the sampling rate"):
        process(short_campaign, too_wide)


def test_turned_sensors_without_positions_are_not_averaged_into_a_tyre(short_campaign, tmp_path):
    """Six tables say that A01 … A12 were on the tyre, and not where in which run."""
    campaign = read_campaign(short_campaign)
    manifest = [
        'schema = 1\n[tyre]\ndesignation = "x"\ninflation_pressure_pa = 2.2e5\n'
        "mean_radius_m = 0.33\n[acquisition]\nsampling_rate_hz = 2000.0\n"
        '[excitation]\nchannel = "force"'
    ]
    for run in campaign.runs[:2]:
        channels = [run.force, *(response.channel for response in run.responses)]
        head = ",".join(f"{c.name} [{'N' if c is run.force else 'm/s^2'}]" for c in channels)
        samples = np.column_stack([np.asarray(c.samples)[:4000] for c in channels])
        name = run.name.replace(".uff", ".csv")
        np.savetxt(tmp_path / name, samples, delimiter=",", header=head, comments="", fmt="%.6g")
        manifest.append(f'[[runs]]\nfile = "{name}"')
    (tmp_path / "campaign.toml").write_text("\n".join(manifest))
    with pytest.raises(InputError, match="neither position nor node"):
        process(tmp_path)


def real(name):
    path = SHARED_DATA / "real" / name
    if not path.exists():
        pytest.skip(f"no measured data at {path}")
    return path


def test_a_measured_ruler_has_its_five_lowest_modes():
    """FRFs from a file, no manifest; compared with another toolbox's poles of the same data."""
    result = process(real("ruler_grid") / "frf.uff")
    found_hz = result.modal_model.frequencies_hz
    for known_hz in (39.45, 108.46, 212.61, 352.28, 551.17):
        assert np.min(np.abs(found_hz / known_hz - 1)) < 0.01
    assert result.frf.n_positions == 10
    assert result.tuning is None


def test_a_measured_plate_goes_through_with_its_sweeps_averaged():
    """Four sweeps of one force and one sensor, averaged to one FRF."""
    result = process(sorted(real("plate_sweep").glob("run_*.uff")))
    assert result.frf.n_positions == 1
    assert result.frf.run[0].split("+") == [f"run_{n}.uff" for n in range(1, 5)]
    assert result.frf.n_effective == pytest.approx(4)
    lines = (result.frf.frequency_hz > 10) & (result.frf.frequency_hz < 500)
    assert np.mean(result.frf.coherence[0, lines]) == pytest.approx(0.975, abs=0.02)
    assert len(result.modal_model.modes) > 0


def test_a_single_run_of_twelve_sensors_gives_the_orders_they_can_tell(sample_campaign, tmp_path):
    shutil.copy(sample_campaign / "config_1.uff", tmp_path)
    manifest = (sample_campaign / "campaign.toml").read_text(encoding="utf-8")
    head, run, *_ = manifest.split("[[runs]]")
    (tmp_path / "campaign.toml").write_text(f"{head}[[runs]]{run}", encoding="utf-8")
    result = process(tmp_path)
    assert [mode.order for mode in result.modal_model.modes] == [
        1,
        2,
        3,
        4,
        5,
        None,
        None,
        None,
        None,
    ]
    assert result.modal_model.modes[-1].status.startswith("order unknown")
    assert result.validation.order.tolist() == [1, 2, 3, 4, 5]
    save(result, tmp_path / "result")
    assert load(tmp_path / "result").modal_model.modes[-1].order is None
