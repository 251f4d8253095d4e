"""Good inputs of all commands, made once: campaigns in every format, results, a library."""

from __future__ import annotations

import gzip
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
import io

import h5py
import pyarrow as pa
import scenarios_binary as binary
from builders import ascii58, binary58, fixed, nodes2411
from nptdms import ChannelObject, RootObject, TdmsWriter
from tyre_property_files import content as tir_content
from uff_datasets import shape55, shape2414

from ema.io.formats import is_recording, read_file
from pipelines.library.library import TyreLibrary
from pipelines.process.run import process
from pipelines.report.write import save
from pipelines.results.options import Options
from pipelines.simulate.campaign import simulate_campaign
from pipelines.storage.checksums import FILES, OWN, write_marker

CHANNELS_AND_SAMPLES = tuple[list[str], np.ndarray]
RATE_HZ = 2000.0
DURATION_S = 2.0
N_RUNS = 6
_UNITS = ("N", "m/s^2")
_STRUCTURE_MANIFEST = """\
schema = 1

[excitation]
channel = "force"

[[runs]]
file = "config_1.uff"
"""


def _units(names: list[str]) -> list[str]:
    return [_UNITS[name != "force"] for name in names]


def _uff(names: list[str], samples: np.ndarray, *, text: bool = False, big: bool = False) -> bytes:
    parts = []
    for name, values in zip(names, samples, strict=True):
        axis = (13, 0, 0, "Force", "N") if name == "force" else (12, 0, 0, "Acceleration", "m/s^2")
        header = {"name": name, "n": values.size, "axis": axis, "node": 0}
        if text:
            parts.append(ascii58(fixed(values, 20, 12, 4), ordinate=4, **header))
        else:
            with np.errstate(over="ignore"):  # beyond single precision: infinite, as a logger does
                payload = values.astype(">f4" if big else "<f8").tobytes()
            parts.append(binary58(payload, big=big, ordinate=2 if big else 4, **header))
    return b"".join(parts)


def _table(
    names: list[str], samples: np.ndarray, separator: str = ",", decimal: str = "."
) -> bytes:
    head = separator.join(
        ["time [s]", *(f"{n} [{u}]" for n, u in zip(names, _units(names), strict=True))]
    )
    rows = [
        separator.join([f"{k / RATE_HZ:.4f}", *(f"{v:.6g}" for v in row)])
        for k, row in enumerate(samples.T.tolist())
    ]
    return "\n".join([head, *(row.replace(".", decimal) for row in rows), ""]).encode()


def _arrow(names: list[str], samples: np.ndarray) -> pa.Table:
    fields = [
        pa.field(name, pa.float64(), metadata={"unit": unit})
        for name, unit in zip(names, _units(names), strict=True)
    ]
    schema = pa.schema(fields, metadata={"sampling_rate_hz": f"{RATE_HZ:g}"})
    return pa.table(list(samples), schema=schema)


def _matlab(names: list[str], samples: np.ndarray, *, compressed: bool) -> bytes:
    variables = {
        "data": samples.T,
        "names": np.array(names, dtype=object),
        "units": np.array(_units(names), dtype=object),
        "fs": RATE_HZ,
    }
    return binary.mat_file(variables, compressed=compressed)


