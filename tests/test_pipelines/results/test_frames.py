"""Tables: the numbers of the objects, and files with the same digits, from columns or pandas."""

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from pipelines.storage.tables import (
    plain_rows,
    repeating,
    typed,
    write_csv,
    write_parquet,
    write_table,
)


def test_modes_are_a_table(short_result):
    model = short_result.modal_model
    table = model.to_frame()
    assert table["mode"].tolist() == list(range(1, len(model.modes) + 1))
    assert table["frequency_hz"].tolist() == model.frequencies_hz.tolist()
    assert table["damping_ratio_std"].tolist() == [mode.damping_std for mode in model.modes]
    orders = [None if pd.isna(order) else int(order) for order in table["order"]]
    assert orders == [mode.order for mode in model.modes]
    assert pd.api.types.is_integer_dtype(table["order"].dtype)


def test_poles_are_a_table(short_result):
    diagram = short_result.diagram
    table = diagram.to_frame()
    assert len(table) == diagram.poles.size
    np.testing.assert_array_equal(table["frequency_hz"], np.abs(diagram.poles) / (2 * np.pi))
    assert table["stable_damping"].dtype == bool


def test_parameters_are_a_table(short_result):
    tuning = short_result.tuning
    table = tuning.to_frame().set_index("parameter")
    row = table.loc["radial_stiffness_n_m3"]
    assert row["value"] == tuning.ring.radial_stiffness_n_m3
    assert row["how"] == tuning.how["radial_stiffness_n_m3"]
    known = table["std"].dropna()
    assert known.to_dict() == {name: tuning.std[name] for name in known.index}
    assert table.loc["mean_radius_m", "how"] == "given"


def test_checks_are_a_table(short_result):
    table = short_result.to_frame()
    assert table["check"].tolist() == [finding.check for finding in short_result.findings]


def test_a_table_shares_no_memory_with_the_frfs(short_result):
    frf = short_result.frf
    table = frf.to_frame()
    table.loc[0, "std"] = -1.0
    assert frf.std[0, 0] != -1.0


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_no_modes_are_a_table_with_columns(short_result, tmp_path, ending):
    table = dict.fromkeys(short_result.modal_model.to_columns(), ())
    write_table(tmp_path / f"modes.{ending}", table)
    read = {"csv": pd.read_csv, "parquet": pd.read_parquet}[ending](tmp_path / f"modes.{ending}")
    assert list(read) == list(table)
    assert read.empty


def test_csv_keeps_every_digit_and_whole_numbers(tmp_path):
    bits = np.random.default_rng(5).integers(0, 2**63, 5000, dtype=np.int64)
    values = bits.view(np.float64)
    values = values[np.isfinite(values)]
    write_csv(tmp_path / "a.csv", {"x": values})
    cells = (tmp_path / "a.csv").read_text(encoding="utf-8").split()[1:]
    assert cells == [repr(value) for value in values.tolist()]
    rows = [(1, None, 0.1 + 0.2), (None, float("nan"), 3)]
    write_csv(tmp_path / "b.csv", dict(zip("abc", zip(*rows, strict=True), strict=True)))
    content = (tmp_path / "b.csv").read_text(encoding="utf-8")
    assert content == "a,b,c\n1,,0.30000000000000004\n,,3\n"


def test_a_decimal_comma_changes_numbers_alone(tmp_path):
    table = {"x": np.array([0.5, np.nan]), "n": [1, None], "text": ["1.5", "a;b"]}
    write_csv(tmp_path / "a.csv", table, decimal_comma=True)
    content = (tmp_path / "a.csv").read_text(encoding="utf-8-sig")
    assert content == 'x;n;text\n0,5;1;1.5\n;;"a;b"\n'


def test_columns_in_parquet_are_read_by_pandas(tmp_path):
    columns = {
        "x": np.array([[1.0, 9.0], [2.0, 9.0]])[:, 0],  # not side by side in memory
        "stable": np.array([True, False]),
        "row": np.arange(2, dtype=np.int32),
        "order": [1, None],
    }
    write_parquet(tmp_path / "a.parquet", columns | {"run": repeating(np.array([1, 0]), "äb")})
    read = pd.read_parquet(tmp_path / "a.parquet")
    assert read.drop(columns="order").to_dict("list") == {
        **{"x": [1.0, 2.0], "stable": [True, False], "row": [0, 1], "run": ["b", "ä"]}
    }
    assert read["order"].isna().tolist() == [False, True]


def test_texts_in_csv_are_inert(tmp_path):
    table = {"=head": ["=1+1", "plain, quoted"], "n": [1.0, float("nan")]}
    write_csv(tmp_path / "a.csv", table)
    content = (tmp_path / "a.csv").read_text(encoding="utf-8")
    assert content == "'=head,n\n'=1+1,1.0\n\"plain, quoted\",\n"


def test_parquet_tells_not_a_number_from_missing(tmp_path):
    rows = [{"n": 1, "text": "a", "y": float("nan")}, {}]
    table = {
        "x": [1.0, float("nan")],
        **typed(rows, {"n": "int32", "text": "string", "y": "float64"}),
        "run": repeating(np.array([1, 0]), "ab"),
    }
    write_parquet(tmp_path / "a.parquet", table, {"note": "N"})
    read = pq.read_table(tmp_path / "a.parquet")
    assert read.column("x").null_count == 0
    assert np.isnan(read.column("x")[1].as_py())
    assert read.select(["n", "text", "y", "run"]).to_pylist() == [
        {"n": 1, "text": "a", "y": None, "run": "b"},
        {"n": None, "text": None, "y": None, "run": "a"},
    ]
    assert [str(field.type) for field in read.schema][:3] == ["double", "int32", "string"]
    assert read.schema.metadata == {b"note": b"N"}


def test_plain_rows_hold_python_values():
    table = {"n": [1, None], "x": np.array([float("nan"), 2.5])}
    assert plain_rows(table) == [(1, None), (None, 2.5)]
    assert {type(cell) for row in plain_rows(table) for cell in row} == {int, float, type(None)}
