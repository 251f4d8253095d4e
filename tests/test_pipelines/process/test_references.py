"""A campaign with two forces, from FRFs to the result folder and back."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import ema
import ringmodal as rm
from ema.core.campaign import Campaign, Processing
from ema.core.edits import Edit, EditKind, PoleName
from ema.core.finding import Check, Verdict
from ema.core.frf import FRF
from ema.core.references import References
from pipelines.export.modal import export
from pipelines.simulate.truth import TruthMode, modal_sum

LINES_HZ = np.arange(1, 801) / 4
RING = ((1, 79.0), (2, 100.0), (3, 121.0))


@pytest.fixture(scope="module")
def result():
    angles, omega = np.arange(0.0, 360.0, 30.0), 2 * np.pi * LINES_HZ
    modes = [
        TruthMode(n, member, hz * (1 + sign * 0.004), 0.025, 4.0, 20.0 * n + turn)
        for n, hz in RING
        for member, sign, turn in (("a", -1, 0.0), ("b", 1, 90.0 / n))
    ]
    frfs, rng = [], np.random.default_rng(0)
    for force_deg in (0.0, 13.0):
        system = modal_sum((*modes, TruthMode(4, "", 146.0, 0.02, 4.0, 0.0)), angles, force_deg)
        exact = np.array([system.inertance(row, omega) for row in range(angles.size)])
        noise = 1e-3 * rng.standard_normal((2, *exact.shape))
        values, std = exact + noise[0] + 1j * noise[1], np.full(exact.shape, 1e-3)
        nodes = np.arange(angles.size)
        frf = FRF.from_arrays(LINES_HZ, values, angles_deg=angles, nodes=nodes, std=std)
        names = tuple(f"A{node + 1}" for node in nodes)
        frfs.append(replace(frf, excitation_deg=force_deg, channel=names))
    campaign = Campaign(
        name="two forces",
        frf=References(tuple(frfs)),
        positions=12,
        excitation_deg=0.0,
        processing=Processing(band_hz=(60.0, 135.0)),
    )
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(ema, "read_campaign", lambda source: campaign)
        patched.setattr(ema, "estimate_frf", lambda campaign, *args, **how: campaign.frf)
        return rm.process("campaign")


def test_tables_say_what_each_force_contributes(result, tmp_path):
    rm.save(result, tmp_path / "result")
    table = pd.read_csv(tmp_path / "result" / "references.csv", keep_default_na=False)
    assert sorted(set(table["position_deg"])) == [0.0, 13.0]
    assert len(table) == 2 * len(result.modal_model.modes)
    pairs = table[table["member"] != ""].groupby(["reference", "order"])["share"].sum()
    assert np.allclose(pairs, 1.0)
    assert np.allclose(table.groupby("mode")["drive"].max(), 1.0)
    frfs = pd.read_parquet(tmp_path / "result" / "frf.parquet")
    assert frfs.groupby("reference")["row"].nunique().to_list() == [12, 12]
    orders = pd.read_csv(tmp_path / "result" / "orders.csv")
    away = orders["order"] * np.deg2rad(orders["antinode_deg"] - 20.0 * orders["order"])
    assert np.allclose(np.sin(away), 0.0, atol=0.05)  # modulo 180°/n
    assert "What each force contributes" in (tmp_path / "result" / "report.html").read_text()


def test_a_result_of_several_forces_is_read_back_and_refitted(result, tmp_path):
    rm.save(result, tmp_path / "result", report=False)
    back = rm.load(tmp_path / "result")
    assert back.references == result.references
    for there, here in zip(back.frfs, result.frfs, strict=True):
        assert np.array_equal(there.values, here.values)
        assert there.excitation_deg == here.excitation_deg
    aside = Edit(EditKind.SET_ASIDE, PoleName(result.modal_model.modes[-1].frequency_hz))
    again = rm.refit(tmp_path / "result", [aside])
    rest = [mode.pole for mode in result.modal_model.modes[:-1]]
    assert [mode.pole for mode in again.modal_model.modes] == rest
    assert {each.reference for each in again.references} == {1, 2}
    assert [mode.pole for mode in rm.refit(again, []).modal_model.modes][:-1] == rest


def test_an_frf_is_left_out_against_one_of_the_forces(result, tmp_path, ringmodal):
    rm.save(result, tmp_path / "result", report=False)
    command = "refit", tmp_path / "result", "--reference", "2", "--no-report"
    code, _, error = ringmodal(*command, "--channel-out", "A4", "--out", tmp_path / "without")
    assert code == 0, error
    edited = rm.load(tmp_path / "without")
    assert [edit.channel.reference for edit in edited.edits] == [2]
    left_out = [each for each in edited.findings if each.check is Check.BY_HAND]
    assert [each.channel for each in left_out] == ["A4"]
    code, _, _ = ringmodal(*command, "--set-aside", "79.3")  # a mode is one of all forces
    assert code == 2


def test_forces_of_a_result_are_read_back_from_its_universal_file(result, tmp_path):
    rm.save(result, tmp_path / "result", report=False)
    manifest = 'schema = 1\n[grid]\npositions = 12\n[[runs]]\nfile = "result/frf.uff"\n'
    (tmp_path / "campaign.toml").write_text(manifest)
    back = rm.read_campaign(tmp_path).frf
    assert [frf.excitation_deg for frf in back] == [0.0, 13.0]
    for there, here in zip(back, result.frfs, strict=True):
        np.testing.assert_allclose(there.values, here.values, rtol=1e-12)


def test_exports_hold_the_frfs_of_all_forces(result, tmp_path):
    rm.save(result, tmp_path / "result", report=False)
    export(tmp_path / "result", tmp_path / "both.uff", frfs="measured")
    back = rm.read_campaign(tmp_path / "both.uff").frf
    assert [frf.force_node for frf in back] == [1, 13]
    for there, here in zip(back, result.frfs, strict=True):
        np.testing.assert_allclose(there.values, here.values, rtol=1e-12)
    export(tmp_path / "result", tmp_path / "both.json")
    held = json.loads((tmp_path / "both.json").read_text())
    assert held["references"]["position_deg"] == [0.0, 13.0]
    assert held["references"]["node"] == [1, 13]
    parts = (held["measured_2"]["frf"], held["synthesised_2"]["frf"])
    measured, fitted = (np.array(each["real"]) + 1j * np.array(each["imag"]) for each in parts)
    assert np.sqrt(np.mean(np.abs(measured - fitted) ** 2)) < 2e-3  # the noise of 1e-3
    driven = held["references"]["participation"]
    sizes = np.hypot(driven["real"], driven["imag"])
    assert np.allclose(sizes.max(axis=1), 1.0)
    tables = export(tmp_path / "result", tmp_path / "both", "csv").path
    assert pd.read_csv(tables / "references.csv")["reference"].nunique() == 2
    assert pd.read_csv(tables / "frf_measured_2.csv").shape[1] == 25


def test_a_mass_that_came_with_the_second_force_is_named(tmp_path):
    kind = {"duration_s": 4.0, "snr_db": 40.0, "split_percent": 1.0, "force_deg": (0.0, 22.5)}
    folder = rm.simulate_campaign(tmp_path / "bare", **kind)
    heavy = rm.simulate_campaign(tmp_path / "heavy", sensor_mass_kg=0.02, **kind)
    for number in range(7, 13):
        (heavy / f"config_{number}.uff").replace(folder / f"config_{number}.uff")
    options = rm.Options(tune=False, processing=Processing(band_hz=(60.0, 160.0)))
    found = rm.process(folder, options)
    told = [each for each in found.findings if each.check is Check.RECIPROCITY]
    assert [each.verdict for each in told] == [Verdict.WARNING]


@pytest.fixture(scope="module")
def plate_result():
    """A square plate that nobody calls a circle, hit at two points; forces along Z."""
    grid = (np.arange(5) + 0.5) / 5
    waves = np.sin(np.pi * np.outer([1, 2], grid))
    shapes = np.array([np.outer(a, b).ravel() for a in waves for b in waves])
    own = 2 * np.pi * np.array([20.0, 50.0, 50.0, 80.0])[:, None]
    omega, frfs, rng = 2 * np.pi * LINES_HZ, [], np.random.default_rng(0)
    for row in (6, 9):
        answers = -(omega**2) / (own**2 - omega**2 + 0.02j * own * omega) / 3.0
        exact = (shapes * shapes[:, row, None]).T @ answers
        noise = 1e-3 * rng.standard_normal((2, *exact.shape))
        std = np.full(exact.shape, 1e-3)
        nodes = np.arange(101, 126)
        frf = FRF.from_arrays(LINES_HZ, exact + noise[0] + 1j * noise[1], nodes=nodes, std=std)
        axis = np.full(nodes.size, 3)
        frfs.append(replace(frf, force_node=101 + row, force_axis=3, axis=axis))
    campaign = Campaign(
        name="plate",
        frf=References(tuple(frfs)),
        positions=None,
        excitation_deg=None,
        processing=Processing(band_hz=(10.0, 100.0)),
    )
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(ema, "read_campaign", lambda source: campaign)
        patched.setattr(ema, "estimate_frf", lambda campaign, *args, **how: campaign.frf)
        return rm.process("campaign")


def test_a_structure_without_a_circle_has_tables_of_all_its_forces(plate_result, tmp_path):
    folder = tmp_path / "result"
    rm.save(plate_result, folder)
    modes = pd.read_csv(folder / "modes.csv")
    assert np.allclose(modes["frequency_hz"], [20.0, 50.0, 50.0, 80.0], rtol=1e-4)
    largest = np.array([1.0, np.sin(2 * np.pi * 0.3) ** 2])
    assert np.allclose(modes["modal_mass_kg"].iloc[[0, 3]], 3.0 / largest**2, rtol=0.01)
    table = pd.read_csv(folder / "references.csv")
    assert sorted(set(table["node"])) == [107, 110]
    size = np.hypot(table["participation_real"], table["participation_imag"])
    assert np.allclose(size, table["drive"], rtol=1e-6)
    back = rm.load(folder)
    for there, here in zip(back.references, plate_result.references, strict=True):
        assert (there.node, there.mode) == (here.node, here.mode)
        assert there.participation == here.participation
    assert np.array_equal(back.diagram.cmif, plate_result.diagram.cmif)
    assert np.array_equal(back.diagram.mif, plate_result.diagram.mif)
    masses = [mode.modal_mass_kg for mode in back.modal_model.modes]
    assert masses == [mode.modal_mass_kg for mode in plate_result.modal_model.modes]


def test_modal_masses_are_in_the_shapes_of_a_universal_file(plate_result, tmp_path):
    folder = tmp_path / "result"
    rm.save(plate_result, folder, report=False)
    written = export(folder, tmp_path / "modes.uff")
    masses = [mode.modal_mass_kg for mode in plate_result.modal_model.modes]
    assert np.allclose(written.export.modal_mass_kg, masses, rtol=1e-12)
    assert rm.read_shapes(tmp_path / "modes.uff").n_modes == 4
