"""Every form a dataset 58 may take holds the same values."""

import struct

import numpy as np
import pytest
from builders import ascii58, binary58, dataset, fixed, floats, response58, row

from ema.io.uff.reader import read as read_uff

REAL = [0.0, -1.5, 2.25, 0.03125, -3e5, 7.0, 0.125, -0.0]
COMPLEX = [complex(a, b) for a, b in zip(REAL[::2], REAL[1::2], strict=True)]
PER_LINE = {(2, 1): 6, (4, 1): 4, (5, 1): 6, (6, 1): 4, (2, 0): 6, (4, 0): 4, (5, 0): 6, (6, 0): 3}
FRF = {
    "function_type": 4,
    "abscissa": (18, 0, 0, "Frequency", "Hz"),
    "denominator": (13, 0, 0, "Force", "N"),
    "reference_node": 1,
    "reference_direction": 3,
}


def read(tmp_path, content):
    (path := tmp_path / "a.uff").write_bytes(content)
    return read_uff(path)


def values_in(found):
    return found.recording.channels[0].samples if found.recording else found.frf.values[0]


def binary_form(ordinate, even, big):
    double, order = ordinate in (4, 6), "<>"[big]
    single_abscissa = order + "f"
    parts = []
    for k, value in enumerate(REAL if ordinate in (2, 4) else COMPLEX):
        if not even:  # abscissae are single precision in both
            parts.append(struct.pack(single_abscissa, k / 2.0))
        numbers = (value.real, value.imag) if isinstance(value, complex) else (value,)
        parts.append(floats(numbers, big=big, double=double))
    return b"".join(parts)


def text_form(ordinate, even):
    double = ordinate in (4, 6)
    cells = []
    for k, value in enumerate(REAL if ordinate in (2, 4) else COMPLEX):
        cells += [] if even else [f"{k / 2.0:13.5E}"]
        numbers = (value.real, value.imag) if isinstance(value, complex) else (value,)
        cells += [f"{number:20.12E}" if double else f"{number:13.5E}" for number in numbers]
    per_line = PER_LINE[ordinate, even]
    lines = [cells[k : k + per_line] for k in range(0, len(cells), per_line)]
    return "".join("".join(line) + "\n" for line in lines)


@pytest.mark.parametrize("form", ["text", "little", "big"])
@pytest.mark.parametrize("even", [1, 0], ids=["even", "uneven"])
@pytest.mark.parametrize("ordinate", [2, 4, 5, 6])
def test_precisions_spacings_and_byte_orders(tmp_path, ordinate, even, form):
    values = REAL if ordinate in (2, 4) else COMPLEX
    header = {"ordinate": ordinate, "even": even, "n": len(values), "step": "  5.00000E-01"}
    header |= FRF if ordinate in (5, 6) else {}
    if form == "text":
        content = ascii58(text_form(ordinate, even), **header)
    else:
        big = form == "big"
        content = binary58(binary_form(ordinate, even, big), big=big, **header)
    found = read(tmp_path, content)
    np.testing.assert_array_equal(values_in(found), values)
    if found.recording:
        assert found.recording.sampling_rate_hz == 2.0
        assert np.signbit(values_in(found)[-1])
    else:
        assert found.frf.frequency_hz.tolist() == [0.0, 0.5, 1.0, 1.5]
    assert found.findings == ()


@pytest.mark.parametrize("per_line", [6, 1])
def test_exponents_without_a_letter(tmp_path, per_line):
    stated = [1.234e-105, -9.5e102, 1.0, 0.0, 2.5e-300, -1e-99, 3.0, 4.0]
    cells = [f"{'1.23400-105':>13}", f"{'-9.50000+102':>13}", *(f"{x:13.5E}" for x in stated[2:4])]
    cells += [f"{'2.50000-300':>13}", *(f"{x:13.5E}" for x in stated[5:])]
    text = "".join("".join(cells[k : k + per_line]) + "\n" for k in range(0, 8, per_line))
    found = read(tmp_path, ascii58(text))
    np.testing.assert_array_equal(values_in(found), stated)


def test_signalling_nans_of_a_single_precision_frf_stay_nans(tmp_path):
    signalling = struct.pack("<I", 0x7FA00000)
    payload = floats([1.0]) + signalling + floats([2.0, 3.0])
    found = read(tmp_path, binary58(payload, ordinate=5, n=2, step="  1.00000E+00", **FRF))
    assert np.isnan(found.frf.values[0, 0])
    assert found.frf.values[0, 1] == 2 + 3j


@pytest.mark.parametrize(
    ("function_type", "name"),
    [
        (0, "general or unknown"),
        (2, "auto spectrum"),
        (3, "cross spectrum"),
        (6, "coherence"),
        (9, "power spectral density"),
        (77, "unknown"),
    ],
)
def test_other_functions_are_named(tmp_path, function_type, name):
    content = response58() + ascii58(fixed(REAL), function_type=function_type)
    found = read(tmp_path, content)
    assert found.recording.names == ("A01",)
    (finding,) = found.findings
    assert f"function type {function_type} ({name})" in finding.detail


def test_shapes_beside_recordings_are_named(tmp_path):
    shape = dataset(55, *["NONE"] * 5, row("10d " * 6, 1, 2, 2, 8, 2, 3), "2 4 1 1", "80.0")
    (finding,) = read(tmp_path, shape + response58()).findings
    assert "dataset 55 (data at nodes): left out; mode shapes are read by" in finding.detail


def test_unknown_datasets_are_named(tmp_path):
    (finding,) = read(tmp_path, dataset(999, "x") + response58()).findings
    assert "dataset 999 (unknown): " in finding.detail


@pytest.mark.parametrize("kind", ["58", "58b"])
def test_headers_in_any_single_byte_encoding(tmp_path, kind):
    name = "Güte µ € \x81"
    build = ascii58 if kind == "58" else binary58
    content = build(fixed(REAL) if kind == "58" else floats(REAL), name="@" * len(name))
    content = content.replace(b"@" * len(name), name.encode("cp1252", "replace"))
    found = read(tmp_path, content).recording.names[0]
    assert found.startswith("Güte µ")
    assert len(found) == len(name)
