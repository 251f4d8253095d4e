"""FRFs in text tables: parts, units, coherence, names, and what is refused."""

import h5py
import numpy as np
import pytest
import scipy.io

import ema
from ema.core.errors import RecordingFormatError
from ema.core.finding import Check
from ema.io.formats import read_file

LINES = np.arange(1, 41) * 0.5
FIRST = 1 / (9.0**2 - LINES**2 + 1.2j * LINES) * -(LINES**2)
SECOND = 0.5j * FIRST
OMEGA = 2 * np.pi * LINES


def read(tmp_path, header, *columns, separator=",", above="", frequency=LINES):
    cells = np.column_stack([frequency, *columns])
    body = [separator.join(f"{value:.12e}" for value in row) for row in cells]
    if separator == ";":
        body = [line.replace(".", ",") for line in body]
    (tmp_path / "a.csv").write_text("\n".join([above + header, *body, ""]), encoding="utf-8")
    return read_file(tmp_path / "a.csv")


def parts(values):
    return values.real, values.imag


def polar(values):
    return np.abs(values), np.rad2deg(np.angle(values))


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("Frequency (Hz),H1 Re (m/s²/N),H1 Im (m/s²/N)", parts(FIRST)),
        ("f [Hz],Re(H1) [(m/s^2)/N],Im(H1) [(m/s^2)/N]", parts(FIRST)),
        ("Frequenz;H1 Realteil [m/s^2/N];H1 Imaginärteil [m/s^2/N]", parts(FIRST)),
        ("f,H1_real [g/kN],H1_imag [g/kN]", parts(FIRST * 1e3 / 9.80665)),
        ("Frequency,H1 real (m/s²)/N,H1 imag (m/s²)/N", parts(FIRST)),
        ("f [Hz],H1 [real] [m/s^2/N],H1 [imag] [m/s^2/N]", parts(FIRST)),
        ("f [Hz],H1 Magnitude [m/s^2/N],H1 Phase [deg]", polar(FIRST)),
        ("f [Hz],|H1| mag [m/s^2/N],|H1| Phase", polar(FIRST)),
        ("f [Hz],H1 Betrag [m/s^2/N],H1 Phase [rad]", (np.abs(FIRST), np.angle(FIRST))),
        (
            "f [Hz],H1 mag [dB re 1 m/s^2/N],H1 phase [°]",
            (20 * np.log10(np.abs(FIRST)), polar(FIRST)[1]),
        ),
        ("f [Hz],H1 real [mm/s/N],H1 imag [mm/s/N]", parts(1e3 * FIRST / (1j * OMEGA))),
        ("f [Hz],H1 real [m/N],H1 imag [m/N]", parts(-FIRST / OMEGA**2)),
    ],
)
def test_parts_and_units(tmp_path, header, columns):
    content = read(tmp_path, header, *columns, separator=";" if ";" in header else ",")
    np.testing.assert_allclose(content.frf.frequency_hz, LINES, rtol=1e-12)
    np.testing.assert_allclose(content.frf.values, [FIRST], rtol=1e-9)
    assert content.frf_names[0].strip("|[] ") == "H1"


@pytest.mark.parametrize("unit", [("rad/s", 2 * np.pi), ("kHz", 1e-3), ("rpm", 60.0)])
def test_unit_of_the_frequencies(tmp_path, unit):
    header = f"Frequency [{unit[0]}],H1 real [m/s^2/N],H1 imag [m/s^2/N]"
    content = read(tmp_path, header, *parts(FIRST), frequency=LINES * unit[1])
    np.testing.assert_allclose(content.frf.frequency_hz, LINES, rtol=1e-9)


@pytest.mark.parametrize(
    "name", ["H1 -imag", "-Im(H1)", "H1 neg. imag", "conj(H1) imag", "H1 (-im)"]
)
def test_a_part_with_another_sign_is_refused(tmp_path, name):
    with pytest.raises(RecordingFormatError, match="sign in front"):
        read(tmp_path, f"f [Hz],H1 real [m/s^2/N],{name} [m/s^2/N]", *parts(FIRST))
    dash = read(tmp_path, "f [Hz],H1 - real [m/s^2/N],H1 - imag [m/s^2/N]", *parts(FIRST))
    np.testing.assert_allclose(dash.frf.values, [FIRST], rtol=1e-9)


