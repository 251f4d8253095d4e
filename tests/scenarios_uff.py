"""Universal files as they should not be, or as one rarely sees them."""

import numpy as np
from builders import (
    ascii58,
    binary58,
    dataset,
    fixed,
    floats,
    frf58,
    header58,
    nodes15,
    row,
    units164,
)
from scenarios import (
    ACCELERATION,
    FORCE,
    N,
    Read,
    Scenario,
    bad_file,
    bad_manifest,
    force,
    sensor,
    unusable,
)

_FORCE_AXIS = (13, 0, 0, "Force", "N")
_FIRST = {"force": tuple(FORCE[:4]), "A01": tuple(ACCELERATION[:4])}
_AS_WRITTEN = Read(first=_FIRST)
_HEADER = header58(binary=(1, 4 * N), n=N)
_RUN = force() + sensor()


def _uff(name, content, expected, pending=""):
    return Scenario(f"uff {name}", {"a.uff": content}, expected, "a.uff", pending)


def _spoilt(values, index, value):
    changed = values.copy()
    changed[index] = value
    return changed


def _ascii(values=ACCELERATION, text=None, **header):
    text = fixed(values, digits=5) if text is None else text
    return ascii58(text, **{"n": len(values)} | header)


_ASCII_FORCE = _ascii(FORCE, name="force", node=0, axis=_FORCE_AXIS)

TRUNCATED = (
    _uff("empty", b"", bad_file("a.uff", "empty")),
    _uff("blank lines", b"\n  \r\n\n", bad_file("a.uff", "nothing|no time series|no dataset")),
    _uff("one delimiter", b"    -1\n", bad_file("a.uff, dataset 1", "end of the file", "number")),
    _uff(
        "cut after the dataset number",
        _HEADER[: _HEADER.index(b"A01")],
        bad_file("a.uff, dataset 1", "0 header lines", "truncated"),
    ),
    _uff(
        "cut in a header line",
        _HEADER[:400],
        bad_file("a.uff, dataset 1, line 11", "9 header lines", "truncated"),
    ),
    _uff("header only", _HEADER, bad_file("a.uff, dataset 1", "0 of 64 values", "truncated")),
    _uff(
        "cut in the payload",
        _RUN[: -len(sensor())] + sensor()[: len(_HEADER) + 122],
        bad_file("a.uff, dataset 2", "30 of 64 values", "truncated"),
    ),
    _uff(
        "cut before the closing delimiter",
        sensor()[: -len("    -1\n")],
        bad_file("a.uff, dataset 1", "no closing delimiter", "64 values"),
    ),
    _uff(
        "cut in the closing delimiter",
        _RUN[:-4],
        bad_file("a.uff, dataset 2", "no closing delimiter"),
    ),
    _uff(
        "ASCII cut in a number",
        _ASCII_FORCE + _ascii()[:-120],
        bad_file("a.uff, dataset 2", "no closing delimiter", "truncated"),
    ),
    _uff(
        "ASCII with a value too few",
        _ascii(text=fixed(ACCELERATION[:-1])),
        bad_file("a.uff, dataset 1", "63 of 64 values", "truncated"),
    ),
    _uff(
        "ASCII with a value too many",
        _ascii(text=fixed([*ACCELERATION, 1.0])),
        bad_file("a.uff, dataset 1", "65 of 64 values", "more than stated"),
    ),
    _uff(
        "closing delimiter forgotten between two functions",
        _ASCII_FORCE[: -len("    -1\n")] + _ascii(),
        bad_file("a.uff, dataset 2", "begins with a line|closing delimiter"),
    ),
)

