"""Text and other files in the layouts that programs document, as docs/recordings.md lists them."""

import numpy as np
import pytest

from ema.core.errors import InputError
from ema.io.formats import read_file

N, RATE_HZ = 400, 2000.0
TIME_S = np.arange(N) / RATE_HZ
FORCE, A01 = np.random.default_rng(0).normal(size=(2, N))
LINES = np.arange(1.0, 101.0)
FRF = np.exp(0.1j * LINES)


def table(*columns, separator="\t", decimal="."):
    rows = (separator.join(f"{value:.6f}" for value in row) for row in zip(*columns, strict=True))
    return "".join(f"{row}\n" for row in rows).replace(".", decimal)


RUN = table(TIME_S, FORCE, A01)
FILES = {
    "dewesoft.txt": "Data info\nFile name: a.dxd\nStart time: 11/28/2026 10:00:00.000\nNumber of "
    f"channels: 2\nSample rate: 2000 Hz\n\nTime (s)\tForce (N)\tA01 (m/s2)\n{RUN}",
    "testlab.txt": "Time\tForce\tTime\tA01\ns\tN\ts\tm/s^2\n" + table(TIME_S, FORCE, TIME_S, A01),
    "imc.txt": "Zeit\tKraft\tA01\ns\tN\tm/s²\n" + table(TIME_S, FORCE, A01, decimal=","),
    "diadem.csv": '"Zeit [s]";"Kraft [N]";"A01 [m/s²]"\n'
    + table(TIME_S, FORCE, A01, separator=";", decimal=","),
    "oros.txt": "NVGate\nSampling frequency: 2000 Hz\nTime (s);Force (N);A01 (m/s²)\n"
    + table(TIME_S, FORCE, A01, separator=";"),
    "mp.asc": f"Title: run 1\nSample rate [Hz]: 2000\nTime [s]\tForce [N]\tA01 [m/s^2]\n{RUN}",
    "head.asc": f"// ArtemiS SUITE\n// 2 channels\nTime [s]\tForce [N]\tA01 [m/s^2]\n{RUN}",
}


@pytest.mark.parametrize("name", FILES)
def test_recordings(tmp_path, name):
    (tmp_path / name).write_text(FILES[name], encoding="cp1252")
    found = read_file(tmp_path / name)
    assert found.findings == ()
    assert found.recording.sampling_rate_hz == RATE_HZ
    channels = found.recording.channels
    assert [each.quantity for each in channels] == ["force", "acceleration"]
    for channel, samples in zip(channels, (FORCE, A01), strict=True):
        np.testing.assert_allclose(channel.block(0, N), samples, atol=6e-7)


@pytest.mark.parametrize(
    ("heading", "power"),
    [
        (
            "Frequency (Hz)\tM#1 1Z:1Z Real ((m/s^2)/N)\tM#1 1Z:1Z Imaginary ((m/s^2)/N)",
            0,
        ),  # ME'scope
        ("Point Index:\t1\n\nFrequency [Hz]\tReal [(m/s)/N]\tImaginary [(m/s)/N]", 1),  # Polytec
    ],
)
def test_frfs(tmp_path, heading, power):
    (tmp_path / "a.txt").write_text(f"{heading}\n{table(LINES, FRF.real, FRF.imag)}")
    found = read_file(tmp_path / "a.txt").frf
    expected = FRF * (2j * np.pi * LINES) ** power
    np.testing.assert_allclose(found.values[0], expected, rtol=2e-6, atol=1e-3)


@pytest.mark.parametrize(
    "ending", ["bkc", "sotm", "oxf", "dxd", "tdm", "vtprj", "svd", "hdf", "raw"]
)
def test_files_of_programs_are_refused_by_their_ending(tmp_path, ending):
    (tmp_path / f"a.{ending}").write_bytes(b"\x01\x02" * 200)
    with pytest.raises(InputError, match=rf"ending '\.{ending}'.*Export"):
        read_file(tmp_path / f"a.{ending}")


@pytest.mark.parametrize("start", [b"|CF,2,1,1;|CK,1,3,1,1;", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"])
def test_binary_files_under_an_ending_of_text(tmp_path, start):
    (tmp_path / "a.dat").write_bytes(start + FORCE.tobytes())
    with pytest.raises(InputError, match=r"binary data|OLE file"):
        read_file(tmp_path / "a.dat")