@pytest.mark.parametrize(
    "above",
    [
        "X Axis Units\tHz\nMeasurement Label\tM#1\t\nY Axis Units\tg/N\t\nY Axis DOFs\t1Z:3Z\t\n",
        "Label\tM#1\tM#1\nY Axis Units\tg/N\tg/N\nY Axis DOFs\t1Z:3Z\t1Z:3Z\n",
    ],
)
def test_frfs_whose_columns_are_not_named_are_no_time_series(tmp_path, above):
    rows = "".join(f"{f}\t{h.real}\t{h.imag}\n" for f, h in zip(LINES, FIRST, strict=True))
    (tmp_path / "a.txt").write_text(above + rows)
    with pytest.raises(RecordingFormatError, match=r"behind .*frequencies"):
        read_file(tmp_path / "a.txt")


@pytest.mark.parametrize(
    "name", ["ω [1/s]", "omega", "Kreisfrequenz [1/s]", "Angular frequency", "freq_rad"]
)
def test_angular_frequencies(tmp_path, name):
    header = f"{name},H1 real [m/s^2/N],H1 imag [m/s^2/N]"
    content = read(tmp_path, header, *parts(FIRST), frequency=OMEGA)
    np.testing.assert_allclose(content.frf.frequency_hz, LINES, rtol=1e-9)


@pytest.mark.parametrize("decimals", [1, 2, 3])
def test_frequencies_of_few_decimals(tmp_path, decimals):
    """The first line is rounded like the others, and no better known."""
    lines = np.arange(1, 41) * 0.9765625
    header = "f [Hz],H1 real [m/s^2/N],H1 imag [m/s^2/N]"
    content = read(tmp_path, header, *parts(FIRST), frequency=lines.round(decimals))
    np.testing.assert_allclose(content.frf.frequency_hz, lines, atol=10.0**-decimals / 10)


def test_decibels_of_a_real_part_are_refused(tmp_path):
    with pytest.raises(RecordingFormatError, match="never in decibels"):
        read(tmp_path, "f [Hz],H1 real [dB re 1 g/N],H1 imag [dB re 1 g/N]", *parts(FIRST))


def test_units_in_a_row_of_their_own(tmp_path):
    header = "Frequency,H1 real,H1 imag\nHz,m/s^2/N,m/s^2/N"
    content = read(tmp_path, header, *parts(FIRST))
    np.testing.assert_allclose(content.frf.values, [FIRST], rtol=1e-9)


def test_several_with_coherence_and_nodes(tmp_path):
    names = ["Tire:13:+Z", "Tire:14:-Z"]
    header = ",".join(f"{name} real [g/N],{name} imag [g/N],{name} coherence" for name in names)
    share = np.full(len(LINES), 0.75)
    columns = (*parts(FIRST), share, *parts(SECOND), share / 2)
    content = read(tmp_path, f"Frequency [Hz],{header}", *columns)
    assert content.frf_names == tuple(names)
    assert content.frf.node.tolist() == [13, 14]
    assert content.frf.axis.tolist() == [3, 3]
    np.testing.assert_allclose(content.frf.values, [9.80665 * FIRST, -9.80665 * SECOND], rtol=1e-9)
    np.testing.assert_allclose(content.frf.coherence[:, 0], [0.75, 0.375])


def test_a_coherence_without_a_name_follows_its_frf(tmp_path):
    header = "f [Hz],A real [m/s^2/N],A imag [m/s^2/N],Coherence"
    content = read(tmp_path, header, *parts(FIRST), np.full(len(LINES), 0.5))
    assert np.all(content.frf.coherence == 0.5)