SIZES = (
    _uff(
        "byte count four too small",
        force() + sensor(n_bytes=4 * N - 4),
        Read(first=_FIRST, findings=("252 bytes.*256 bytes",)),
    ),
    _uff(
        "byte count too large",
        force() + sensor(n_bytes=10**11),
        Read(first=_FIRST, findings=("100000000000 bytes.*256 bytes",)),
    ),
    _uff(
        "byte count zero",
        force() + sensor(n_bytes=0),
        Read(first=_FIRST, findings=("0 bytes.*256 bytes",)),
    ),
    _uff(
        "byte count negative",
        force() + sensor(n_bytes=-256),
        Read(first=_FIRST, findings=("-256 bytes.*256 bytes",)),
    ),
    _uff(
        "ten thousand million values claimed",
        force() + binary58(floats(ACCELERATION), n=9_999_999_999),
        bad_file("dataset 2", "64 of 9999999999 values", "truncated"),
    ),
    _uff(
        "10^12 values claimed",
        _RUN.replace(b"        64         1", b" 1000000000000    1", 1),
        bad_file("a.uff, dataset 1, line 9|truncated"),
    ),
    _uff(
        "ten thousand million values claimed in ASCII",
        _ascii(n=9_999_999_999),
        bad_file("dataset 1", "64 of 9999999999 values", "truncated"),
    ),
    _uff("no values", sensor(n=0), bad_file("dataset 1, line 9", "0 values", "at least one")),
    _uff("values -64", sensor(n=-64), bad_file("dataset 1, line 9", "-64 values", "at least one")),
    _uff(
        "one value a channel",
        force(FORCE[:1]) + sensor(ACCELERATION[:1]),
        Read(frf=unusable("a.uff", "at least 8 samples")),
    ),
    _uff(
        "delimiter inside the payload",
        force() + binary58(floats(ACCELERATION[:-3]) + b"\n    -1\n    -1\n"[:12], n=N),
        Read(first=_FIRST),
    ),
    _uff(
        "line end before the closing delimiter",
        force(before_end=b"\n") + sensor(before_end=b"\r\n"),
        _AS_WRITTEN,
    ),
    _uff(
        "doubles under a single-precision header",
        force() + binary58(floats(ACCELERATION, double=True), n=N),
        Read(first=_FIRST, findings=("512 bytes, 8 for each",)),
    ),
)

STEPS = tuple(
    _uff(f"time step {step.strip()}", force(step=step) + sensor(step=step), expected)
    for step, expected in (
        ("  0.00000E+00", bad_file("dataset 1, line 9", "time step '0.0", "positive")),
        (" -5.00000E-04", bad_file("dataset 1, line 9", "time step '-5", "positive")),
        ("          NaN", bad_file("dataset 1, line 9", "NaN", "finite")),
        ("  1.0000E+400", bad_file("dataset 1, line 9", "1.0000E\\+400", "finite")),
        ("  1.0000E-320", bad_file("dataset 1, line 9", "1.0000E-320", "positive|finite")),
        ("     5.0 E-04", bad_file("dataset 1, line 9", "5.0 E-04", "number")),
        ("  5.00000D-04", _AS_WRITTEN),
        ("    0.0005000", _AS_WRITTEN),
    )
)

NUMBERS = (
    _uff(
        "E20.12 under a single-precision header",
        _ASCII_FORCE + _ascii(text=fixed(ACCELERATION, 20, 12, 4)),
        _AS_WRITTEN,
    ),
    _uff(
        "Fortran D exponents",
        _ASCII_FORCE + _ascii(text=fixed(ACCELERATION).replace("E", "D")),
        _AS_WRITTEN,
    ),
    _uff(
        "exponents of three digits without a letter",
        _ASCII_FORCE + _ascii(text=fixed(ACCELERATION[:-6]) + "  1.00000-103" * 6 + "\n"),
        _AS_WRITTEN,
    ),
    _uff(
        "an ASCII number beyond doubles",
        _ASCII_FORCE + _ascii(text=fixed(ACCELERATION[:-6]) + " 1.00000E+400" * 6 + "\n"),
        Read(missing=True),
        pending="an infinite sample is a missing one, and no warning of numpy's",
    ),
    _uff(
        "a word among ASCII numbers",
        _ASCII_FORCE + _ascii(text=fixed(ACCELERATION).replace("E+01", "E+xx", 1)),
        bad_file("a.uff, dataset 2", "E\\+xx", "number"),
    ),
    _uff(
        "stars for a number that did not fit its column",
        _ASCII_FORCE + _ascii(text=fixed(ACCELERATION[:-1]).rstrip("\n") + "*" * 13 + "\n"),
        bad_file("a.uff, dataset 2", "\\*\\*\\*", "number"),
    ),
    _uff(
        "a NaN among the responses",
        force() + sensor(_spoilt(ACCELERATION, 5, np.nan)),
        Read(first={"force": tuple(FORCE[:4])}, missing=True),
    ),
    _uff(
        "a NaN in the force",
        force(_spoilt(FORCE, 5, np.nan)) + sensor(),
        Read(missing=True),
    ),
    _uff(
        "a force of zeros",
        force(0 * FORCE) + sensor(),
        Read(frf=unusable("a.uff, channel 'force'", "constant signal", "excite")),
    ),
    _uff("a response that is constant", force() + sensor(0 * ACCELERATION + 3.0), Read()),
    _uff("a response that clips", force() + sensor(np.clip(ACCELERATION, -20, 20)), Read()),
    _uff(
        "big-endian values under a little-endian flag",
        force() + binary58(floats(ACCELERATION, big=True), n=N),
        bad_file("a.uff, dataset 2", "byte order"),
        pending="values that make sense in the other byte order alone",
    ),
    _uff("big-endian doubles", force(big=True, ordinate=4) + sensor(big=True), _AS_WRITTEN),
)

