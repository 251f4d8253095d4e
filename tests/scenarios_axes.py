"""Rates, starts and axes as files print them: rounded, shifted, in other units, more than once."""

import io
from datetime import datetime, timedelta

import numpy as np
import scipy.io
from nptdms import ChannelObject, TdmsWriter
from scenarios import ACCELERATION, FORCE, RATE_HZ, N, Read, Scenario, bad_file, bad_manifest
from scenarios_text import lvm_file

_LONG = 600
_FORCE = np.random.default_rng(3).integers(-100, 100, 8192).astype(float)
_MOTION = np.random.default_rng(4).integers(-100, 100, 8192).astype(float)


def rows(*columns, header, separator=","):
    """A table of columns of numbers or texts."""
    lines = [separator.join(map(str, cells)) for cells in zip(*columns, strict=True)]
    return "\n".join([header, *lines, ""])


def printed(rate_hz, decimals, n=_LONG, factor=1.0):
    """Times of an even grid, rounded."""
    return [f"{factor * k / rate_hz:.{decimals}f}" for k in range(n)]


def _csv(name, content, expected):
    return Scenario(f"axis {name}", {"a.csv": content.encode()}, expected, "a.csv")


def _timed(times, header="time [s],force [N],A01 [m/s^2]", skipped=None):
    columns = [times, _FORCE[: len(times)], _MOTION[: len(times)]]
    kept = [k for k in range(len(times)) if k != skipped]
    return rows(*([column[k] for k in kept] for column in columns), header=header)


def _plain(above):
    signals = FORCE, ACCELERATION
    return above + rows(*signals, header="force [N],A01 [m/s^2]")


_RATES = {rate: rate for rate in (1024, 2048, 5120, 2560, 8192, 25600)}
_RATES[51200] = 50000  # 0.000020 s may be either, which is a warning
STEPS = (
    *(
        Scenario(
            f"axis Delta_X of six decimals, {rate} Hz",
            {"a.lvm": lvm_file(delta=f"{1 / rate:.6f}", time=False)},
            Read(rate_hz=taken, findings=(r"Delta_X = 0\.0.* leaves .* to ",)),
            "a.lvm",
        )
        for rate, taken in _RATES.items()
    ),
    *(
        _csv(
            f"dt line of {digits} decimals, {rate} Hz",
            _plain(f"# dt = {1 / rate:.{digits}f}\n"),
            Read(rate_hz=rate),
        )
        for rate, digits in ((1024, 6), (2048, 6), (2048, 7), (5120, 7), (51200, 8), (500, 3))
    ),
    *(
        Scenario(
            f"axis manifest rate {rate} Hz beside a printed step",
            {
                "a.csv": _plain("# dt = 0.000488\n").encode(),
                "campaign.toml": (
                    f"schema = 1\n[acquisition]\nsampling_rate_hz = {rate}\n"
                    '[excitation]\nchannel = "force"\n[[runs]]\nfile = "a.csv"\n'
                ).encode(),
            },
            expected,
        )
        for rate, expected in (
            (2050.0, Read(rate_hz=2050.0)),
            (2048.0, Read(rate_hz=2048.0)),
            (2000.0, bad_manifest("2000 Hz", "2048", "2047.* to 2051")),
        )
    ),
)

_DROPPED = bad_file("a.csv, column 'time'", "equal steps")
ROUNDED = (
    *(
        _csv(f"times of {decimals} decimals, {rate} Hz", _timed(printed(rate, decimals)), expected)
        for rate, decimals in ((512, 3), (1024, 3), (2048, 3), (4096, 3), (2048, 4), (4096, 4))
        for expected in [Read(rate_hz=rate)]
    ),
    *(
        _csv(
            f"sample {skipped} dropped among times of {decimals} decimals, {rate} Hz",
            _timed(printed(rate, decimals), skipped=skipped),
            _DROPPED,
        )
        for rate, decimals in ((512, 3), (1024, 3), (2048, 4), (4096, 4))
        for skipped in (100, 300, 590)
    ),
)