@pytest.mark.parametrize(
    "form", ["Tire:{}:+Z/Tire:{}:-Z", "{}Z:{}-Z", "{}:+Z / {}:-Z", "M#1 {}Z:{}-Z"]
)
def test_names_with_both_ends(tmp_path, form):
    def content(*ends):
        names = [form.format(*each) for each in ends]
        header = ",".join(f"{name} real [m/s^2/N],{name} imag [m/s^2/N]" for name in names)
        return read(tmp_path, f"f [Hz],{header}", *parts(FIRST), *parts(SECOND))

    for ends in (((13, 1), (14, 1)), ((1, 13), (1, 14)), ((13, 1), (13, 2))):
        found = content(*ends)
        assert found.frf.node.tolist() == [response for response, _ in ends]
        assert found.frf_forces == tuple((force, 3) for _, force in ends)
        np.testing.assert_allclose(found.frf.values, [-FIRST, -SECOND], rtol=1e-9)
    with pytest.raises(RecordingFormatError, match="the point of its force"):
        content((13, 1), (14, "A"))


def test_several_references_in_a_table(tmp_path):
    names = [f"{node}Z/{force}Z" for force in (1, 4) for node in (1, 2, 3)]
    header = ",".join(f"{name} real [m/s^2/N],{name} imag [m/s^2/N]" for name in names)
    columns = [part for k in range(6) for part in parts((k + 1) * FIRST)]
    read(tmp_path, f"f [Hz],{header}", *columns)
    frfs = ema.read_campaign(tmp_path).frf
    assert [frf.force_node for frf in frfs] == [1, 4]
    for frf, start in zip(frfs, (1, 4), strict=True):
        assert frf.node.tolist() == [1, 2, 3]
        expected = np.outer(np.arange(start, start + 3), FIRST)
        np.testing.assert_allclose(frf.values, expected, rtol=1e-9)


def test_coherences_behind_all_frfs_find_theirs(tmp_path):
    frfs = "FRF 1 real [g/N],FRF 1 imag [g/N],FRF 2 real [g/N],FRF 2 imag [g/N]"
    both = *parts(FIRST), *parts(SECOND)
    low, high = np.full((2, len(LINES)), [[0.5], [0.9]])
    found = read(tmp_path, f"f [Hz],{frfs},Coherence 2,Coherence 1", *both, high, low)
    np.testing.assert_array_equal(found.frf.coherence[:, 0], [0.5, 0.9])
    with pytest.raises(RecordingFormatError, match="'Coherence A'"):
        read(tmp_path, f"f [Hz],{frfs},Coherence A,Coherence B", *both, high, low)


def test_a_campaign_of_them(tmp_path):
    header = "f [Hz],A real [m/s^2/N],A imag [m/s^2/N],B real [m/s^2/N],B imag [m/s^2/N]"
    read(tmp_path, header, *parts(FIRST), *parts(SECOND))
    frf = ema.read_campaign(tmp_path).frf
    np.testing.assert_allclose(frf.values, [FIRST, SECOND], rtol=1e-9)


@pytest.mark.parametrize(
    ("header", "columns", "patterns"),
    [
        ("f [Hz],H1 Magnitude [m/s^2/N]", [np.abs(FIRST)], ("'H1'", "no phase")),
        ("f [Hz],H1 real [m/s^2/N]", [FIRST.real], ("'H1'", "no imaginary")),
        ("f [Hz],H1 real [V/N],H1 imag [V/N]", parts(FIRST), ("unit 'V/N'",)),
        ("f [Hz],H1 real [g/N],H1 imag [m/s^2/N]", parts(FIRST), ("'H1 imag'", "'g/N'")),
        (
            "f [Hz],H1 mag [g/N],H1 phase",
            (np.abs(FIRST), np.angle(FIRST)),
            ("'H1 phase'", "deg or rad"),
        ),
        (
            "f [Hz],H1 mag [g/N],H1 phase",
            (np.abs(FIRST), np.linspace(0, -30, 40)),  # rad, not wrapped
            ("'H1 phase'", "deg or rad"),
        ),
        ("f [Hz],H1 [m/s^2/N],H2 [m/s^2/N]", parts(FIRST), ("'H1'", "part of an FRF")),
        (
            "f [Hz],H real [g/N],H imag [g/N],coherence",
            (*parts(FIRST), np.full(40, 1.7)),
            ("'coherence'", "1.7"),
        ),
    ],
)
def test_what_is_refused(tmp_path, header, columns, patterns):
    with pytest.raises(RecordingFormatError) as caught:
        read(tmp_path, header, *columns)
    assert [each for each in patterns if each not in str(caught.value)] == []


