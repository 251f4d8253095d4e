"""Tables of text and LabVIEW files as they should not be, or as one rarely sees them."""

import gzip

import numpy as np
from scenarios import ACCELERATION, FORCE, RATE_HZ, G, N, Read, Scenario, bad_file, table, unusable

_TABLE = table()
_EUROPEAN = table(separator=";").replace(".", ",")
_FIRST = {"force": tuple(FORCE[:4]), "A01": tuple(ACCELERATION[:4])}
_AS_WRITTEN = Read(first=_FIRST)
_BOMB = gzip.compress(_TABLE.encode() + b"0.0,0.0,0.0\n" * 2_000_000, 1)  # 24 MB of 100 kB
_LINES = _TABLE.splitlines(keepends=True)


def _csv(name, content, expected, file="a.csv"):
    content = content.encode() if isinstance(content, str) else content
    return Scenario(f"csv {name}", {file: content}, expected, file)


def _line(number, old, new):
    """The table with a cell changed on one line, counted from 1."""
    lines = list(_LINES)
    assert old in lines[number - 1]
    lines[number - 1] = lines[number - 1].replace(old, new, 1)
    return "".join(lines)


def _cell(number):
    """The acceleration on a line, as printed."""
    return f",{ACCELERATION[number - 2]:.1f}"


def _stamps(times):
    """The table with other times."""
    rows = [line.split(",", 1)[1] for line in _LINES[1:]]
    return _LINES[0] + "".join(f"{t},{row}" for t, row in zip(times, rows, strict=True))


def _thousands(sign):
    """The table with larger forces, printed as in Switzerland or by ISO 80000."""
    rows = "".join(
        f"{k / RATE_HZ:.4f};{f'{1e4 * force:,.1f}'.replace(',', sign)};{motion:.1f}\n"
        for k, (force, motion) in enumerate(zip(FORCE, ACCELERATION, strict=True))
    )
    return "time [s];force [N];A01 [m/s^2]\n" + rows


DIALECTS = (
    _csv("CR LF", _TABLE.replace("\n", "\r\n"), _AS_WRITTEN),
    _csv("CR only", _TABLE.replace("\n", "\r"), _AS_WRITTEN),
    _csv("no line end behind the last row", _TABLE.rstrip("\n"), _AS_WRITTEN),
    _csv("blank lines at the end", _TABLE + "\n\n", _AS_WRITTEN),
    _csv("semicolons and decimal commas", _EUROPEAN, _AS_WRITTEN),
    _csv("tabs", _TABLE.replace(",", "\t"), _AS_WRITTEN, "a.tsv"),
    _csv("tabs and decimal commas", table(separator="\t").replace(".", ","), _AS_WRITTEN),
    _csv("a UTF-8 byte order mark", _TABLE.encode("utf-8-sig"), _AS_WRITTEN),
    _csv("UTF-16", _TABLE.encode("utf-16"), _AS_WRITTEN),
    _csv("UTF-16, big endian", b"\xfe\xff" + _TABLE.encode("utf-16-be"), _AS_WRITTEN),
    _csv(
        "latin-1 header",
        table("Prüfkraft [N],A01 [m/s²]").encode("latin-1"),
        Read(channels=("Prüfkraft", "A01")),
    ),
    _csv("gzip", gzip.compress(_TABLE.encode()), _AS_WRITTEN, "a.csv.gz"),
    _csv("quoted cells", _TABLE.replace("force [N]", '"force [N]"'), _AS_WRITTEN),
    _csv(
        "units in a row of their own",
        table("force,A01").replace("time [s]", "time").replace("\n", "\ns,N,m/s^2\n", 1),
        _AS_WRITTEN,
    ),
    _csv("a preamble", "Lab 7, tyre 4711\nDate: 2026-03-04\n\n" + _TABLE, _AS_WRITTEN),
    _csv("comment lines", "# exported by hand\n# second line\n" + _TABLE, _AS_WRITTEN),
    *(
        _csv(f"thousands by {sign!r}", _thousands(sign), Read(first={"force": (1e4 * FORCE[0],)}))
        for sign in ("'", "\u2019", " ", "\u00a0", "\u202f")
    ),
    *(
        _csv(
            f"integers below {line!r}",
            f"{line}\n" + _TABLE.replace(".0,", ",").replace(".0\n", "\n"),
            bad_file("a.csv", "above integers"),
        )
        for line in ("Scale factor,0.01,0.02", "Gain: 10", "Volts per count,1,0.5")
    ),
    _csv("integers with factors of one", f"Gain,1,1.0\n{_TABLE}", _AS_WRITTEN),
    _csv(
        "numbers between blanks under one name",
        "Force of run 3\n" + "".join(f"{101 + k} {201 + k}\n" for k in range(N)),
        bad_file("a.csv", "2 cells below 4"),
    ),
    _csv("blanks around the cells", _TABLE.replace(",", " , "), _AS_WRITTEN),
    _csv("a separator behind each row", _TABLE.replace("\n", ",\n"), _AS_WRITTEN),
    _csv(
        "acceleration in g",
        table("force [kN],A01 [g]"),
        Read(first={"force": (1e3 * FORCE[0],), "A01": (G * ACCELERATION[0],)}),
    ),
    _csv(
        "a column without a name",
        table("force [N],A01 [m/s^2],").replace("\n", ",0.0\n").replace("],,0.0", "],"),
        _AS_WRITTEN,
    ),
    _csv(
        "an unknown unit beside",
        table("force [N],A01 [m/s^2],EU [furlong]").replace(".0\n", ".0,0.0\n"),
        Read(channels=("force", "A01", "EU"), findings=("'furlong' is not known",)),
    ),
)

