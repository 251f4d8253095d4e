"""Universal files as they should not be, or as one rarely sees them."""

import numpy as np
from builders import ascii58, binary58, fixed, floats, header58
from scenarios import ACCELERATION, FORCE, N, Read, Scenario, bad_file, force, sensor, unusable

_FORCE_AXIS = (13, 0, 0, "Force", "N")
FIRST = {"force": tuple(FORCE[:4]), "A01": tuple(ACCELERATION[:4])}
AS_WRITTEN = Read(first=FIRST)
_HEADER = header58(binary=(1, 4 * N), n=N)
RUN = force() + sensor()


def uff(name, content, expected, pending=""):
    """Return a scenario of one universal file."""
    return Scenario(f"uff {name}", {"a.uff": content}, expected, "a.uff", pending)


def _spoilt(values, index, value):
    changed = values.copy()
    changed[index] = value
    return changed


def ascii_sensor(values=ACCELERATION, text=None, **header):
    text = fixed(values, digits=5) if text is None else text
    return ascii58(text, **{"n": len(values)} | header)


ASCII_FORCE = ascii_sensor(FORCE, name="force", node=0, axis=_FORCE_AXIS)

TRUNCATED = (
    uff("empty", b"", bad_file("a.uff", "empty")),
    uff("blank lines", b"\n  \r\n\n", bad_file("a.uff", "blanks|no time series|no dataset")),
    uff("one delimiter", b"    -1\n", bad_file("a.uff, dataset 1", "end of the file", "number")),
    uff(
        "cut after the dataset number",
        _HEADER[: _HEADER.index(b"A01")],
        bad_file("a.uff, dataset 1", "0 header lines", "truncated"),
    ),
    uff(
        "cut in a header line",
        _HEADER[:400],
        bad_file("a.uff, dataset 1, line 11", "9 header lines", "truncated"),
    ),
    uff("header only", _HEADER, bad_file("a.uff, dataset 1", "0 of 64 values", "truncated")),
    uff(
        "cut in the payload",
        RUN[: -len(sensor())] + sensor()[: len(_HEADER) + 122],
        bad_file("a.uff, dataset 2", "30 of 64 values", "truncated"),
    ),
    uff(
        "cut before the closing delimiter",
        sensor()[: -len("    -1\n")],
        bad_file("a.uff, dataset 1", "no closing delimiter", "64 values"),
    ),
    uff(
        "cut in the closing delimiter",
        RUN[:-4],
        bad_file("a.uff, dataset 2", "no closing delimiter"),
    ),
    uff(
        "ASCII cut in a number",
        ASCII_FORCE + ascii_sensor()[:-120],
        bad_file("a.uff, dataset 2", "no closing delimiter", "truncated"),
    ),
    uff(
        "ASCII with a value too few",
        ascii_sensor(text=fixed(ACCELERATION[:-1])),
        bad_file("a.uff, dataset 1", "63 of 64 values", "truncated"),
    ),
    uff(
        "ASCII with a value too many",
        ascii_sensor(text=fixed([*ACCELERATION, 1.0])),
        bad_file("a.uff, dataset 1", "65 of 64 values", "more than stated"),
    ),
    uff(
        "closing delimiter forgotten between two functions",
        ASCII_FORCE[: -len("    -1\n")] + ascii_sensor(),
        bad_file("a.uff, dataset 2", "begins with a line|closing delimiter"),
    ),
)

SIZES = (
    uff(
        "byte count four too small",
        force() + sensor(n_bytes=4 * N - 4),
        Read(first=FIRST, findings=("252 bytes.*256 bytes",)),
    ),
    uff(
        "byte count too large",
        force() + sensor(n_bytes=10**11),
        Read(first=FIRST, findings=("100000000000 bytes.*256 bytes",)),
    ),
    uff(
        "byte count zero",
        force() + sensor(n_bytes=0),
        Read(first=FIRST, findings=("0 bytes.*256 bytes",)),
    ),
    uff(
        "byte count negative",
        force() + sensor(n_bytes=-256),
        Read(first=FIRST, findings=("-256 bytes.*256 bytes",)),
    ),
    uff(
        "ten thousand million values claimed",
        force() + binary58(floats(ACCELERATION), n=9_999_999_999),
        bad_file("dataset 2", "64 of 9999999999 values", "truncated"),
    ),
    uff(
        "10^12 values claimed",
        RUN.replace(b"        64         1", b" 1000000000000    1", 1),
        bad_file("a.uff, dataset 1, line 9|truncated"),
    ),
    uff(
        "ten thousand million values claimed in ASCII",
        ascii_sensor(n=9_999_999_999),
        bad_file("dataset 1", "64 of 9999999999 values", "truncated"),
    ),
    uff("no values", sensor(n=0), bad_file("dataset 1, line 9", "0 values", "at least one")),
    uff("values -64", sensor(n=-64), bad_file("dataset 1, line 9", "-64 values", "at least one")),
    uff(
        "one value a channel",
        force(FORCE[:1]) + sensor(ACCELERATION[:1]),
        Read(frf=unusable("a.uff", "at least 8 samples")),
    ),
    uff(
        "delimiter inside the payload",
        force() + binary58(floats(ACCELERATION[:-3]) + b"\n    -1\n    -1\n"[:12], n=N),
        Read(first=FIRST),
    ),
    uff(
        "line end before the closing delimiter",
        force(before_end=b"\n") + sensor(before_end=b"\r\n"),
        AS_WRITTEN,
    ),
    uff(
        "doubles under a single-precision header",
        force() + binary58(floats(ACCELERATION, double=True), n=N),
        Read(first=FIRST, findings=("512 bytes, 8 for each",)),
    ),
)