def test_uneven_frequencies_are_refused(tmp_path):
    lines = np.geomspace(1, 50, len(LINES))
    with pytest.raises(RecordingFormatError, match="frequency goes from"):
        read(tmp_path, "f [Hz],H real [g/N],H imag [g/N]", *parts(FIRST), frequency=lines)


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("f [Hz],H1 real,H1 imag", parts(FIRST / (2j * np.pi * LINES) * 1e3)),
        (
            "f [Hz],H1 mag [dB],H1 phase [deg]",
            (20 * np.log10(np.abs(FIRST / OMEGA * 1e3)), np.rad2deg(np.angle(FIRST / 1j))),
        ),
    ],
)
def test_the_manifest_states_the_unit_of_frfs_without(tmp_path, header, columns):
    read(tmp_path, header, *columns)
    with pytest.raises(RecordingFormatError, match=r"no unit.*frf_unit"):
        ema.read_campaign(tmp_path / "a.csv")
    manifest = tmp_path / "campaign.toml"
    state = 'schema = 1\n[acquisition]\nfrf_unit = "{}"\n[[runs]]\nfile = "a.csv"\n'
    manifest.write_text(state.format("(mm/s)/N"), encoding="utf-8")
    campaign = ema.read_campaign(tmp_path)
    np.testing.assert_allclose(campaign.frf.values, [FIRST], rtol=1e-9)
    assert all(each.is_ok for each in campaign.findings if each.check == Check.UNIT)
    manifest.write_text(state.format("volts"), encoding="utf-8")
    with pytest.raises(RecordingFormatError, match=r"acquisition\.frf_unit"):
        ema.read_campaign(tmp_path)


def mat(path, values):
    scipy.io.savemat(path, values)


def mat_73(path, values):
    with h5py.File(path, "w") as file:
        for name, array in values.items():
            stored = np.atleast_2d(array).T
            if np.iscomplexobj(stored):
                parts = np.empty(stored.shape, [("real", "f8"), ("imag", "f8")])
                parts["real"], parts["imag"] = stored.real, stored.imag
                stored = parts
            file[name] = stored
            file[name].attrs["MATLAB_class"] = np.bytes_("double")


def hdf5(path, values):
    with h5py.File(path, "w") as file:
        for name, array in values.items():
            file[name] = array


@pytest.mark.parametrize(("write", "ending"), [(mat, "mat"), (mat_73, "mat"), (hdf5, "h5")])
@pytest.mark.parametrize(
    "values",
    [
        {"frequency": LINES, "H1": FIRST, "H2": SECOND},
        {"f": LINES, "H": np.column_stack([FIRST, SECOND])},
        {
            "f_Hz": LINES,
            "H1_real": FIRST.real,
            "H1_imag": FIRST.imag,
            "H2_mag": np.abs(SECOND),
            "H2_phase": np.rad2deg(np.angle(SECOND)),
        },
    ],
)
def test_frfs_in_matlab_and_hdf5_with_the_unit_of_the_manifest(tmp_path, write, ending, values):
    write(tmp_path / f"a.{ending}", values)
    with pytest.raises(RecordingFormatError, match="frf_unit"):
        ema.read_campaign(tmp_path)
    text = 'schema = 1\n[acquisition]\nfrf_unit = "(m/s^2)/N"\n[[runs]]\nfile = "a.{}"\n'
    (tmp_path / "campaign.toml").write_text(text.format(ending))
    frf = ema.read_campaign(tmp_path).frf
    np.testing.assert_allclose(frf.frequency_hz, LINES)
    np.testing.assert_allclose(frf.values, [FIRST, SECOND], rtol=1e-9)