DAMAGED = (
    _csv("empty", "", bad_file("a.csv", "empty")),
    _csv("blank lines", "\n\r\n  \n", bad_file("a.csv", "empty|header|blank")),
    _csv("header only", _LINES[0], bad_file("a.csv", "no rows")),
    _csv("no header", "".join(_LINES[1:]), bad_file("a.csv", "no header", "Add a header|name")),
    _csv("NUL in the header", _TABLE.replace("A01", "A\0001"), bad_file("a.csv", "binary|NUL")),
    _csv("NUL padding at the end", _TABLE.encode() + bytes(64), bad_file("a.csv")),
    _csv("a universal file under a wrong name", b"    -1\n    58\nA01\n", bad_file("a.csv")),
    _csv("a picture under a wrong name", b"\x89PNG\r\n\x1a\n" + bytes(64), bad_file("a.csv")),
    _csv("cut in a row", _TABLE[:-8], bad_file("a.csv", "65|2 columns|columns")),
    _csv("a cell too many", _line(30, "\n", ",1.0\n"), bad_file("a.csv", "30|columns")),
    _csv("a cell too few", _line(30, _cell(30), ""), bad_file("a.csv", "30|columns")),
    _csv("a word for a number", _line(30, _cell(30), ",n/e"), bad_file("a.csv", "n/e", "number")),
    _csv(
        "thousands separated",
        _EUROPEAN.replace(";-", ";1.000.", 1),
        bad_file("a.csv", "1\\.000\\.", "number"),
    ),
    _csv("hexadecimal", _line(30, _cell(30), ",0x1F"), bad_file("a.csv", "0x1F", "number")),
    _csv("an empty cell", _line(30, _cell(30), ","), Read(missing=True)),
    _csv("NaN", _line(30, _cell(30), ",NaN"), Read(missing=True)),
    _csv("a number beyond doubles", _line(30, _cell(30), ",1e400"), Read(missing=True)),
    _csv("gzip cut short", gzip.compress(_TABLE.encode())[:-40], bad_file("a.csv.gz"), "a.csv.gz"),
    _csv("a gzip bomb", _BOMB, bad_file("a.csv.gz", "times|fold|unpack|packed"), "a.csv.gz"),
    _csv("gzip in name only", _TABLE, bad_file("a.csv.gz", "gzip"), "a.csv.gz"),
    _csv(
        "a name twice",
        table("A01 [N],A01 [m/s^2]"),
        bad_file("a.csv", "both called 'A01'", "unique"),
    ),
    _csv("an unclosed quotation mark", _line(30, _cell(30), ',"5.0'), Read()),
)