def _tdms(starts_s):
    sink = io.BytesIO()
    begin = np.datetime64("2026-03-04T10:00:00", "us")
    with TdmsWriter(sink) as writer:
        writer.write_segment(
            [
                ChannelObject(
                    "run",
                    name,
                    samples,
                    {
                        "unit_string": unit,
                        "wf_increment": 1 / RATE_HZ,
                        "wf_start_time": begin + np.timedelta64(round(start * 1e6), "us"),
                    },
                )
                for name, unit, samples, start in zip(
                    ("force", "A01"), ("N", "m/s^2"), (FORCE, ACCELERATION), starts_s, strict=True
                )
            ]
        )
    return sink.getvalue()


_SHIFTED = Read(
    first={"force": tuple(FORCE[4:8]), "A01": tuple(ACCELERATION[:4])},
    findings=("begins 0.002 s after 'force'",),
)
STARTS = (
    Scenario("axis TDMS starts four samples apart", {"a.tdms": _tdms((0, 0.002))}, _SHIFTED),
    Scenario(
        "axis TDMS starts half a sample apart",
        {"a.tdms": _tdms((0, 0.00225))},
        bad_file("a.tdms", "whole samples apart", "4.5 samples"),
    ),
    Scenario(
        "axis LVM starts four samples apart",
        {"a.lvm": lvm_file(starts=("0.000000", "0.002000"), time=False)},
        _SHIFTED,
    ),
    Scenario(
        "axis LVM starts half a sample apart",
        {"a.lvm": lvm_file(starts=("0.000000", "0.002250"), time=False)},
        bad_file("a.lvm", "whole samples apart"),
    ),
)

_AS_WRITTEN = Read(first={"force": tuple(_FORCE[:4]), "A01": tuple(_MOTION[:4])})
_FINE = Read(rate_hz=2000.0, first=_AS_WRITTEN.first)
UNITS = tuple(
    _csv(
        f"times under {header.partition(',')[0]}",
        _timed(printed(2000, decimals, N, factor), header),
        _AS_WRITTEN,
    )
    for unit, factor, decimals in (
        ("ms", 1e3, 1),
        ("us", 1e6, 0),
        ("µs", 1e6, 0),
        ("ns", 1e9, 0),
        ("min", 1 / 60, 10),
    )
    for header in (
        f"time [{unit}],force [N],A01 [m/s^2]",
        f"Zeit ({unit}),force [N],A01 [m/s^2]",
        f"time_{unit},force [N],A01 [m/s^2]",
        f"Zeit in {unit},force [N],A01 [m/s^2]",
        f"Elapsed Time/{unit},force [N],A01 [m/s^2]",
    )
)
UNITS += tuple(
    _csv(f"a count of date and time, {name}", _timed(times, f"{name},force [N],A01 [m/s^2]"), _FINE)
    for name, times in {
        "Date/Time": [f"{46354.4 + k / 2000 / 86400:.12f}" for k in range(N)],
        "timestamp": [1764350000 * 10**9 + 500_000 * k for k in range(N)],
        "Timestamp_ns": [1764350000 * 10**9 + 500_000 * k for k in range(N)],
        "TimeUs": [1764350000 * 10**6 + 500 * k for k in range(N)],
        "millis": [f"{k / 2:.1f}" for k in range(N)],
    }.items()
)


def _blocks(n_blocks, *, goes_on, time=True, size=32):
    """Blocks of several writes below one header, whose count is that of one block."""
    whole = lvm_file(samples=size, rows=n_blocks * size, time=time)
    if goes_on or not time:
        return whole
    lines = whole.split(b"\r\n")
    first = next(k for k, line in enumerate(lines) if line.startswith(b"X_Value")) + 1
    stamps = [lines[first + k].partition(b"\t")[0] for k in range(size)]
    for k in range(size, n_blocks * size):
        lines[first + k] = stamps[k % size] + lines[first + k][len(stamps[0]) :]
    return b"\r\n".join(lines)


