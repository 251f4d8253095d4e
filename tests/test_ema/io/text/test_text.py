"""Tables as programs export them: what stands above the numbers, encodings, time, large files."""

import gzip

import numpy as np
import pytest

import ema
from ema.core.errors import RecordingFormatError
from ema.core.units import parse_unit
from ema.io.formats import is_recording
from ema.io.text.csv import read as read_text

POINT = "0;1.5;2\n0.0005;-1e-3;3\n0.001;0.25;-4.5\n"
COMMA = POINT.replace(".", ",")
NAMES = "time;A01;force\n"
HEADER = "time [s];A01 [g];force [kN]\n"


def content(tmp_path, text, name="a.csv", encoding="utf-8"):
    path = tmp_path / name
    raw = text.encode(encoding)
    path.write_bytes(gzip.compress(raw) if name.endswith(".gz") else raw)
    return read_text(path)


def samples(found):
    return [channel.samples.tolist() for channel in found.recording.channels]


def checks(found):
    return [(each.channel, each.check) for each in found.findings]


def assert_is_the_table(found):
    recording = found.recording
    assert recording.names == ("A01", "force")
    assert [channel.unit for channel in recording.channels] == ["g", "kN"]
    assert recording.sampling_rate_hz == 2000.0
    assert samples(found) == [[1.5, -1e-3, 0.25], [2.0, 3.0, -4.5]]
    assert found.findings == ()


@pytest.mark.parametrize(
    "text",
    [
        HEADER + COMMA,
        (HEADER + POINT).replace(";", "|"),
        (HEADER + COMMA).replace(";", "\t"),
        (HEADER + POINT).replace(";", " , "),
        (HEADER + '"' + COMMA.replace(";", '";"').replace("\n", '"\n"')[:-1]).replace(";", ","),
        (HEADER + POINT.replace("\n0", "\n  0")).replace(";", "   "),
        (HEADER + COMMA).replace(";", " \t "),
        NAMES + "s;g;kN\n" + COMMA,
        NAMES + "[s];[g];[kN]\n" + POINT,
        NAMES + ";g;kN\n" + POINT,
        NAMES + "s;g;kN\nfloat;float;float\n" + POINT,
        NAMES + "s;g;kN\n;;\n----;----;----\n" + POINT,
        "Time (s);A01 (g);force (kN)\n" + POINT,
        "Zeit / s;A01 / g;force / kN\n" + COMMA,
        "Time [seconds];A01 [g];force [kN]\n" + COMMA,
        '"Time\n[s]";"A01\r\n[g]";"force [kN]"\n' + COMMA,
        "# " + HEADER + POINT,
        "#" + HEADER + POINT,
        "Lab 7\nOperator;Domen;Berlin\nTyre;12\n\n" + HEADER + COMMA,
        'Rim: 17" x 7\n"Sidewall' + "\n" + HEADER + COMMA,
        "sep=;\n" + HEADER + COMMA,
        "note\n" * 190 + HEADER + COMMA,
        HEADER + COMMA + "\n\n\x1a",
        HEADER + POINT.replace("e-3", "D-03"),
    ],
)
def test_one_table_in_many_forms(tmp_path, text):
    assert_is_the_table(content(tmp_path, text))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz", "a.txt", "a.TSV.gz"])
def test_encodings_line_ends_and_packing(tmp_path, encoding, end, name):
    text = HEADER.replace("A01 [g]", "Prüfkraft [m/s²]") + COMMA
    found = content(tmp_path, text.replace("\n", end), name, encoding)
    assert found.recording.names == ("Prüfkraft", "force")
    assert found.recording.channels[0].quantity == "acceleration"
    assert samples(found) == [[1.5, -1e-3, 0.25], [2.0, 3.0, -4.5]]


def test_utf_16_big_endian(tmp_path):
    assert_is_the_table(content(tmp_path, "\ufeff" + HEADER + COMMA, encoding="utf-16-be"))


def test_common_endings_are_read_where_named_alone(tmp_path):
    assert is_recording(tmp_path / "a.csv.gz")
    assert not is_recording(tmp_path / "readme.txt")


