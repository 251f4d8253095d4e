"""Two results against each other, with truth known: simulated tyres and synthetic modes."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from results import ring_modes, structure_result, tyre_result

from ema.core.campaign import Processing, Tyre
from ema.core.errors import InputError
from ema.core.mac import mac
from ema.core.modes import Mode
from ema.io.uff.write import write_time_series
from model import natural_frequencies_hz
from model.parameters import TABLE_4_RING
from pipelines.compare.compare import common_positions, common_shapes, compare, compare_folders
from pipelines.compare.modes import match_modes, std_of_difference
from pipelines.compare.significance import Difference, agreement, holm, jointly_tested
from pipelines.compare.summary import findings, parameter_rows
from pipelines.process.ring import tune
from pipelines.process.run import process
from pipelines.report.write import save
from pipelines.results.options import Options
from pipelines.simulate.campaign import Setup, simulate_campaign, simulate_runs
from pipelines.simulate.truth import truth_modes

PRESSURE_RISE = 1.1


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Write a short campaign, of a tyre with other modes where wanted, and process it."""

    def simulated(seed, name, change=None, pressure_pa=2.2e5, **options):
        folder = tmp_path_factory.mktemp("comparison") / name
        setup = {"seed": seed, "duration_s": 4.0, "snr_db": 20.0} | options
        simulate_campaign(folder, file_format="uff", **setup)
        if change is not None:
            _rewrite(folder, change, setup)
        manifest = folder / "campaign.toml"
        text = manifest.read_text().replace("= 220000.0", f"= {pressure_pa}")
        manifest.write_text(text)
        return process(folder, Options(Processing(band_hz=(20.0, 260.0))))

    return simulated


def _rewrite(folder, change, setup):
    """Put recordings of a changed tyre in place of those that are there."""
    modes = tuple(change(mode) for mode in truth_modes())
    for run, channels in enumerate(simulate_runs(modes, Setup(**setup)), start=1):
        write_time_series(folder / f"config_{run}.uff", channels, 2000.0)


def stiffer(mode):
    """The same tyre with more pressure: belt and sidewalls stiffen as in the ring model."""
    harder = replace(
        TABLE_4_RING,
        inflation_pressure_pa=PRESSURE_RISE * TABLE_4_RING.inflation_pressure_pa,
        radial_stiffness_n_m3=PRESSURE_RISE * TABLE_4_RING.radial_stiffness_n_m3,
        circumferential_stiffness_n_m3=PRESSURE_RISE * TABLE_4_RING.circumferential_stiffness_n_m3,
    )
    order = np.array([mode.order])
    rise = natural_frequencies_hz(harder, order) / natural_frequencies_hz(TABLE_4_RING, order)
    return replace(mode, frequency_hz=float(rise[0]) * mode.frequency_hz)


def silent(mode, order):
    """The same tyre with one order that cannot be driven."""
    return replace(mode, modal_mass_kg=1e9) if mode.order == order else mode


@pytest.fixture(scope="module")
def base(campaign):
    return campaign(11, "base")


@pytest.fixture(scope="module")
def repeat(base, campaign):
    return compare(base, campaign(12, "again"))


@pytest.fixture(scope="module")
def harder(base, campaign):
    return compare(base, campaign(13, "harder", stiffer, PRESSURE_RISE * 2.2e5))


def shifted(result, factor, **changes):
    """The result with all frequencies moved by a factor."""
    modes = tuple(replace(m, pole=factor * m.pole) for m in result.modal_model.modes)
    return replace(result, modal_model=replace(result.modal_model, modes=modes), **changes)


# The same tyre again


def test_the_same_tyre_again_shows_no_effect(repeat):
    assert [mode.name for mode in repeat.modes] == [f"n = {n}" for n in range(1, 9)]
    assert not any(m.frequency.is_significant or m.damping.is_significant for m in repeat.modes)
    assert repeat.is_repeat
    assert repeat.doubts == ()
    assert repeat.only_first == repeat.only_second == ()


def test_the_same_tyre_again_scatters_within_its_error_bars(repeat):
    found = repeat.agreement
    assert found.frequency.freedom == found.damping.freedom == 8
    for scatter in (found.frequency, found.damping, found.apart):
        assert scatter.is_noise
        # Error bars of leakage are on the safe side, by a factor of two and more.
        assert 0.1 < scatter.ratio < 1.4
    assert abs(found.shift_percent) < 3 * found.shift_std_percent


