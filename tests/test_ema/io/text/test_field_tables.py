"""Tables as they come from the field: typeset signs, thousands, text below, folders of text."""

import unicodedata

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import ema
from ema.core.errors import RecordingFormatError
from ema.io.formats import read_file

ROWS = [(0.0, 1234.5, -2.5), (0.5, -12345.25, 3.0), (1.0, 7.0, 1234567.5)]


def read(tmp_path, text, encoding="utf-8"):
    (tmp_path / "a.csv").write_bytes(text.encode(encoding))
    return read_file(tmp_path / "a.csv")


def check(found):
    samples = [channel.samples for channel in found.recording.channels]
    np.testing.assert_array_equal(np.transpose(samples), np.array(ROWS)[:, 1:])


def table(form, separator=";", below=""):
    lines = [separator.join(form(value) for value in row) for row in ROWS]
    return "\n".join([f"time [s]{separator}F [N]{separator}A [g]", *lines, below])


def german(value):
    return f"{value:,.2f}".translate(str.maketrans(",.", ".,"))


@pytest.mark.parametrize(
    ("form", "separator"),
    [
        (german, ";"),
        (german, "\t"),
        ("{:,.2f}".format, ";"),
        ("{:,.2f}".format, "\t"),
        ('"{:,.2f}"'.format, ","),
    ],
)
def test_thousands_before_decimals(tmp_path, form, separator):
    check(read(tmp_path, table(form, separator)))


@pytest.mark.parametrize("sign", ["\u2212"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_minus_as_typeset(tmp_path, sign, encoding):
    check(read(tmp_path, table(lambda value: f"{value:.2f}".replace("-", sign)), encoding))


@pytest.mark.parametrize("blank", ["\u00a0", "\u202f"])
def test_hard_blanks(tmp_path, blank):
    found = read(tmp_path, table("{:.2f}".format).replace(";", f"{blank};{blank}"))
    check(found)
    assert found.recording.names == ("F", "A")


def test_hard_blanks_in_cp1252(tmp_path):
    check(read(tmp_path, table("{:.2f}".format).replace(";", "\u00a0;"), "cp1252"))


@pytest.mark.parametrize(
    "below",
    [
        "End of data\n",
        "Max;7;8\nMin;1;2\nMean;3;4\n",
        "\nChecked by: Mia\nfooter;;\n",
        "Max;1234,5",
        "# end",
        "*** end ***",
        "-----",
    ],
)
def test_text_below_the_numbers(tmp_path, below):
    found = read(tmp_path, table("{:.2f}".format, below=below))
    check(found)
    (detail,) = (each.detail for each in found.findings if each.check == "ignored")
    assert "below the numbers" in detail
    assert "line " in detail


def test_numbers_below_text_are_refused(tmp_path):
    with pytest.raises(RecordingFormatError, match="line 5"):
        read(tmp_path, table("{:.2f}".format, below="Block 2\n1.5;2;3\n2;3;4\n"))


def test_a_table_of_results_alone_is_named(tmp_path):
    (tmp_path / "modes.csv").write_text("mode,order,member,frequency_hz,status\n1,2,,90.0,ok\n")
    pq.write_table(
        pa.table({key: [1.0] for key in ("run", "frequency_hz", "real", "imag")}),
        tmp_path / "frf.parquet",
    )
    for name in ("modes.csv", "frf.parquet"):
        with pytest.raises(RecordingFormatError, match="result folder"):
            ema.read_campaign(tmp_path / name)


@pytest.mark.parametrize("form", ["NFC", "NFD"])
def test_umlauts_are_composed(tmp_path, form):
    text = unicodedata.normalize(form, "time [s];Prüfkraft [N];A [g]\n0;1;2\n1;2;3\n")
    assert read(tmp_path, text).recording.names == ("Prüfkraft", "A")


def test_point_ids_give_nodes_axes_and_senses(tmp_path):
    text = "time [s];Hub:1:+Z [N];Tire:13:+Z [g];Tire:14:-X [g];A15 [g]\n0;1;2;3;4\n1;2;3;4;5\n"
    channels = read(tmp_path, text).recording.channels
    assert [each.node for each in channels] == [1, 13, 14, None]
    assert [each.axis for each in channels] == [3, 3, 1, 0]
    np.testing.assert_allclose([c.block(0, 1)[0] / 9.80665 for c in channels[1:]], [2, -3, 4])


def _run(path, encoding):
    noise = np.random.default_rng(6).standard_normal((64, 2))
    lines = [f"{k / 500}\t{a}\t{b}" for k, (a, b) in enumerate(noise.tolist())]
    path.write_text("\n".join(["time [s]\tF [N]\tA01 [g]", *lines, ""]), encoding=encoding)


def test_a_folder_of_unicode_text(tmp_path):
    _run(tmp_path / "run_1.txt", "utf-16")
    _run(tmp_path / "run_2.asc", "utf-8")
    (tmp_path / "notes.txt").write_text("Tyre 4711, measured by Mia")
    with pytest.raises(RecordingFormatError, match="it is run_1"):
        _run(tmp_path / "run_2.asc", "utf-16")
        ema.read_campaign(tmp_path)
    (tmp_path / "run_2.asc").unlink()
    assert [run.name for run in ema.read_campaign(tmp_path).runs] == ["run_1.txt"]


def test_a_folder_of_results_is_named(tmp_path):
    _run(tmp_path / "modes.csv", "utf-8")
    (tmp_path / "provenance.json").write_text("{}")
    with pytest.raises(RecordingFormatError, match="folder of results"):
        ema.read_campaign(tmp_path)


@pytest.mark.parametrize("form", ["NFC", "NFD"])
@pytest.mark.parametrize("quotes", ['""', "“”", "„“", "«»", "‘’"])
def test_manifest_of_a_word_processor(tmp_path, form, quotes):
    header = unicodedata.normalize("NFD", "time [s]\tPrüfkraft\tA01 [g]")
    _run(tmp_path / "a.csv", "utf-8")
    text = (tmp_path / "a.csv").read_text(encoding="utf-8").partition("\n")[2]
    (tmp_path / "a.csv").write_text(f"{header}\n{text}", encoding="utf-8")
    manifest = 'schema = 1\n[calibration]\nPrüf = {unit = "N"}\n[[runs]]\nfile = "a.csv"\n'
    manifest = manifest.replace("Prüf", '"Prüfkraft"')
    for word in ("Prüfkraft", "N", "a.csv"):
        manifest = manifest.replace(f'"{word}"', f"{quotes[0]}{word}{quotes[1]}")
    manifest = unicodedata.normalize(form, manifest)
    (tmp_path / "campaign.toml").write_text(manifest, encoding="utf-8")
    assert ema.read_campaign(tmp_path).runs[0].force.name == "Prüfkraft"
