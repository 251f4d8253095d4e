"""Names, files and columns that users and other programs rely on."""

import csv
import json
import tomllib

import numpy as np
import pyarrow.parquet as pq
import pytest
import pyuff

import ema
import model

TABLES = {
    "modes.csv": "mode, order, member, frequency_hz, frequency_std_hz, damping_ratio, "
    "damping_ratio_std, mpc, mpd_deg, order_purity, status",
    "shapes.csv": "mode, position_deg, real, imag",
    "quality.csv": "run, channel, position_deg, check, verdict, detail",
    "corrections.csv": "row, run, channel, position_deg, check, factor, source_row, excluded, "
    "gain, gain_std, mismatch_std",
    "validation.csv": "order, measured_hz, model_hz, error_percent, measured_damping, "
    "model_damping, mac",
}
COLUMNS = {
    "frf.parquet": "position_deg, frequency_hz, real, imag, coherence, run",
    "poles.parquet": "order, frequency_hz, damping_ratio, stable_frequency, stable_damping, "
    "cluster",
}
OTHERS = ("frf.uff", "tyre.toml", "report.html", "provenance.json")
RING = (
    "mean_radius_m",
    "belt_width_m",
    "mass_per_area_kg_m2",
    "radial_stiffness_n_m3",
    "circumferential_stiffness_n_m3",
    "axial_stiffness_n_m",
    "bending_stiffness_n_m",
)
DAMPING = ("radial_n_s_m3", "circumferential_n_s_m3", "loss_factor")
HOW = {"given", "identified", "not identified", "at bound"}


def rows(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("name", [*TABLES, *COLUMNS, *OTHERS])
def test_every_file_is_there(sample_folder, name):
    assert (sample_folder / name).stat().st_size > 0


@pytest.mark.parametrize("name", TABLES)
def test_tables_have_their_columns(sample_folder, name):
    with (sample_folder / name).open(encoding="utf-8") as file:
        header = file.readline().strip().split(",")
    promised = TABLES[name].split(", ")
    assert header[: len(promised)] == promised


@pytest.mark.parametrize("name", COLUMNS)
def test_parquet_files_have_their_columns(sample_folder, name):
    assert set(COLUMNS[name].split(", ")) <= set(pq.read_schema(sample_folder / name).names)


def test_modes_are_numbered_and_their_numbers_are_whole(sample_folder, sample_result):
    table = rows(sample_folder / "modes.csv")
    assert [row["mode"] for row in table] == [str(n) for n in range(1, len(table) + 1)]
    for row, mode in zip(table, sample_result.modal_model.modes, strict=True):
        assert float(row["frequency_hz"]) == mode.frequency_hz
        assert float(row["damping_ratio"]) == mode.damping_ratio
        assert float(row["damping_ratio_std"]) == mode.damping_std
        assert int(row["order"]) == mode.order
        assert row["member"] in ("", "a", "b")


def test_shapes_hold_every_position_of_every_mode(sample_folder, sample_result):
    table = rows(sample_folder / "shapes.csv")
    modes = sample_result.modal_model.modes
    assert len(table) == 72 * len(modes)
    first = [complex(float(row["real"]), float(row["imag"])) for row in table[:72]]
    np.testing.assert_array_equal(first, modes[0].shape)
    assert [float(row["position_deg"]) for row in table[:72]] == list(np.arange(72) * 5.0)


def test_quality_has_three_verdicts(sample_folder):
    table = rows(sample_folder / "quality.csv")
    assert {row["verdict"] for row in table} <= {"ok", "warning", "excluded"}
    assert sum(row["check"] == "coherence" for row in table) == 72
    assert sum(row["check"] == "reference" for row in table) == 1


def test_the_frf_table_is_the_frf(sample_folder, sample_result):
    table = pq.read_table(sample_folder / "frf.parquet").to_pandas()
    frf = sample_result.frf
    assert len(table) == frf.values.size
    node_20 = table[table["position_deg"] == 100.0]
    np.testing.assert_array_equal(node_20["frequency_hz"], frf.frequency_hz)
    np.testing.assert_array_equal(node_20["real"] + 1j * node_20["imag"], frf.values[20])
    assert set(node_20["run"]) == {frf.run[20]}


def test_the_universal_file_is_read_by_others(sample_folder, sample_result):
    file = pyuff.UFF(str(sample_folder / "frf.uff"))
    types = file.get_set_types()
    frf = sample_result.frf
    assert np.sum(types == 58) == 72
    functions = [file.read_sets(int(k)) for k in np.flatnonzero(types == 58)[[0, 20]]]
    for function, row in zip(functions, (0, 20), strict=True):
        assert function["func_type"] == 4
        np.testing.assert_allclose(function["x"][1], frf.frequency_hz[1], rtol=1e-6)
        np.testing.assert_allclose(function["data"], frf.values[row], rtol=1e-6)


def test_the_parameter_set_says_how_each_value_was_obtained(sample_folder):
    content = tomllib.loads((sample_folder / "tyre.toml").read_text(encoding="utf-8"))
    assert content["schema"] == 1
    assert content["designation"] == "225/55R17"
    assert content["conditions"]["inflation_pressure_pa"] == 220000.0
    assert set(content["ring"]) == set(RING)
    assert set(content["damping"]) == set(DAMPING)
    for parameter in (*content["ring"].values(), *content["damping"].values()):
        assert parameter["how"] in HOW
        assert isinstance(parameter["value"], float)
    assert "ringmodal" in content["provenance"]["software"]


def test_validation_compares_order_by_order(sample_folder):
    table = rows(sample_folder / "validation.csv")
    assert [int(row["order"]) for row in table][:7] == [1, 2, 3, 4, 5, 6, 7]
    for row in table:
        error = 100 * (float(row["model_hz"]) / float(row["measured_hz"]) - 1)
        assert float(row["error_percent"]) == pytest.approx(error, abs=1e-9)


def test_provenance_names_versions_inputs_options_warnings_and_times(sample_folder):
    content = json.loads((sample_folder / "provenance.json").read_text(encoding="utf-8"))
    assert {"software", "inputs", "options", "warnings", "stage_seconds"} <= set(content)
    assert {"ringmodal", "numpy", "scipy"} <= set(content["software"])
    assert all(len(entry["sha256"]) == 64 for entry in content["inputs"])
    assert len(content["inputs"]) == 7


def test_the_report_is_one_file_that_needs_no_network(sample_folder):
    page = (sample_folder / "report.html").read_text(encoding="utf-8")
    assert page.lstrip().lower().startswith("<!doctype html>")
    for reference in ('src="http', "src='http", 'rel="stylesheet"', "@import", "url(http"):
        assert reference not in page


def test_the_example_for_python_works(short_campaign):
    campaign = ema.read_campaign(short_campaign)
    frf = ema.estimate_frf(campaign)
    assert frf.values.shape == (72, frf.frequency_hz.size)
    diagram = ema.build_stability(frf, band_hz=(20, 260))
    modes = ema.fit_modes(frf, ema.select_poles(diagram)).modes[:7]
    ring = model.tune_ring(
        [mode.order for mode in modes],
        [mode.frequency_hz for mode in modes],
        mean_radius_m=0.33,
        inflation_pressure_pa=2.2e5,
    )
    assert np.max(np.abs(ring.model_hz / [mode.frequency_hz for mode in modes] - 1)) < 0.01