def _beside(count, step, unit, cell=""):
    """A third channel beside force and A01, with `count` samples."""
    lines = lvm_file().decode().split("\r\n")
    start = next(k for k, line in enumerate(lines) if line.startswith("Channels"))
    more = {"Channels": None, "Samples": count, "Y_Unit_Label": unit, "X_Dimension": "Time"}
    more |= {"X0": "0", "Delta_X": step, "X_Value": "T1"}
    for k in range(start, len(lines)):
        key, *cells = lines[k].split("\t")
        if key == "Channels":
            lines[k] = "Channels\t3\t\t\t"
        elif key in more:
            lines[k] = "\t".join([key, *cells[:2], more[key], *cells[2:]])
        elif key and key[0].isdigit():
            lines[k] = "\t".join([key, *cells[:2], cell if k < start + 12 else "", *cells[2:]])
    return "\r\n".join(lines).encode()


WRITES = (
    Scenario(
        "axis LVM with one header, time goes on",
        {"a.lvm": _blocks(2, goes_on=True)},
        Read(first={"A01": tuple(ACCELERATION)}, findings=("64 rows .* one recording",)),
        "a.lvm",
    ),
    Scenario(
        "axis LVM with one header, time starts again",
        {"a.lvm": _blocks(2, goes_on=False)},
        Read(
            first={"A01": tuple(ACCELERATION[:32])},
            findings=("again in row 33: the first of 2 events",),
        ),
        "a.lvm",
    ),
    Scenario(
        "axis LVM with one header, without time",
        {"a.lvm": _blocks(2, goes_on=True, time=False)},
        Read(first={"A01": tuple(ACCELERATION)}, findings=("taken as one recording",)),
        "a.lvm",
    ),
    Scenario(
        "axis LVM with a channel that is not wired",
        {"a.lvm": _beside("", "", "")},
        Read(findings=("'T1': not wired",)),
        "a.lvm",
    ),
    Scenario(
        "axis LVM with a channel of no samples",
        {"a.lvm": _beside("0", "0.0005", "m/s^2")},
        Read(findings=("'T1': 0 samples",)),
        "a.lvm",
    ),
    Scenario(
        "axis LVM with a slow channel beside",
        {"a.lvm": _beside("4", "0.008", "Deg C", "21.5")},
        Read(findings=("'T1': 4 samples beside 64",)),
        "a.lvm",
    ),
    Scenario(
        "axis LVM with a slow accelerometer",
        {"a.lvm": _beside("4", "0.008", "g", "21.5")},
        bad_file("a.lvm, Delta_X", "0.0005, 0.008", "one sampling rate"),
    ),
)


def _pairs(first, second, header="time [s],force [N],time 2 [s],A01 [m/s^2]"):
    """A column of time for each channel; the shorter one leaves cells empty at its end."""
    length = max(len(first), len(second))
    columns = [first, list(_FORCE[: len(first)]), second, list(_MOTION[: len(second)])]
    return rows(*([*each, *[""] * (length - len(each))] for each in columns), header=header)