def test_parameters_of_the_same_tyre_agree_and_given_ones_are_not_tested(repeat):
    status = {change.name: change.status for change in repeat.parameters}
    assert status["mean_radius_m"] == status["axial_stiffness_n_m"] == "not tested"
    assert status["radial_stiffness_n_m3"] == "not significant"
    assert "significant" not in status.values()


def test_a_parameter_that_is_not_identified_has_no_change_in_percent(base):
    value = base.tuning.ring.bending_stiffness_n_m
    ring = replace(base.tuning.ring, bending_stiffness_n_m=9.6 * value)
    how = base.tuning.how | {"bending_stiffness_n_m": "not identified"}
    other = replace(base, tuning=replace(base.tuning, ring=ring, how=how))
    rows = {row[0]: row for row in parameter_rows(compare(base, other))}
    assert rows["bending stiffness"][4] == "–"


def test_rings_with_different_given_parameters_are_not_tested(base):
    found = compare(base, tune(base, Options(given={"axial_stiffness_n_m": 2.0e7})))
    status = {change.name: (change.status, change.hows) for change in found.parameters}
    assert status["mass_per_area_kg_m2"] == ("not tested", "other parameters given")
    assert status["loss_factor"][0] == "not tested"


# Another pressure


def test_more_pressure_raises_every_order_as_in_the_ring_model(harder):
    truth = {mode.order: stiffer(mode).frequency_hz - mode.frequency_hz for mode in truth_modes()}
    assert len(harder.modes) == 7
    for mode in harder.modes:
        assert mode.frequency.is_significant
        assert mode.frequency.value == pytest.approx(
            truth[mode.first.order], abs=4 * mode.frequency.std
        )


def test_a_mode_that_pressure_shifts_out_of_the_band_has_a_reason(harder):
    (gone,) = harder.only_first
    assert gone.name == "n = 8"
    assert "outside the band of 20 to 260 Hz" in gone.reason


def test_different_conditions_are_listed(harder):
    assert [each.name for each in harder.differing] == ["Inflation pressure"]
    assert not harder.is_repeat
    assert not harder.agreement.frequency.is_noise


# Other grids, missing modes


def test_a_missing_mode_is_reported_and_shifts_no_other(base, campaign):
    found = compare(base, campaign(14, "lacking", partial(silent, order=4)))
    assert [mode.name for mode in found.only_first] == ["n = 4"]
    assert found.only_first[0].reason == "not found in the other"
    assert not any(mode.frequency.is_significant for mode in found.modes)


def test_modes_outside_a_narrower_band_have_a_reason(base):
    modes = base.modal_model
    narrow = replace(modes, modes=modes.modes[:5], band_hz=(20.0, 180.0))
    found = compare(base, replace(base, modal_model=narrow))
    assert [mode.reason for mode in found.only_first] == [
        "outside the other's band, 20 to 180 Hz"
    ] * 3
    assert any("Different bands" in doubt for doubt in found.doubts)
    assert any("same recordings" in doubt for doubt in found.doubts)


def on_grid(result, position_deg):
    """The result as seen by sensors at other angles."""
    model = ring_modes(np.asarray(position_deg, dtype=float))
    return replace(result, modal_model=model)


def test_grids_with_enough_in_common_are_compared_there():
    first = tyre_result()
    found = compare(first, on_grid(first, np.arange(24) * 15.0))
    assert "the 24 positions that both results have" in found.shapes_note
    assert np.diag(found.mac) == pytest.approx(np.ones(7))


def test_grids_with_nothing_in_common_are_compared_order_by_order():
    first = tyre_result()
    found = compare(first, on_grid(first, 2.0 + np.arange(36) * 10.0))
    assert "orders 0 to 17" in found.shapes_note
    assert np.diag(found.mac) == pytest.approx(np.ones(7))
    assert [mode.name for mode in found.modes] == [f"n = {n}" for n in range(1, 8)]


def test_amplitudes_of_orders_have_the_mac_of_the_full_circle():
    random = np.random.default_rng(3)
    mixtures = random.normal(size=(2, 7, 7))
    grids = (np.arange(72) * 5.0, 2.0 + np.arange(60) * 6.0)
    models = []
    for mixture, angles in zip(mixtures, grids, strict=True):
        seen = ring_modes(angles)
        shapes = mixture @ waves(angles)
        modes = [replace(mode, residues=row) for mode, row in zip(seen.modes, shapes, strict=True)]
        models.append(replace(seen, modes=tuple(modes)))
    fine = waves(np.arange(720) * 0.5)
    expected = mac(mixtures[0] @ fine, mixtures[1] @ fine)
    assert common_shapes(*models)[0] == pytest.approx(expected, abs=1e-9)