HEADERS = (
    _uff("byte order 3", _RUN.replace(b"b     1", b"b     3", 1), bad_file("line 2", "order 3")),
    _uff(
        "floats of a VAX",
        _RUN.replace(b"b     1     2", b"b     1     1", 1),
        bad_file("dataset 1, line 2", "floating-point format 1", "IEEE"),
    ),
    _uff("ordinate type 7", sensor(ordinate=7), bad_file("line 9", "type 7", "2, 4, 5 and 6")),
    _uff(
        "a time response of complex values",
        binary58(floats([*FORCE, *FORCE]), ordinate=5, n=N),
        bad_file("a.uff, dataset 1", "complex", "real"),
    ),
    _uff("abscissa spacing 2", sensor(even=2), bad_file("dataset 1, line 9", "spacing 2")),
    _uff(
        "a dataset number that is none",
        b"    -1\n    5x\n    -1\n" + _RUN,
        bad_file("a.uff, dataset 1", "'    5x'", "number of the dataset"),
    ),
    _uff(
        "datasets of unknown kinds around",
        dataset(999999, "what is this") + _RUN + dataset(2, "?"),
        Read(first=_FIRST, findings=("dataset 2, dataset 999999|999999.*2",)),
    ),
    _uff(
        "text between the datasets",
        force() + b"exported by hand\n" + sensor(),
        bad_file("a.uff, dataset 2", "'exported by hand'", "begins with a line"),
    ),
    _uff("CR LF", force(eol="\r\n") + sensor(eol="\r\n"), _AS_WRITTEN),
    _uff(
        "CR only",
        (_ASCII_FORCE + _ascii()).replace(b"\n", b"\r"),
        bad_file("a.uff, dataset 1", "begins with a line|line end"),
    ),
    _uff("NUL padding behind the end", _RUN + bytes(512), _AS_WRITTEN),
    _uff("end mark of old systems", _RUN + b"\x1a", _AS_WRITTEN),
    _uff(
        "UTF-16",
        (_ASCII_FORCE + _ascii()).decode().encode("utf-16"),
        bad_file("a.uff, dataset 1", "begins with a line|UTF-16"),
    ),
    _uff(
        "a UTF-8 byte order mark",
        b"\xef\xbb\xbf" + _RUN,
        _AS_WRITTEN,
        pending="skip the mark as blank lines are skipped",
    ),
    _uff(
        "a latin-1 name",
        force(name="Kraft Reifenlängs", node=0) + sensor(),
        Read(channels=("Kraft Reifenlängs", "A01")),
    ),
    _uff(
        "a name that is markup",
        force() + sensor(name="<script>alert(1)</script>"),
        Read(channels=("force", "<script>alert(1)</script>")),
    ),
    _uff(
        "a name of 200 letters",
        force() + sensor(name="x" * 200),
        Read(channels=("force", "x" * 200)),
    ),
    _uff(
        "no name but a node", force() + sensor(name="NONE", node=7), Read(channels=("force", "7+Z"))
    ),
    _uff("NUL in a name", force() + sensor(name="A\x0001"), Read(channels=("force", "A\x0001"))),
    _uff(
        "line 9 in free columns",
        _RUN.replace(
            b"         2        64         1  0.00000E+00  5.00000E-04  0.00000E+00",
            b"2 64 1 0.0 0.0005 0.0",
        ),
        _AS_WRITTEN,
    ),
)

