"""Columnar tables, MATLAB, HDF5, TDMS and WAV files: whole, and then damaged."""

import io
import struct

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet
import scipy.io
from nptdms import ChannelObject, RootObject, TdmsWriter
from scenarios import ACCELERATION, FORCE, RATE_HZ, N, Read, Scenario, bad_file

_FIRST = {"force": tuple(FORCE[:4]), "A01": tuple(ACCELERATION[:4])}
_AS_WRITTEN = Read(first=_FIRST)
_SIGNALS = (FORCE, ACCELERATION)
_UNITS = {"force": "N", "A01": "m/s^2"}


def arrow_table(signals=_SIGNALS):
    """Force and acceleration, units in the metadata of their fields."""
    fields = [
        pa.field("force", pa.float64(), metadata={"unit": "N"}),
        pa.field("A01", pa.float32(), metadata={"unit": "m/s^2"}),
    ]
    return pa.table(
        [signals[0], signals[1].astype(np.float32)],
        schema=pa.schema(fields, metadata={"sampling_rate_hz": "2000"}),
    )


def parquet_file(table=None, **options):
    """Bytes of a Parquet file."""
    sink = io.BytesIO()
    pa.parquet.write_table(arrow_table() if table is None else table, sink, **options)
    return sink.getvalue()


def feather_file(compression="uncompressed", table=None):
    """Bytes of a Feather file."""
    sink = io.BytesIO()
    pa.feather.write_feather(
        arrow_table() if table is None else table, sink, compression=compression
    )
    return sink.getvalue()


def mat_file(variables=None, *, compressed=False):
    """Bytes of a MATLAB file of level 5: a matrix with names, units and rate beside it."""
    if variables is None:
        variables = {
            "data": np.column_stack([FORCE, ACCELERATION]),
            "names": np.array(["force", "A01"], dtype=object),
            "units": np.array(["N", "m/s^2"], dtype=object),
            "fs": RATE_HZ,
        }
    sink = io.BytesIO()
    scipy.io.savemat(sink, variables, do_compression=compressed)
    # The header's text holds the date: the same file every time is easier to compare.
    return b"MATLAB 5.0 MAT-file".ljust(116) + sink.getvalue()[116:]


def hdf5_file(fill=None):
    """Bytes of an HDF5 file; `fill` writes into it, force and acceleration by default."""
    sink = io.BytesIO()
    with h5py.File(sink, "w", track_order=True) as file:
        (fill or _fill_hdf5)(file)
    return sink.getvalue()


def _fill_hdf5(file):
    file.attrs["sampling_rate_hz"] = RATE_HZ
    for (name, unit), values in zip(_UNITS.items(), _SIGNALS, strict=True):
        file.create_dataset(name, data=values).attrs["unit"] = unit


def tdms_file(signals=_SIGNALS):
    """Bytes of a TDMS file."""
    sink = io.BytesIO()
    with TdmsWriter(sink) as writer:
        writer.write_segment(
            [
                RootObject(properties={"name": "run"}),
                *(
                    ChannelObject(
                        "run", name, values, {"unit_string": unit, "wf_increment": 1.0 / RATE_HZ}
                    )
                    for (name, unit), values in zip(_UNITS.items(), signals, strict=True)
                ),
            ]
        )
    return sink.getvalue()


def wav_file(*, n_channels=2, rate=2000, bits=16, kind=1, n_bytes=None, samples=None):
    """Bytes of a WAV file, chunk by chunk; `n_bytes` is what its data chunk claims."""
    if samples is None:
        samples = np.column_stack([FORCE, ACCELERATION]).astype("<i2").tobytes()
    width = n_channels * bits // 8
    form = struct.pack("<HHIIHH", kind, n_channels, rate, rate * width, width, bits)
    claimed = len(samples) if n_bytes is None else n_bytes
    chunks = b"WAVEfmt " + struct.pack("<I", len(form)) + form
    chunks += b"data" + struct.pack("<I", claimed) + samples
    return b"RIFF" + struct.pack("<I", len(chunks)) + chunks


_WHOLE = {
    "a.parquet": parquet_file(),
    "a.feather": feather_file(),
    "a.mat": mat_file(),
    "b.mat": mat_file(compressed=True),
    "a.h5": hdf5_file(),
    "a.tdms": tdms_file(),
}


def _case(name, file, content, expected, pending=""):
    ending = file.rpartition(".")[2]
    return Scenario(f"{ending} {name}", {file: content}, expected, file, pending)