def waves(angles_deg):
    """Cos nθ of orders 1 to 7, one row each."""
    return np.cos(np.deg2rad(np.outer(np.arange(1, 8), angles_deg)))


def test_positions_are_the_same_across_the_full_turn():
    here, there = common_positions(np.array([0.2, 90.0, 180.0]), np.array([359.9, 91.0, 180.3]))
    assert here.tolist() == [0, 2]
    assert there.tolist() == [0, 2]


def test_structures_go_by_their_nodes():
    found = compare(structure_result(), shifted(structure_result(), 1.02))
    assert "10 nodes" in found.shapes_note
    assert [mode.name for mode in found.modes] == [f"mode {n}" for n in range(1, 8)]
    assert found.parameters == ()
    assert [m.frequency.percent for m in found.modes] == pytest.approx([2.0] * 7)


def test_structures_without_common_nodes_go_by_frequency():
    first = structure_result()
    elsewhere = replace(first.modal_model, node=np.arange(101, 111))
    found = compare(first, replace(first, modal_model=elsewhere))
    assert np.isnan(found.mac).all()
    assert len(found.modes) == 7
    assert "not compared" in found.shapes_note


# Matching


def pair_mode(frequency_hz, orientation_deg, member, order=3):
    angle = np.deg2rad(order * (np.arange(72) * 5.0 - orientation_deg))
    pole = 2 * np.pi * frequency_hz * (1j - 0.02)
    return Mode(pole, 0.01, 1e-4, np.cos(angle) * 1e-3, np.full(72, 1e-6), order, member, 0.99)


def mac_of(first, second):
    return mac([mode.residues for mode in first], [mode.residues for mode in second])


def test_members_of_a_pair_go_by_their_shapes():
    first = (pair_mode(120.0, 10.0, "a"), pair_mode(121.0, 40.0, "b"))
    straight = (pair_mode(125.0, 12.0, "a"), pair_mode(126.0, 42.0, "b"))
    crossed = (pair_mode(120.4, 40.0, "a"), pair_mode(120.9, 10.0, "b"))
    assert match_modes(first, straight, mac_of(first, straight)) == [(0, 0), (1, 1)]
    assert match_modes(first, crossed, mac_of(first, crossed)) == [(0, 1), (1, 0)]


def test_a_single_mode_takes_the_member_of_its_shape():
    first = (pair_mode(120.0, 10.0, "a"), pair_mode(121.0, 40.0, "b"))
    second = (pair_mode(120.1, 37.0, ""),)
    assert match_modes(first, second, mac_of(first, second)) == [(1, 0)]


def test_a_tyre_turned_on_its_rim_is_matched_by_frequency():
    first = (pair_mode(120.0, 10.0, "a"), pair_mode(121.0, 40.0, "b"))
    turned = (pair_mode(120.9, 25.5, ""),)
    assert mac_of(first, turned)[:, 0] == pytest.approx([0.5, 0.5], abs=0.06)
    assert match_modes(first, turned, mac_of(first, turned)) == [(1, 0)]


def test_a_foreign_mode_needs_shape_and_frequency():
    cavity = replace(pair_mode(215.0, 0.0, "", order=1), order_purity=0.4)
    near = replace(cavity, pole=cavity.pole * 1.01)
    far = replace(cavity, pole=cavity.pole * 1.5)
    other = replace(near, residues=pair_mode(215.0, 0.0, "", order=6).residues)
    for second, expected in ((near, [(0, 0)]), (far, []), (other, [])):
        assert match_modes((cavity,), (second,), mac_of((cavity,), (second,))) == expected


def test_what_is_left_at_one_frequency_is_the_same_resonance():
    cavity = replace(pair_mode(215.0, 0.0, "", order=1), order_purity=0.4)
    other = replace(pair_mode(215.0, 0.0, "", order=6), order_purity=0.4)
    near = replace(other, pole=other.pole * 1.0001)
    apart = replace(other, pole=other.pole * 1.001)
    for second, expected in ((near, [(0, 0)]), (apart, [])):
        assert match_modes((cavity,), (second,), mac_of((cavity,), (second,))) == expected


# Significance


def test_holm_as_printed():
    # Holm (1979): the smallest of three is tripled, and none falls below one before it.
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.6, np.nan, 0.9]) == pytest.approx([1.0, np.nan, 1.0], nan_ok=True)
    assert holm([]).size == 0


def test_false_alarms_stay_below_the_level():
    random = np.random.default_rng(5)
    alarms = [
        any(each.is_significant for each in jointly_tested([Difference(0.0, z, 1.0) for z in row]))
        for row in random.normal(size=(2000, 16))
    ]
    assert np.mean(alarms) == pytest.approx(0.05, abs=0.015)