@pytest.mark.parametrize(
    ("line", "rate_hz"),
    [
        ("Sampling rate [Hz];2000", 2000.0),
        ("Sample rate: 2 kHz", 2000.0),
        ("SAMPLING FREQUENCY = 51200 Hz", 51200.0),
        ("# fs = 25.6 kHz", 25600.0),
        ("Abtastrate;2000,5;Hz", 2000.5),
        ('"Samplerate";"2000"', 2000.0),
        ("dt = 0.0005", 2000.0),
        ("dt [ms];0,5;", 2000.0),
        ("Delta_X\t1.52588E-05", 65536.0),
        ("Time step: 20 µs", 50000.0),
        ("Sampling interval (s),0.001", 1000.0),
    ],
)
def test_stated_rates(tmp_path, line, rate_hz):
    found = content(tmp_path, line + "\nforce [N];A01 [g]\n1;2\n3;4\n")
    assert found.recording.sampling_rate_hz == rate_hz
    assert samples(found) == [[1.0, 3.0], [2.0, 4.0]]


@pytest.mark.parametrize(
    "line",
    ["Sampling rate: 2,000 Hz", "Sampling rate: high", "Sampled by: 7", "dt = 0", "rate 3 rpm"],
)
def test_what_states_no_rate_clearly_states_none(tmp_path, line):
    found = content(tmp_path, line + "\nforce [N];A01 [g]\n1.5;2\n3;4\n")
    assert np.isnan(found.recording.sampling_rate_hz)


def test_a_stated_rate_agrees_with_the_time(tmp_path):
    assert_is_the_table(content(tmp_path, "Sampling rate: 2 kHz\n" + HEADER + POINT))
    with pytest.raises(RecordingFormatError, match="1000 Hz by Sampling rate, 2000 Hz"):
        content(tmp_path, "Sampling rate: 1 kHz\n" + HEADER + POINT)
    with pytest.raises(RecordingFormatError, match=r"line 2: 500 Hz, and 2000 Hz in line 1"):
        content(tmp_path, "fs: 2000\nfs: 500\n" + HEADER + POINT)


@pytest.mark.parametrize(
    ("heading", "stamps"),
    [
        ("Time", ["23:59:58.000", "23:59:58.001", "23:59:58.002"]),
        ("Uhrzeit", ["10:18:21,109", "10:18:21,110", "10:18:21,111"]),
        (
            "timestamp",
            ["2018-12-31T23:59:59.999", "2019-01-01T00:00:00", "2019-01-01 00:00:00.001"],
        ),
        (
            "t",
            ["2018/12/17 10:18:21.0000Z", "2018/12/17 10:18:21.0010Z", "2018/12/17 10:18:21.002Z"],
        ),
        *(
            ("Time", [each.format(k) for k in range(3)])
            for each in (
                "Mon, 31-Dec-2018 23:59:59.00{} UTC+1",
                "Montag, 31. Dezember 2018 23:59:59.00{}",
                "2018-12-31T23:59:59.00{}+01:00[Europe/Berlin]",
                "Dec 31, 2018 11:59:59.00{} PM America/New_York",
                "Sa 31.12.2018 23:59:59,00{}",
            )
        ),
    ],
)
def test_time_stamps(tmp_path, heading, stamps):
    rows = "".join(f"{stamp};{k},5\n" for k, stamp in enumerate(stamps))
    found = content(tmp_path, f"{heading};A01 [g]\n{rows}")
    assert found.recording.sampling_rate_hz == 1000.0
    assert found.recording.names == ("A01",)
    assert samples(found) == [[0.5, 1.5, 2.5]]


def test_time_stamps_beside_a_time_are_left_out(tmp_path):
    found = content(tmp_path, "clock,t,a\n10:00:00,0,1\n10:00:00,0.5,2\n")
    assert found.recording.names == ("a",)
    assert found.recording.sampling_rate_hz == 2.0
    assert checks(found) == [("clock", "ignored")]


def test_missing_samples_are_nan_and_counted(tmp_path):
    found = content(tmp_path, "t,a,b\n0,1,2\n1,,NaN\n2,#N/A, - \n3,-,5\n4,1e999,#WERT!\n")
    a, b = (channel.samples for channel in found.recording.channels)
    np.testing.assert_array_equal(a, [1.0, np.nan, np.nan, np.nan, np.nan])
    np.testing.assert_array_equal(b, [2.0, np.nan, np.nan, 5.0, np.nan])
    assert checks(found) == [("a", "missing samples"), ("b", "missing samples")]
    assert found.findings[0].detail == "4 of 5 samples are missing, the first in row 2"
    assert found.findings[1].detail == "3 of 5 samples are missing, the first in row 2"


def test_a_missing_first_row_is_a_row(tmp_path):
    found = content(tmp_path, "a,b\nNaN,NaN\n1,2\n")
    np.testing.assert_array_equal(samples(found), [[np.nan, 1.0], [np.nan, 2.0]])


def test_an_empty_line_of_a_single_column_is_a_missing_sample(tmp_path):
    found = content(tmp_path, "a\n1,5\n\n3\n\n\n")
    np.testing.assert_array_equal(samples(found), [[1.5, np.nan, 3.0]])