@pytest.mark.parametrize(("write", "ending"), [(mat, "mat"), (mat_73, "mat"), (hdf5, "h5")])
def test_a_matrix_of_coherences_beside_that_of_frfs(tmp_path, write, ending):
    values, share = np.column_stack([FIRST, SECOND]), np.linspace(0, 1, 80).reshape(40, 2)
    write(tmp_path / f"a.{ending}", {"coherence": share, "f": LINES, "H": values})
    frf = read_file(tmp_path / f"a.{ending}").frf
    np.testing.assert_allclose(frf.values, values.T, rtol=1e-12)
    np.testing.assert_array_equal(frf.coherence, share.T)
    matrices = {"H_imag": values.imag, "f": LINES, "H_real": values.real}
    write(tmp_path / f"a.{ending}", matrices)
    np.testing.assert_allclose(read_file(tmp_path / f"a.{ending}").frf.values, values.T, rtol=1e-12)


def test_frequencies_and_values_must_be_as_many(tmp_path):
    mat(tmp_path / "a.mat", {"f": LINES, "H": FIRST[1:]})
    with pytest.raises(RecordingFormatError, match="40 frequencies, 39 values of 'H'"):
        read_file(tmp_path / "a.mat")


def test_a_force_called_f_is_no_frequency(tmp_path):
    noise = np.random.default_rng(1).standard_normal((2, 64))
    mat(tmp_path / "a.mat", {"f": noise[0], "A": noise[1], "H": noise[0] + 1j, "fs": 512.0})
    content = read_file(tmp_path / "a.mat")
    assert content.recording.names == ("f", "A")
    assert any("complex" in each.detail for each in content.findings)


@pytest.mark.parametrize(
    ("axis", "factor"),
    [
        ("omega", 2 * np.pi),
        ("omega_rad_s", 2 * np.pi),
        ("f_kHz", 1e-3),
        ("Hz", 1.0),
        ("w", 2 * np.pi),
    ],
)
def test_units_in_the_name_of_frequencies(tmp_path, axis, factor):
    header = f"{axis},H1 real [m/s^2/N],H1 imag [m/s^2/N]"
    content = read(tmp_path, header, *parts(FIRST), frequency=LINES * factor)
    np.testing.assert_allclose(content.frf.frequency_hz, LINES, rtol=1e-9)
    scipy.io.savemat(tmp_path / "a.mat", {axis.replace("/", "_"): LINES * factor, "H": FIRST})
    found = read_file(tmp_path / "a.mat").frf.frequency_hz
    np.testing.assert_allclose(found, LINES, rtol=1e-9)


@pytest.mark.parametrize("axis", ["Order", "X-Axis", "Speed [m/s]"])
def test_frfs_over_something_else_are_refused(tmp_path, axis):
    header = f"{axis},H1 real [m/s^2/N],H1 imag [m/s^2/N]"
    with pytest.raises(RecordingFormatError, match="Frequency"):
        read(tmp_path, header, *parts(FIRST))


def test_complex_cells_are_named(tmp_path):
    rows = "\n".join(f"{line},{value:.6g}" for line, value in zip(LINES, FIRST, strict=True))
    (tmp_path / "a.csv").write_text(f"Frequency [Hz],H1 [m/s^2/N]\n{rows}\n")
    with pytest.raises(RecordingFormatError, match="complex"):
        read_file(tmp_path / "a.csv")


def test_a_frequency_called_otherwise_is_no_time(tmp_path):
    rows = "".join(f"{4 + k / 50},{k % 7}\n" for k in range(60))
    (tmp_path / "a.csv").write_text(f"Frequency - Acc_0,Amplitude - Acc_0\n{rows}")
    with pytest.raises(RecordingFormatError, match="no phase"):
        read_file(tmp_path / "a.csv")