WHOLE = (
    *(_case(f"whole, {file}", file, content, _AS_WRITTEN) for file, content in _WHOLE.items()),
    _case("compressed", "a.feather", feather_file("lz4"), _AS_WRITTEN),
    _case("whole", "a.wav", wav_file(), bad_file("a.wav", "no force among channels")),
)

# Every format, spoilt in the same ways: never read short, never anything but a named fault.
EVERY = tuple(
    case
    for file, content in {**_WHOLE, "a.wav": wav_file()}.items()
    for case in (
        _case(f"empty, {file}", file, b"", bad_file(file, "empty")),
        _case(f"cut to half, {file}", file, content[: len(content) // 2], bad_file(file)),
        _case(f"cut to 20 bytes, {file}", file, content[:20], bad_file(file)),
        _case(f"zeros, {file}", file, bytes(len(content)), bad_file(file)),
        _case(f"another format within, {file}", file, b"%PDF-1.7\n" * 100, bad_file(file)),
    )
)


def _huge(file):
    file.create_dataset("force", shape=(10**12,), dtype="f8", chunks=(1024,))


def _outside(file):
    file["A01"] = h5py.ExternalLink("/etc/hostname", "/x")


def _fields_of_numbers(table, **changes):
    return table.replace_schema_metadata(changes)


CLAIMS = (
    _case("10^12 samples, nothing stored", "a.h5", hdf5_file(_huge), bad_file("a.h5", "claimed")),
    _case("a link to another file", "a.h5", hdf5_file(_outside), bad_file("a.h5", "link")),
    _case(
        "text alone",
        "a.h5",
        hdf5_file(lambda file: file.create_dataset("x", data="loud")),
        bad_file("a.h5", "x"),
    ),
    _case(
        "text alone",
        "a.parquet",
        parquet_file(pa.table({"a": ["x", "y"]})),
        bad_file("a.parquet", "column"),
    ),
    _case(
        "a buffer that claims a terabyte",
        "a.feather",
        feather_file("lz4").replace(struct.pack("<q", 8 * N), struct.pack("<q", 1 << 40)),
        bad_file("a.feather", "109951162\\d+ bytes of numbers claimed"),
    ),
    _case(
        "cut in its last mark", "a.feather", feather_file()[:-3], bad_file("a.feather", "cut short")
    ),
    _case(
        "a rate of zero",
        "a.parquet",
        parquet_file(_fields_of_numbers(arrow_table(), sampling_rate_hz="0")),
        bad_file("a.parquet", "sampling_rate_hz", "positive"),
    ),
    _case(
        "two rates",
        "a.parquet",
        parquet_file(_fields_of_numbers(arrow_table(), fs="2000", dt="0.001")),
        bad_file("a.parquet", "2000 Hz", "1000 Hz"),
    ),
    _case(
        "two matrices",
        "a.mat",
        mat_file({"a": np.ones((9, 2)), "b": np.ones((9, 2))}),
        bad_file("a.mat", "a, b"),
    ),
    _case(
        "names that do not fit",
        "a.mat",
        mat_file({"data": np.ones((64, 2)), "names": np.array(["x"] * 3, dtype=object), "fs": 1.0}),
        bad_file("a.mat", "64 × 2 and 3 names"),
    ),
    _case(
        "a step of zero",
        "a.mat",
        mat_file({"a": FORCE, "dt": 0.0}),
        bad_file("a.mat", "dt", "positive"),
    ),
    _case(
        "vectors of different lengths",
        "a.mat",
        mat_file({"force": FORCE, "A01": ACCELERATION[:60], "fs": RATE_HZ}),
        bad_file("a.mat", "64 samples of 'force', 60 of 'A01'"),
    ),
    _case(
        "data claim four gigabytes",
        "a.wav",
        wav_file(n_bytes=0xFFFFFFF0),
        bad_file("a.wav", "truncated|claim|stored"),
    ),
    _case("no channels", "a.wav", wav_file(n_channels=0), bad_file("a.wav", "channels?")),
    _case("a rate of zero", "a.wav", wav_file(rate=0), bad_file("a.wav", "rate|0 Hz")),
    _case("a compressed kind", "a.wav", wav_file(kind=0x55), bad_file("a.wav")),
)

SCENARIOS = (*WHOLE, *EVERY, *CLAIMS)