def _matlab_73(names: list[str], samples: np.ndarray) -> bytes:
    """A file of MATLAB's level 7.3: HDF5 behind 512 bytes of its own."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mat"
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, values in zip((*names, "fs"), (*samples, RATE_HZ), strict=True):
                stored = file.create_dataset(name, data=np.reshape(values, (1, -1)))
                stored.attrs["MATLAB_class"] = np.bytes_("double")
        content = bytearray(path.read_bytes())
    content[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM"
    return bytes(content)


def _hdf5(names: list[str], samples: np.ndarray) -> bytes:
    def fill(file) -> None:
        file.attrs["sampling_rate_hz"] = RATE_HZ
        for name, unit, values in zip(names, _units(names), samples, strict=True):
            file.create_dataset(name, data=values).attrs["unit"] = unit

    return binary.hdf5_file(fill)


def _tdms(names: list[str], samples: np.ndarray) -> bytes:

    sink = io.BytesIO()
    with TdmsWriter(sink) as writer:
        channels = [
            ChannelObject("run", n, v, {"unit_string": u, "wf_increment": 1.0 / RATE_HZ})
            for n, u, v in zip(names, _units(names), samples, strict=True)
        ]
        writer.write_segment([RootObject(properties={"name": "run"}), *channels])
    return sink.getvalue()


# Ending of a file → how named channels become its bytes.
WRITERS: dict[str, Callable[[list[str], np.ndarray], bytes]] = {
    "uff": _uff,
    "unv": lambda n, s: _uff(n, s, text=True),
    "big.uff": lambda n, s: _uff(n, s, big=True),
    "csv": _table,
    "tsv": lambda n, s: _table(n, s, "\t"),
    "eu.csv": lambda n, s: _table(n, s, ";", ","),
    "csv.gz": lambda n, s: gzip.compress(_table(n, s), 1, mtime=0),
    "parquet": lambda n, s: binary.parquet_file(_arrow(n, s)),
    "feather": lambda n, s: binary.feather_file("lz4", _arrow(n, s)),
    "mat": lambda n, s: _matlab(n, s, compressed=True),
    "v73.mat": _matlab_73,
    "h5": _hdf5,
    "tdms": _tdms,
}


def signals_of(path: Path) -> CHANNELS_AND_SAMPLES:
    """Names and samples in SI of a recording of the simulated campaign."""
    recording = read_file(path).recording
    names = [channel.name for channel in recording.channels]
    return names, np.stack(
        [np.asarray(c.samples, float) * c.scale_to_si for c in recording.channels]
    )


def make_seeds(folder: Path) -> None:
    """Write all good inputs below a folder."""
    campaigns, results = folder / "campaigns", folder / "results"
    campaigns.mkdir(parents=True)
    plain = simulate_campaign(campaigns / "uff", duration_s=DURATION_S)
    signals = {path.stem: signals_of(path) for path in sorted(plain.glob("*.uff"))}
    np.savez(
        folder / "signals.npz",
        names=signals["config_1"][0],
        **{name: samples for name, (_, samples) in signals.items()},
    )
    manifest = (plain / "campaign.toml").read_text()
    for ending, write in WRITERS.items():
        if ending == "uff" or not is_recording(Path(f"a.{ending}")):
            continue
        there = campaigns / ending
        there.mkdir()
        for name, (names, samples) in signals.items():
            (there / f"{name}.{ending}").write_bytes(write(names, samples))
        (there / "campaign.toml").write_text(manifest.replace(".uff", f".{ending}"))
    structure = campaigns / "structure"
    structure.mkdir()
    shutil.copy(plain / "config_1.uff", structure)
    (structure / "campaign.toml").write_text(_STRUCTURE_MANIFEST)
    other = simulate_campaign(folder / "other", duration_s=DURATION_S, seed=2, split_percent=2.0)
    for name, source, options, report in (
        ("tyre", plain, Options(), False),
        ("reported", plain, Options(), True),
        ("other", other, Options(max_order=40), False),
        ("modes_only", plain, Options(tune=False), False),
        ("structure", structure, Options(tune=False), False),
    ):
        save(process(source, options), results / name, report=report)
    _settle(results)
    library = TyreLibrary(folder / "library")
    for name in ("tyre", "other", "reported"):
        library.add(results / name, author="me", note="first")
    library.add(results / "other", author="me", tyre_id="winter")
    library.tyre("225-55R17").approve(2, "me", "good")
    (folder / "tyre.tir").write_bytes(tir_content())
    (folder / "mm.tir").write_bytes(tir_content(in_mm=True))
    (folder / "shapes.uff").write_bytes(_ring_shapes())


def _settle(results: Path) -> None:
    """Give what differs from run to run (times) one value: the same seed changes the same bytes."""
    for path in results.glob("*/provenance.json"):
        record = json.loads(path.read_text())
        record["stage_seconds"] = dict.fromkeys(record["stage_seconds"], 0.1)
        del record[FILES], record[OWN]
        write_marker(path, record)


def _ring_shapes() -> bytes:
    """Nodes around a circle and two shapes on them, as a finite-element program writes them."""
    angles = np.deg2rad(np.arange(0, 360, 10))
    nodes = {k + 1: (0.33 * np.cos(a), 0.33 * np.sin(a), 0.0) for k, a in enumerate(angles)}
    shapes = {
        k + 1: [float(np.cos(2 * a) * np.cos(a)), float(np.cos(2 * a) * np.sin(a)), 0.0]
        for k, a in enumerate(angles)
    }
    return nodes2411(nodes) + shape55(shapes) + shape2414(shapes)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    make_seeds(Path(sys.argv[1]))