ROLES = (
    _uff(
        "two forces",
        force() + force(name="F2") + sensor(),
        bad_file("a.uff", "2 forces: force, F2"),
    ),
    _uff("no force", sensor() + sensor(name="A02", node=2), bad_file("a.uff", "no force among")),
    _uff(
        "no response", force(), bad_file("a.uff", "force \\(force\\)", "at least one acceleration")
    ),
    _uff(
        "a name twice",
        force() + sensor() + sensor(node=2),
        bad_file("a.uff", "channels 2 and 3 are both called 'A01'", "occur once"),
    ),
    _uff(
        "a node twice",
        force() + sensor() + sensor(name="A02"),
        bad_file("a.uff", "'A01' and 'A02' are both at node 1"),
    ),
    _uff(
        "different lengths",
        force() + sensor(ACCELERATION[:60]),
        bad_file("a.uff", "64 samples of 'force', 60 of 'A01'", "equally long"),
    ),
    _uff(
        "different rates",
        force() + sensor(step="  2.50000E-04"),
        bad_file("a.uff", "2000 Hz of 'force', 4000 Hz of 'A01'", "one rate"),
    ),
    _uff(
        "responses in volts",
        force() + sensor(axis=(12, 0, 0, "Acceleration", "V")),
        bad_file("a.uff", "A01 \\(voltage\\)", "at least one acceleration"),
    ),
    Scenario(
        "uff node beyond the grid",
        {
            "a.uff": force() + sensor(node=5),
            "campaign.toml": b"schema = 1\ngrid.positions = 4\nruns = [{ file = 'a.uff' }]\n",
        },
        bad_manifest("no position of 'A01' \\(node 5\\) in a.uff", "0 to 4"),
    ),
    _uff(
        "units of dataset 164 that are zero",
        units164(0.0, 1.0) + _RUN,
        bad_file("a.uff", "units 0.0", "positive"),
    ),
    _uff("dataset 164 cut short", dataset(164, row("10d", 9)) + _RUN, bad_file("a.uff", "164")),
    _uff(
        "words for coordinates",
        nodes15({1: (0, 0, 0)}).replace(b"0.00000E+00", b"    nowhere") + _RUN,
        bad_file("a.uff", "15", "nodes"),
    ),
)

_LINES = np.array([1 + 1j, 2, 3, 4])
FRFS = (
    _uff(
        "FRFs beside time series",
        _RUN + frf58(_LINES),
        Read(runs=0, findings=("time series are left out",)),
    ),
    _uff("an FRF of one line", frf58(_LINES[:1]), bad_file("dataset 1, line 9", "1 lines", "two")),
    _uff(
        "FRFs with a step of zero",
        frf58(_LINES, step="  0.00000E+00"),
        bad_file("dataset 1, line 9", "step 0.0", "equidistant"),
    ),
    _uff(
        "FRFs of different lines",
        frf58(_LINES) + frf58(_LINES[:3], node=2),
        bad_file("a.uff, dataset 2", "3 lines", "dataset 1 has 4 lines"),
    ),
    _uff(
        "FRFs of pressure",
        frf58(_LINES, axis=(15, 0, 0, "Pressure", "Pa")),
        bad_file("dataset 1, line 11", "unknown over force", "acceleration"),
    ),
    _uff(
        "coherence alone",
        frf58(_LINES, function_type=6),
        bad_file("a.uff", "function type 6", "nothing for this tool"),
    ),
    _uff(
        "FRFs of two forces",
        frf58(_LINES) + frf58(_LINES, node=2, reference_node=2),
        bad_file("a.uff", "2 force nodes and 2 response nodes", "one force"),
    ),
)

SCENARIOS = (*TRUNCATED, *SIZES, *STEPS, *NUMBERS, *HEADERS, *ROLES, *FRFS)
