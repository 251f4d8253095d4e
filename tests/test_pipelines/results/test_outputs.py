"""What others read of a result folder with their own tools: the numbers that were found."""

import tomllib

import numpy as np
import pandas as pd
import pytest
import pyuff

from pipelines.report.write import save

ULP = 4e-16  # pandas reads decimals to the last bit or so


@pytest.fixture(scope="module")
def folder(short_result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("outputs") / "result"
    save(short_result, folder, report=False)
    return folder


def assert_column(table, name, expected):
    """A column as pandas takes it in by default, against texts or numbers that may be missing."""
    found = table[name]
    expected = list(expected)
    assert len(found) == len(expected), name
    if any(isinstance(value, str) for value in expected):
        assert found.astype(object).where(found.notna(), "").tolist() == expected, name
    else:
        numbers = np.array([np.nan if value is None else value for value in expected], dtype=float)
        np.testing.assert_allclose(found.to_numpy(dtype=float), numbers, rtol=ULP, err_msg=name)


def test_pandas_reads_modes(folder, short_result):
    table = pd.read_csv(folder / "modes.csv")
    modes = short_result.modal_model.modes
    attributes = {
        "order": "order",
        "member": "member",
        "frequency_hz": "frequency_hz",
        "frequency_std_hz": "frequency_std_hz",
        "damping_ratio": "damping_ratio",
        "damping_ratio_std": "damping_std",
        "mpc": "mpc",
        "mpd_deg": "mpd_deg",
        "order_purity": "order_purity",
        "status": "status",
        "pair": "pair",
        "chosen": "chosen",
        "frequency_band_shift_hz": "frequency_band_shift_hz",
        "damping_ratio_band_shift": "damping_band_shift",
        "name": "common_name",
    }
    assert list(table.columns) == ["mode", *attributes]
    assert_column(table, "mode", range(1, len(modes) + 1))
    for column, attribute in attributes.items():
        assert_column(table, column, [getattr(mode, attribute) for mode in modes])


def test_pandas_reads_shapes(folder, short_result):
    table = pd.read_csv(folder / "shapes.csv")
    modes = short_result.modal_model.modes
    assert len(table) == sum(mode.shape.size for mode in modes)
    for number, rows in table.groupby("mode"):
        shape = modes[number - 1].shape
        np.testing.assert_array_equal(rows["position_deg"], short_result.frf.position_deg)
        np.testing.assert_allclose(rows["real"], shape.real, rtol=ULP)
        np.testing.assert_allclose(rows["imag"], shape.imag, rtol=ULP)


def test_pandas_reads_quality(folder, short_result):
    table = pd.read_csv(folder / "quality.csv")
    assert len(table) == len(short_result.findings) > 0
    for name in table.columns:
        assert_column(table, name, [getattr(each, name) for each in short_result.findings])


def test_pandas_reads_orders(folder, short_result):
    table = pd.read_csv(folder / "orders.csv")
    orders = short_result.modal_model.orders
    assert len(orders) > 0
    for name in ("order", "frequency_hz", "frequency_std_hz", "damping_ratio"):
        assert_column(table, name, [getattr(each, name) for each in orders])
    assert_column(table, "damping_ratio_std", [each.damping_std for each in orders])
    for name in ("verdict", "chance", "evidence"):
        assert_column(table, name, [getattr(each.pair, name) for each in orders])


def test_pandas_reads_the_validation(folder, short_result):
    table = pd.read_csv(folder / "validation.csv")
    found = short_result.validation
    for name in ("order", "measured_hz", "model_hz", "error_percent"):
        assert_column(table, name, getattr(found, name))
    assert_column(table, "measured_damping", found.measured_damping)
    assert_column(table, "model_damping", found.model_damping)
    assert_column(table, "mac", np.diag(found.mac))


def test_pandas_reads_the_frfs(folder, short_result):
    table, frf = pd.read_parquet(folder / "frf.parquet"), short_result.frf
    lines = frf.frequency_hz.size
    np.testing.assert_array_equal(table["frequency_hz"], np.tile(frf.frequency_hz, frf.n_positions))
    np.testing.assert_array_equal(table["position_deg"], np.repeat(frf.position_deg, lines))
    np.testing.assert_array_equal(table["real"], frf.values.real.ravel())
    np.testing.assert_array_equal(table["imag"], frf.values.imag.ravel())
    np.testing.assert_array_equal(table["coherence"], frf.coherence.ravel().astype("f4"))
    np.testing.assert_array_equal(table["std"], frf.std.ravel().astype("f4"))
    assert table["run"].tolist()[::lines] == list(frf.run)
    assert table["channel"].tolist()[::lines] == list(frf.channel)
    assert table["node"].tolist()[::lines] == frf.node.tolist()


def test_pandas_reads_the_poles(folder, short_result):
    table, diagram = pd.read_parquet(folder / "poles.parquet"), short_result.diagram
    np.testing.assert_array_equal(table["order"], diagram.model_order)
    for name in ("frequency_hz", "damping_ratio", "stable_frequency", "stable_damping", "cluster"):
        np.testing.assert_array_equal(table[name], getattr(diagram, name))


def test_pyuff_reads_the_frfs(folder, short_result):
    frf = short_result.frf
    sets = [each for each in pyuff.UFF(str(folder / "frf.uff")).read_sets() if each["type"] == 58]
    assert len(sets) == frf.n_positions
    for row, each in enumerate(sets):
        assert (each["func_type"], each["rsp_node"]) == (4, frf.node[row])
        assert (each["ordinate_spec_data_type"], each["orddenom_spec_data_type"]) == (12, 13)
        np.testing.assert_array_equal(each["data"], frf.values[row])
        # A step is printed with seven digits.
        np.testing.assert_allclose(each["x"], frf.frequency_hz, rtol=1e-6)


def test_tomllib_reads_the_parameter_set(folder, short_result):
    content = tomllib.loads((folder / "tyre.toml").read_text(encoding="utf-8"))
    tuning, damping = short_result.tuning, short_result.damping
    pressure = content["conditions"]["inflation_pressure_pa"]
    assert pressure == tuning.ring.inflation_pressure_pa
    for section, values, found in (
        ("ring", tuning.ring, tuning),
        ("damping", damping.damping, damping),
    ):
        for name, parameter in content[section].items():
            assert parameter["value"] == getattr(values, name)
            assert parameter["how"] == found.how.get(name, "given")
            std = found.std.get(name, np.nan)
            assert parameter.get("std") == (None if np.isnan(std) else std)