def test_columns_without_numbers_or_names(tmp_path):
    found = content(tmp_path, ",a,comment,b,\n7,1,,2,\n8,3,,4,\n")
    assert found.recording.names == ("a", "b")
    assert samples(found) == [[1.0, 3.0], [2.0, 4.0]]
    assert checks(found) == [("comment", "ignored"), ("", "ignored")]


@pytest.mark.parametrize(("step", "hz"), [(1 / 512, 512.0), (1, np.nan)])
def test_an_index_without_a_name_is_an_axis(tmp_path, step, hz):
    rows = "".join(f"{step * k},{k % 7},{k % 5}\n" for k in range(40))
    found = content(tmp_path, f",force [N],A01 [m·s⁻²]\n{rows}").recording
    assert [each.quantity for each in found.channels] == ["force", "acceleration"]
    np.testing.assert_equal(found.sampling_rate_hz, hz)


def test_names_may_be_numbers_beside_a_time(tmp_path):
    found = content(tmp_path, "t;1;2\n0;5;6\n1;7;8\n")
    assert found.recording.names == ("1", "2")


def test_names_that_occur_twice_are_kept(tmp_path):
    assert content(tmp_path, "a [g],a [g]\n1,2\n").recording.names == ("a", "a")


def test_parentheses_that_hold_no_unit_belong_to_the_name(tmp_path):
    assert content(tmp_path, "A01 (left)\n1\n").recording.names == ("A01 (left)",)


def test_decimal_commas_behind_many_integers(tmp_path):
    found = content(tmp_path, "a;b\n" + "1;2\n" * 50 + "1,5;2\n")
    assert samples(found)[0][-2:] == [1.0, 1.5]


def test_ten_thousand_columns(tmp_path):
    n = 10_000
    header = ",".join(f"A{k:05d} [m/s^2]" for k in range(n))
    rows = "".join(",".join(f"{row}.{k}" for k in range(n)) + "\n" for row in range(3))
    recording = content(tmp_path, f"{header}\n{rows}").recording
    assert len(recording.channels) == n
    assert recording.names[-1] == "A09999"
    assert recording.channels[-1].samples.tolist() == [0.9999, 1.9999, 2.9999]


@pytest.fixture(scope="module")
def long_table():
    values = np.random.default_rng(5).standard_normal((60_000, 3)).round(7)
    values[:, 0] = np.arange(60_000) / 2000.0
    return values


@pytest.mark.parametrize(
    ("name", "encoding", "end"),
    [("a.csv", "utf-8", "\n"), ("a.csv", "utf-16", "\r\n"), ("a.csv.gz", "latin-1", "\r")],
)
def test_long_files_are_read_to_the_last_bit(tmp_path, long_table, name, encoding, end):
    rows = "".join(f"{t!r};{a!r};{b!r}\n" for t, a, b in long_table.tolist())
    text = (HEADER + rows.replace(".", ",")).replace("\n", end)
    found = content(tmp_path, text, name, encoding)
    assert found.recording.sampling_rate_hz == 2000.0
    np.testing.assert_array_equal(samples(found), long_table[:, 1:].T)


def test_short_numbers_are_exact_in_whatever_precision_they_are_kept(tmp_path):
    rows = "1,2\n" * 200_000 + "0.1,3\n" + "5,6\n" * 3
    a, b = content(tmp_path, "a,b\n" + rows).recording.channels
    assert b.samples.dtype == np.float32  # half the memory, and whole numbers this small are exact
    assert a.samples[-5:].tolist() == [1.0, 0.1, 5.0, 5.0, 5.0]
    assert b.samples[-5:].tolist() == [2.0, 3.0, 6.0, 6.0, 6.0]
    assert len(a.samples) == 200_004