TIMES = (
    _csv("no time", table(time=False), bad_file("a.csv", "no sampling rate", "manifest")),
    _csv("time alone", "time [s]\n0\n1\n2\n", bad_file("a.csv", "time", "at least one column")),
    _csv(
        "time that jumps",
        _stamps([*np.arange(40) / RATE_HZ, *(np.arange(40, N) + 100) / RATE_HZ]),
        bad_file("a.csv, column 'time'", "row 41|line 42", "equal steps"),
    ),
    _csv(
        "a dropped row",
        "".join([*_LINES[:20], *_LINES[21:]]),
        bad_file("a.csv, column 'time'", "row 20|line 21", "equal steps"),
    ),
    _csv(
        "time running back",
        _stamps(-np.arange(N) / RATE_HZ),
        bad_file("a.csv, column 'time'", "equal steps|increase"),
    ),
    _csv(
        "time standing still",
        _stamps(np.zeros(N)),
        bad_file("a.csv, column 'time'", "equal steps|increase"),
    ),
    _csv(
        "no time in one row",
        _stamps([*np.arange(N - 1) / RATE_HZ, "NaN"]),
        bad_file("a.csv, column 'time'", "row 64|line 65"),
    ),
    _csv(
        "time rounded to few digits", _stamps([f"{k / RATE_HZ:.4f}" for k in range(N)]), _AS_WRITTEN
    ),
    _csv("one row", "".join(_LINES[:2]), bad_file("a.csv", "1 time stamp|equal steps")),
    _csv("two rows", "".join(_LINES[:3]), Read(frf=unusable("a.csv", "at least 8 samples"))),
    _csv(
        "milliseconds",
        _stamps([k / 2 for k in range(N)]).replace("time [s]", "t [ms]"),
        _AS_WRITTEN,
    ),
)


def lvm_file(
    *, decimal=".", delta="0.0005", samples=N, rows=N, time=True, starts=("0", "0"), more=""
):
    """A LabVIEW measurement file of text; `more` lines follow the numbers."""
    head = [
        "LabVIEW Measurement\t",
        "Writer_Version\t2",
        "Reader_Version\t2",
        "Separator\tTab",
        f"Decimal_Separator\t{decimal}",
        "Multi_Headings\tNo",
        f"X_Columns\t{'One' if time else 'No'}",
        "Time_Pref\tRelative",
        "***End_of_Header***\t",
        "\t",
        "Channels\t2\t\t",
        f"Samples\t{samples}\t{samples}\t",
        "Y_Unit_Label\tN\tm/s^2\t",
        "X_Dimension\tTime\tTime\t",
        "\t".join(["X0", *starts, ""]),
        f"Delta_X\t{delta}\t{delta}\t",
        "***End_of_Header***\t\t\t",
        "X_Value\tforce\tA01\tComment",
    ]
    stamps = [f"{k / RATE_HZ:.4f}" if time else "" for k in range(rows)]
    body = [f"{stamps[k]}\t{FORCE[k]:.6f}\t{ACCELERATION[k]:.6f}\t" for k in range(rows)]
    text = "\r\n".join(head + [row.replace(".", decimal) for row in body] + [""])
    return (text + more).encode()


def _lvm(name, content, expected):
    return Scenario(f"lvm {name}", {"a.lvm": content}, expected, "a.lvm")


_LVM = lvm_file()
LVM = (
    _lvm("whole", _LVM, _AS_WRITTEN),
    _lvm("decimal commas", lvm_file(decimal=","), _AS_WRITTEN),
    _lvm("empty", b"", bad_file("a.lvm", "empty")),
    _lvm("cut in the header", _LVM[:200], bad_file("a.lvm", "header|End_of_Header")),
    _lvm("cut in a row", _LVM[:-12], bad_file("a.lvm")),
    _lvm("zeros", bytes(1000), bad_file("a.lvm")),
    _lvm("another format within", b"%PDF-1.7\n" * 100, bad_file("a.lvm")),
    _lvm("fewer rows than stated", lvm_file(rows=40), bad_file("a.lvm", "40", "64")),
    _lvm("a step of zero", lvm_file(delta="0"), bad_file("a.lvm", "Delta_X|step")),
    _lvm(
        "more channels than names",
        _LVM.replace(b"Channels\t2", b"Channels\t4"),
        bad_file("a.lvm, Channels", "'4'", "names"),
    ),
    _lvm(
        "channels counted by five thousand digits",
        _LVM.replace(b"Channels\t2", b"Channels\t" + b"2" * 5000),
        bad_file("a.lvm, Channels", "names"),
    ),
    _lvm("a word for a number", _LVM.replace(b".000000", b".0000x0", 1), bad_file("a.lvm", "x0")),
)

SCENARIOS = (*DIALECTS, *DAMAGED, *TIMES, *LVM)