def test_unknown_error_bars_give_no_verdict():
    first = tyre_result()
    modes = tuple(
        replace(mode, frequency_std_hz=np.nan, damping_std=np.nan)
        for mode in first.modal_model.modes
    )
    second = replace(first, modal_model=replace(first.modal_model, modes=modes))
    found = compare(first, second)
    assert {mode.frequency.status for mode in found.modes} == {"σ unknown"}
    assert found.agreement is None
    assert any("σ is unknown for n = 1" in doubt for doubt in found.doubts)


def test_what_the_band_does_counts_where_bands_differ():
    alike = std_of_difference((3.0, 4.0), (12.0, 12.0), same_band=True)
    apart = std_of_difference((3.0, 0.0), (4.0, 12.0), same_band=False)
    assert (alike, apart) == (5.0, 13.0)
    assert std_of_difference((3.0, 4.0), (np.nan, 0.0), same_band=False) == 5.0


def test_a_common_shift_is_separated_from_scatter():
    moved = [Difference(f, 1.003 * f, 0.0001 * f) for f in (80.0, 100.0, 120.0)]
    found = agreement(moved, [])
    assert found.shift_percent == pytest.approx(0.3)
    assert found.frequency.ratio == pytest.approx(30.0)
    assert found.apart.ratio == pytest.approx(0.0, abs=1e-6)


# Doubts


def test_another_tyre_held_otherwise_is_doubtful():
    first = tyre_result(tyre=Tyre("225/55R17", 2.2e5, 0.33, 0.19, {"boundary": "fixed rim"}))
    second = tyre_result(tyre=Tyre("205/55R16", 2.2e5, 0.31, 0.19, {"boundary": "free"}))
    found = compare(first, second)
    assert any(
        doubt.startswith("Different tyres: 225/55R17 and 205/55R16") for doubt in found.doubts
    )
    assert any("fixed rim" in doubt for doubt in found.doubts)


def test_dates_are_no_condition_but_loads_are():
    def loaded(load, date):
        details = {"load_n": load, "date": date, "rim": "7.5J"}
        tyre = Tyre("225/55R17", 2.2e5, 0.33, 0.19, details)
        return tyre_result(tyre=tyre, provenance={})

    assert compare(loaded("4000", "2025-01-01"), loaded("4000.0", "2025-01-02")).is_repeat
    found = compare(loaded("4000", "2025-01-01"), loaded("5000", "2025-01-01"))
    assert [each.change for each in found.differing] == ["Load from 4000 N to 5000 N"]


def test_sensors_whose_mass_was_taken_off_once_are_doubtful(base, campaign):
    found = compare(base, campaign(11, "bare", sensor_mass_kg=0.002))
    assert any("mass of the sensors" in doubt for doubt in found.doubts)


def test_names_are_never_the_same():
    assert len(set(compare(tyre_result(), tyre_result()).names)) == 2


# Folders


def test_folders_give_what_results_give(base, repeat, tmp_path):
    save(base, tmp_path / "first", report=False)
    save(repeat.second, tmp_path / "second", report=False)
    found = compare_folders(tmp_path / "first", tmp_path / "second")
    for one, two in zip(found.modes, repeat.modes, strict=True):
        assert one.frequency.z == pytest.approx(two.frequency.z)
    assert [c.status for c in found.parameters] == [c.status for c in repeat.parameters]


def test_a_folder_that_is_no_result_is_refused(short_campaign):
    with pytest.raises(InputError, match=r"it must be a result folder.*ringmodal process"):
        compare_folders(short_campaign, short_campaign)


def test_a_pair_that_only_one_result_resolves_is_compared_by_its_mean(tmp_path):
    """Order n at f(1 ∓ 0.75 %): one mode in its place lies at f, as in the tyre without a split."""
    results = [
        process(simulate_campaign(tmp_path / name, seed=seed, split_percent=split))
        for name, seed, split in (("one", 5, 0.0), ("two", 6, 1.5))
    ]
    comparison = compare(*results)
    assert [mode.second.order for mode in comparison.modes] == list(range(1, 10))
    averaged = [mode for mode in comparison.modes if mode.averaged == (False, True)]
    assert len(averaged) >= 5  # the members of the others are not known well enough to be listed
    assert comparison.only_second == ()
    for mode in comparison.modes:
        assert abs(mode.frequency.percent) < 0.05
        assert mode.mac > 0.97
    assert any("Resolved as pairs in two only" in sentence for sentence in findings(comparison))