def test_a_campaign_from_a_european_table(tmp_path):
    time = np.arange(64) / 2000.0
    force, acceleration = np.sin(300.0 * time), np.cos(300.0 * time)
    rows = "".join(
        f"{t!r};{f!r};{a!r}\r\n"
        for t, f, a in zip(time.tolist(), force.tolist(), acceleration.tolist(), strict=True)
    )
    text = "Prüfstand 3\r\n\r\nZeit;Kraft;A01\r\ns;kN;m/s²\r\n" + rows.replace(".", ",")
    path = tmp_path / "lauf.csv"
    path.write_bytes(text.encode("utf-16"))
    (run,) = ema.read_campaign(path).runs
    assert run.force.name == "Kraft"
    assert run.recording.sampling_rate_hz == 2000.0
    assert [response.channel.name for response in run.responses] == ["A01"]
    np.testing.assert_array_equal(run.force.block(0, 64), force * 1e3)
    np.testing.assert_array_equal(run.responses[0].channel.block(0, 64), acceleration)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        *(("acc_g", "g"), ("A01_m_s2", "m/s^2"), ("A01 mg", "mg"), ("Beschl. in g", "g")),
        *(("a01_mm/s²", "mm/s²"), ("ForceN", "N"), ("Kraft_kN", "kN"), ("vel_mm_s", "mm/s")),
        *(("load_mV", "mV"), ("hammer_lbf", "lbf")),
        *(("sensor_A", ""), ("node_g", ""), ("acc_N", ""), ("acc_V", ""), ("A01", "")),
        *(("beam 120 mm", ""), ("A_5_kN", ""), ("A01_mm", "mm")),
    ],
)
def test_units_at_the_end_of_names(tmp_path, name, unit):
    (channel,) = content(tmp_path, f"fs = 512\n{name}\n1\n2\n").recording.channels
    assert channel.name == name
    assert parse_unit(channel.unit) == parse_unit(unit)


_ROWS_ABOVE = [
    "X0,0.0,0.03125,\nDelta_X,0.001953125,0.001953125,\nY_Unit_Label,N,g\n,force,A01\n,",
    "Unit,N,g\nX0,0.0,0.03125\nDelta_X,0.001953125,0.001953125\nforce,A01\n",
    "Offset,0.1,0.2\nTime,10:00:00.0,10:00:00.03125\nUnits:,N,g\nfs = 512\nforce,A01\n",
]


@pytest.mark.parametrize("head", _ROWS_ABOVE)
def test_rows_above_a_table_state_starts_steps_and_units(tmp_path, head):
    head, _, first = head.rpartition("\n")
    rows = "".join(f"{first}{k},{-k}\n" for k in range(1, 41))
    found = content(tmp_path, f"{head}\n{rows}").recording
    force, sensor = found.channels
    assert (found.sampling_rate_hz, force.unit, sensor.unit) == (512.0, "N", "g")
    np.testing.assert_array_equal(force.samples, np.arange(17, 41))
    np.testing.assert_array_equal(sensor.samples, -np.arange(1.0, 25.0))


@pytest.mark.parametrize("above", ["s,N,g", "X unit,s,s\nY unit,N,g"])
def test_units_above_the_names(tmp_path, above):
    rows = "".join(f"{k / 512},{k},{-k}\n" for k in range(40))
    found = content(tmp_path, f"{above}\nTime,force,A01\n{rows}").recording
    assert [(each.name, each.unit) for each in found.channels] == [("force", "N"), ("A01", "g")]
    assert found.sampling_rate_hz == 512.0


@pytest.mark.parametrize(
    "below",
    [
        "MX840 CH1,MX840 CH2,MX840 CH3",
        "Zeit,Kraft,A01\ndt=1.95 ms,dt=1.95 ms,dt=1.95 ms\n,S1-1,S1-2",
    ],
)
def test_names_with_units_stand_above_lines_about_hardware(tmp_path, below):
    rows = "".join(f"{k / 512},{k},{-k}\n" for k in range(40))
    head = "Zeit 1 - Standardrate [s],Kraft [N],A01 [g]"
    found = content(tmp_path, f"HBM CATMAN\n\n{head}\n{below}\n{rows}").recording
    assert [(each.name, each.unit) for each in found.channels] == [("Kraft", "N"), ("A01", "g")]
    assert found.sampling_rate_hz == 512.0


def test_names_with_units_count_only_where_the_lines_below_have_none(tmp_path):
    rows = "".join(f"{k / 512},{k},{-k}\n" for k in range(40))
    head = "Time [s],other [V],other [V]\nTime [s],force [N],A01 [g]"
    found = content(tmp_path, f"{head}\n{rows}").recording
    assert [(each.name, each.unit) for each in found.channels] == [("force", "N"), ("A01", "g")]


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("X0,0,0.002", "1.02.* samples; channels must start together"),
        ("X0,0,0,0.5", "line 1: 3 values of 'X0' above 2 columns"),
        ("Start time,morning,noon", "line 1: .*starts of channels must be"),
        ("Time,10:00:00,10:00:00.0013", "0.6656 samples"),
        ("Delta_X,0.001,0.002", "steps 0.001, 0.002 in line 1"),
    ],
)
def test_rows_above_a_table_that_do_not_fit(tmp_path, row, message):
    with pytest.raises(RecordingFormatError, match=message):
        content(tmp_path, f"{row}\nfs = 512\nforce,A01\n" + "1,2\n" * 40)