STEPS = tuple(
    uff(f"time step {step.strip()}", force(step=step) + sensor(step=step), expected)
    for step, expected in (
        ("  0.00000E+00", bad_file("dataset 1, line 9", "time step '0.0", "positive")),
        (" -5.00000E-04", bad_file("dataset 1, line 9", "time step '-5", "positive")),
        ("          NaN", bad_file("dataset 1, line 9", "NaN", "finite")),
        ("  1.0000E+400", bad_file("dataset 1, line 9", "1.0000E\\+400", "finite")),
        ("  1.0000E-320", bad_file("dataset 1, line 9", "1.0000E-320", "positive|finite")),
        ("     5.0 E-04", bad_file("dataset 1, line 9", "5.0 E-04", "number")),
        ("  5.00000D-04", AS_WRITTEN),
        ("    0.0005000", AS_WRITTEN),
    )
)

NUMBERS = (
    uff(
        "E20.12 under a single-precision header",
        ASCII_FORCE + ascii_sensor(text=fixed(ACCELERATION, 20, 12, 4)),
        AS_WRITTEN,
    ),
    uff(
        "Fortran D exponents",
        ASCII_FORCE + ascii_sensor(text=fixed(ACCELERATION).replace("E", "D")),
        AS_WRITTEN,
    ),
    uff(
        "exponents of three digits without a letter",
        ASCII_FORCE + ascii_sensor(text=fixed(ACCELERATION[:-6]) + "  1.00000-103" * 6 + "\n"),
        AS_WRITTEN,
    ),
    uff(
        "an ASCII number beyond doubles",
        ASCII_FORCE + ascii_sensor(text=fixed(ACCELERATION[:-6]) + " 1.00000E+400" * 6 + "\n"),
        Read(missing=True),
    ),
    uff(
        "a word among ASCII numbers",
        ASCII_FORCE + ascii_sensor(text=fixed(ACCELERATION).replace("E+01", "E+xx", 1)),
        bad_file("a.uff, dataset 2", "E\\+xx", "number"),
    ),
    uff(
        "stars for a number that did not fit its column",
        ASCII_FORCE + ascii_sensor(text=fixed(ACCELERATION[:-1]).rstrip("\n") + "*" * 13 + "\n"),
        bad_file("a.uff, dataset 2", "\\*\\*\\*", "number"),
    ),
    uff(
        "a NaN among the responses",
        force() + sensor(_spoilt(ACCELERATION, 5, np.nan)),
        Read(first={"force": tuple(FORCE[:4])}, missing=True),
    ),
    uff("a NaN in the force", force(_spoilt(FORCE, 5, np.nan)) + sensor(), Read(missing=True)),
    uff(
        "a force of zeros",
        force(0 * FORCE) + sensor(),
        Read(frf=unusable("a.uff, channel 'force'", "constant signal", "excite")),
    ),
    uff("a response that is constant", force() + sensor(0 * ACCELERATION + 3.0), Read()),
    uff("a response that clips", force() + sensor(np.clip(ACCELERATION, -20, 20)), Read()),
    uff(
        "big-endian values under a little-endian flag",
        force() + binary58(floats(ACCELERATION, big=True), n=N),
        bad_file("a.uff, dataset 2, line 2", "which is 67 in the other", "byte order"),
    ),
    uff(
        "little-endian doubles under a big-endian flag",
        force() + binary58(floats(ACCELERATION + 0.1, double=True), n=N, ordinate=4, big=True),
        bad_file("a.uff, dataset 2, line 2", "which is 67.1 in the other", "byte order"),
    ),
    uff("big-endian doubles", force(big=True, ordinate=4) + sensor(big=True), AS_WRITTEN),
)

SCENARIOS = (*TRUNCATED, *SIZES, *STEPS, *NUMBERS)
