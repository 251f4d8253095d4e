"""Results for Excel: workbooks with numbers as numbers, and CSV with decimal commas."""

import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from results import structure_result, tyre_result

from ema.core.errors import InputError
from ema.core.finding import Check, Finding, Verdict
from pipelines.export.data import write_workbook
from pipelines.export.modal import export
from pipelines.report.write import save

openpyxl = pytest.importorskip("openpyxl", reason="workbooks need pip install openpyxl")
HOSTILE = '=HYPERLINK("http://x")\x1b'
LIBREOFFICE = shutil.which("soffice")


@pytest.fixture(scope="module")
def result():
    return tyre_result()


@pytest.fixture(scope="module")
def folder(result, tmp_path_factory):
    found = tmp_path_factory.mktemp("excel") / "result"
    save(result, found, report=False, xlsx=True)
    return found


@pytest.fixture(scope="module")
def book(folder):
    return openpyxl.load_workbook(folder / "result.xlsx")


def test_numbers_are_numbers_with_units_and_formats(book, result):
    sheet = book["Modes"]
    head = [cell.value for cell in sheet[1]]
    assert {"frequency [Hz]", "damping ratio", "MPC", "mpd [°]"} <= set(head)
    frequency, damping = head.index("frequency [Hz]"), head.index("damping ratio")
    found = [row[frequency].value for row in sheet.iter_rows(min_row=2)]
    np.testing.assert_allclose(found, result.modal_model.frequencies_hz, rtol=1e-15)
    assert sheet[2][frequency].number_format == "0.000"
    assert sheet[2][damping].number_format == "0.000%"
    assert sheet.freeze_panes == "A2"
    assert book["Shapes"].freeze_panes == "B2"


def test_the_ring_has_its_units_and_deviations(book, folder):
    rows = {row[0]: row[1:] for row in book["Ring"].values}
    assert rows["parameter"] == (
        "symbol",
        "unit",
        "value",
        "std (in the same unit)",
        "how obtained",
    )
    assert rows["inflation pressure"][1:3] == ("Pa", 220000)
    assert isinstance(rows["radial stiffness"][2], float)


def test_verdict_notes_and_findings_are_there(book, result):
    texts = [str(value) for row in book["Summary"].values for value in row]
    assert result.notes[0] in texts
    assert any(each.startswith("Verdict") for each in texts)
    warned = next(each.detail for each in result.findings if not each.is_ok)
    assert warned in {value for row in book["Findings"].values for value in row}


def test_no_text_becomes_a_formula(result, tmp_path):
    finding = Finding(HOSTILE, HOSTILE, None, Check.LEVEL, Verdict.WARNING, HOSTILE)
    hostile = replace(result, name=HOSTILE, findings=(finding,), notes=(HOSTILE,))
    write_workbook(tmp_path / "a.xlsx", hostile)
    cells = [
        cell
        for sheet in openpyxl.load_workbook(tmp_path / "a.xlsx")
        for row in sheet.iter_rows()
        for cell in row
    ]
    assert any("HYPERLINK" in str(cell.value) for cell in cells)
    assert not [cell.value for cell in cells if cell.data_type == "f"]


def test_an_unknown_number_is_an_empty_cell(tmp_path):
    write_workbook(tmp_path / "a.xlsx", structure_result())
    book = openpyxl.load_workbook(tmp_path / "a.xlsx")
    assert "Ring" not in book.sheetnames
    purity = [cell.value for cell in book["Modes"][1]].index("order purity")
    assert book["Modes"][2][purity].value is None
    assert book["Shapes"]["A1"].value == "node"


def test_an_export_has_the_frfs_as_well(folder, tmp_path):
    export(folder, tmp_path / "a.xlsx", frfs="measured")
    book = openpyxl.load_workbook(tmp_path / "a.xlsx")
    assert "Ring" in book.sheetnames
    head = [cell.value for cell in book["FRF measured, real"][1]]
    assert head[0] == "frequency [Hz]"
    assert head[1].endswith("[(m/s²)/N]")


def test_without_the_library_it_is_named(result, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(InputError, match="pip install openpyxl"):
        write_workbook(tmp_path / "a.xlsx", result)


def test_csv_with_decimal_commas_is_what_excel_reads_in_german(folder, tmp_path, result):
    export(folder, tmp_path / "a", "csv", decimal_comma=True, frfs="none")
    raw = (tmp_path / "a" / "modes.csv").read_bytes()
    assert raw.startswith(b"\xef\xbb\xbfmode;order;")
    table = pd.read_csv(tmp_path / "a" / "modes.csv", sep=";", decimal=",")
    np.testing.assert_allclose(table["frequency_hz"], result.modal_model.frequencies_hz, rtol=1e-15)
    with pytest.raises(InputError, match="only CSV"):
        export(folder, tmp_path / "a.mat", decimal_comma=True)


@pytest.mark.skipif(LIBREOFFICE is None, reason="LibreOffice is not installed")
def test_libreoffice_reads_the_numbers(folder, tmp_path, result):
    profile = f"-env:UserInstallation=file://{tmp_path / 'profile'}"
    # Sheet 2 as CSV with all digits: tokens of the filter for CSV.
    kind = "csv:Text - txt - csv (StarCalc):44,34,76,1,,0,false,false,false,false,false,2"
    command = [LIBREOFFICE, profile, "--headless", "--convert-to", kind, "--outdir", str(tmp_path)]
    subprocess.run(
        [*command, str(folder / "result.xlsx")], check=True, capture_output=True, timeout=120
    )
    (written,) = tmp_path.glob("result*.csv")
    table = pd.read_csv(written)
    found = table["frequency [Hz]"].to_numpy(float)
    np.testing.assert_allclose(found, result.modal_model.frequencies_hz, rtol=1e-12)