_HALF = printed(1000, 4, N)
_FULL = printed(2000, 4, N)
_FEW = printed(2000, 4, N - 10)
SEVERAL = (
    _csv("two equal columns of time", _pairs(_FULL, _FULL), _AS_WRITTEN),
    _csv(
        "two equal columns of time with one name",
        _pairs(_FULL, _FULL, "time [s],force [N],time [s],A01 [m/s^2]"),
        _AS_WRITTEN,
    ),
    _csv(
        "a second column of time, shifted by four samples",
        _pairs(_FULL, [f"{(k + 4) / 2000:.4f}" for k in range(N)]),
        Read(
            first={"force": tuple(_FORCE[4:8]), "A01": tuple(_MOTION[:4])},
            findings=("begins 0.002 s after 'force'",),
        ),
    ),
    _csv(
        "a second column of time, shifted by a part of a sample",
        _pairs(_FULL, [f"{(k + 0.4) / 2000:.5f}" for k in range(N)]),
        bad_file("a.csv", "whole samples apart"),
    ),
    _csv(
        "different columns of time, all in front of the channels",
        rows(
            *(_FULL, [f"{(k + 4) / 2000:.4f}" for k in range(N)], _FORCE[:N], _MOTION[:N]),
            header="time [s],time 2 [s],force [N],A01 [m/s^2]",
        ),
        bad_file("a.csv", "'time'", "in front of its channels"),
    ),
    _csv(
        "a second column of time at another rate",
        _pairs(_HALF, _FULL),
        bad_file("a.csv", "1000 Hz", "2000 Hz"),
    ),
    _csv(
        "a second column of time at another rate, shorter",
        _pairs(_FULL, _HALF[: N // 2]),
        bad_file("a.csv", "1000 Hz", "2000 Hz"),
    ),
    _csv(
        "a second column of time, shorter",
        _pairs(_FULL, _FEW),
        Read(first=_AS_WRITTEN.first, findings=("cut to the shorter",)),
    ),
    _csv(
        "a count beside the time",
        rows(range(N), _FULL, _FORCE[:N], _MOTION[:N], header="no,time [s],force [N],A01 [m/s^2]"),
        Read(first=_AS_WRITTEN.first, findings=("'no' rises evenly by 1",)),
    ),
    _csv(
        "a count and a rate above",
        "# sampling rate: 2000 Hz\n"
        + rows(range(N), _FORCE[:N], _MOTION[:N], header="sample,force [N],A01 [m/s^2]"),
        Read(first=_AS_WRITTEN.first, findings=("'sample' rises evenly by 1",)),
    ),
)


def _clock(form, start="2026-03-01 12:00:00", rate_hz=500, n=N, zone=""):
    """Times of day or dates in a form of strftime."""
    begin = datetime.fromisoformat(start)
    return [(begin + timedelta(seconds=k / rate_hz)).strftime(form) + zone for k in range(n)]


_MIDNIGHT = {"start": "2026-03-01 23:59:59.950"}
_CLOCKS = Read(rate_hz=500.0)
_KINDS = {
    "German dates": (";", "%d.%m.%Y %H:%M:%S,%f", {}),
    "German dates over midnight": (";", "%d.%m.%Y %H:%M:%S,%f", _MIDNIGHT),
    "American dates": (",", "%m/%d/%Y %I:%M:%S.%f %p", {}),
    "American dates over noon": (
        ",",
        "%m/%d/%Y %I:%M:%S.%f %p",
        {"start": "2026-03-01 11:59:59.9"},
    ),
    "American dates over midnight": (",", "%m/%d/%Y %I:%M:%S.%f %p", _MIDNIGHT),
    "dates of days below 13 over midnight": (
        ",",
        "%d/%m/%y %H:%M:%S.%f",
        {"start": "2026-04-03 23:59:59.9"},
    ),
    "the end of a month": (",", "%d/%m/%Y %H:%M:%S.%f", {"start": "2026-04-30 23:59:59.9"}),
    "ISO with an offset": (",", "%Y-%m-%dT%H:%M:%S.%f", {"zone": "+01:00"}),
    "ISO with a short offset": ("\t", "%Y-%m-%dT%H:%M:%S.%f", {"zone": "-0530"}),
    "ISO in UTC over midnight": (",", "%Y-%m-%dT%H:%M:%S.%f", _MIDNIGHT | {"zone": "Z"}),
    "times of day over midnight": (",", "%H:%M:%S.%f", _MIDNIGHT),
    "months by name over midnight": (",", "%d-%b-%Y %H:%M:%S.%f", _MIDNIGHT),
    "months in front": (";", "%b %d, %Y %H:%M:%S.%f", _MIDNIGHT),
    "German months": (";", "%d. Mär. %Y %H:%M:%S,%f", {}),
    "days without marks": (",", "%Y%m%d %H:%M:%S.%f", _MIDNIGHT),
    "parts of a second behind a colon": (",", "%d.%m.%Y %H:%M:%S:%f", {}),
    "a zone by name": (",", "%Y-%m-%d %H:%M:%S.%f", {"zone": " UTC"}),
    "days since the start": (",", "%-d days %H:%M:%S.%f", _MIDNIGHT),
    "minutes alone over the hour": (",", "%M:%S.%f", _MIDNIGHT),
    "hours of one digit": (",", "%-H:%M:%S.%f", {"start": "2026-03-01 09:59:59.9"}),
}


def _stamped(separator, *columns, heading):
    """A table that begins with columns of stamps."""
    comma = "," if separator == ";" else "."
    signals = [[f"{v:.1f}".replace(".", comma) for v in each[:N]] for each in (_FORCE, _MOTION)]
    header = separator.join([*heading, "force [N]", "A01 [m/s^2]"])
    return rows(*columns, *signals, header=header, separator=separator)


_GAP = _clock("%d.%m.%Y %H:%M:%S.%f", **_MIDNIGHT)
CLOCKS = (
    *(
        _csv(
            f"stamps, {name}", _stamped(sign, _clock(form, **more), heading=["Date/Time"]), _CLOCKS
        )
        for name, (sign, form, more) in _KINDS.items()
    ),
    *(
        _csv(
            f"date and clock in two columns, {name}",
            _stamped(
                sign, _clock(date, **more), _clock(form, **more), heading=["Datum", "Uhrzeit"]
            ),
            _CLOCKS,
        )
        for name, sign, date, form, more in (
            ("German", ";", "%d.%m.%Y", "%H:%M:%S,%f", {}),
            ("blanks", " ", "%d.%m.%Y", "%H:%M:%S.%f", {}),
            ("over midnight", ";", "%d.%m.%Y", "%H:%M:%S,%f", _MIDNIGHT),
            ("American", ",", "%m/%d/%Y", "%I:%M:%S.%f %p", {}),
        )
    ),
    _csv(
        "stamps without a name, an index of pandas",
        _stamped(",", _clock("%Y-%m-%d %H:%M:%S.%f"), heading=[""]),
        _CLOCKS,
    ),
    _csv(
        "stamps, days left out",
        _stamped(",", [each.replace("02.03", "05.03") for each in _GAP], heading=["t"]),
        bad_file("a.csv", "one day after another"),
    ),
    _csv(
        "stamps, a dropped sample at midnight",
        _stamped(
            ",",
            [*_GAP[:25], *_clock("%d.%m.%Y %H:%M:%S.%f", **_MIDNIGHT, n=N + 1)[26:]],
            heading=["t"],
        ),
        bad_file("a.csv", "equal steps"),
    ),
)


def _mat(**variables):
    sink = io.BytesIO()
    scipy.io.savemat(sink, variables)
    return sink.getvalue()


_MATRIX = np.column_stack([np.arange(N) / 2048, FORCE, ACCELERATION])
MATRICES = (
    Scenario(
        "axis MAT matrix [t x y] without names",
        {"a.mat": _mat(data=_MATRIX)},
        bad_file("no force among channels channel 2 .*, channel 3 "),
    ),
    Scenario(
        "axis MAT matrix [t x y] with names",
        {
            "a.mat": _mat(
                data=_MATRIX,
                names=np.array(["x_axis", "force", "A01"], dtype=object),
                units=np.array(["s", "N", "m/s^2"], dtype=object),
            )
        },
        Read(rate_hz=2048.0),
    ),
)

SCENARIOS = (*STEPS, *ROUNDED, *STARTS, *UNITS, *WRITES, *SEVERAL, *CLOCKS, *MATRICES)
