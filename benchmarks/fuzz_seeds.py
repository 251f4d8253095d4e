"""Small valid files of each format, the seeds of fuzzing: python benchmarks/fuzz_seeds.py.

They are written by the builders of the test scenarios, into `fuzz_corpus/`.
"""

from __future__ import annotations

import gzip
import sys
from pathlib import Path

import numpy as np
from fuzz_files import BESIDE, CORPUS

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
import scenarios_binary as binary
from builders import ascii58, fixed, frf58, nodes15, nodes2411, units164
from scenarios import ACCELERATION, FORCE, RATE_HZ, N, force, sensor, table
from scenarios_campaign import MANIFEST, RUNS
from scenarios_text import lvm_file
from uff_datasets import nodes_in, shape55, shape2414, system18, system2420


def universal_files() -> dict[str, bytes]:
    """Return datasets 58 of all kinds, nodes and units."""
    circle = {1: (0.3, 0.0, 0.0), 2: (0.0, 0.3, 0.0), 3: (-0.3, 0.0, 0.0), 4: (0.0, -0.3, 0.0)}
    more = sensor(name="A02", node=2, direction=-3)
    newton = (13, 0, 0, "Force", "N")
    text = ascii58(fixed(FORCE), name="force", node=0, n=N, axis=newton)
    return {
        "binary": force() + sensor() + more,
        "big_endian": force(big=True, ordinate=4) + sensor(big=True),
        "ascii": text + ascii58(fixed(ACCELERATION, 20, 12, 4), n=N, ordinate=4),
        "geometry": units164(1.0, 1.0) + nodes15(circle) + force() + sensor() + more,
        "nodes_2411": nodes2411(circle) + force() + sensor(),
        "frf": frf58([1 + 1j, 2, 3, 4 - 1j]) + frf58([2, 3, 4, 5j], node=2),
    }


def geometries() -> dict[str, bytes]:
    """Return nodes in coordinate systems of their own, and mode shapes on them."""
    circle = {1: (0.3, 0.0, 0.0), 2: (0.3, 90.0, 0.0)}
    polar = system2420(7, 1, np.eye(3), (0.0, 0.1, 0.0))
    complex_shape = {1: [1 + 1j, 0j, 2j], 2: [-1j, 0.5 + 0j, 0j]}
    return {
        "system_18": system18(7, kind=1) + nodes_in(7, circle) + force() + sensor(),
        "system_2420": polar + nodes_in(7, circle) + force() + sensor() + shape55(),
        "shape_2414": nodes2411(circle) + shape2414(),
        "shape_complex": shape55(complex_shape, analysis=3, kind=5, reals=(-1.0, 400.0) * 3),
    }


def tables() -> dict[str, bytes]:
    """Return tables in several dialects."""
    text = "".join(table().splitlines(keepends=True)[:9])
    heading = text.partition("\n")[0]
    european = text.replace(",", ";").replace(".", ",")
    rate = "Tyre 4711\nSampling rate [Hz],2000\n\n"
    return {
        "plain": text.encode(),
        "european": european.encode(),
        "tabs": text.replace(",", "\t").replace("\n", "\r\n").encode(),
        "latin_1": text.replace("force", "Prüfkraft").encode("latin-1"),
        "utf_16": european.encode("utf-16"),
        "units_row": text.replace(heading, "time,force,A01\ns,N,m/s^2").encode(),
        "preamble": (rate + "force,A01\nN,g\n1.5,2\n-1e-3,4\n0,1\n").encode(),
        "gaps": text.replace(",-", ",NaN-").replace("NaN-", "").encode(),
    }


def matlab_files() -> dict[str, bytes]:
    """Return files of level 5 in several layouts."""
    vectors = {"force": FORCE, "A01": ACCELERATION.astype(np.int16), "fs": RATE_HZ}
    return {
        "matrix": binary.mat_file(),
        "compressed": binary.mat_file(compressed=True),
        "vectors": binary.mat_file(vectors),
        "struct": binary.mat_file({"run": {**vectors, "units": {"force": "N", "A01": "g"}}}),
    }


def _matrix(file) -> None:
    matrix = file.create_dataset("run/data", data=np.column_stack([FORCE, ACCELERATION]))
    matrix.attrs["names"] = ["force [N]", "A01 [g]"]
    matrix.attrs["fs"] = RATE_HZ
    file.create_dataset("time", data=np.arange(N) / RATE_HZ, chunks=(16,), compression="gzip")


def main() -> None:
    """Write the corpus."""
    written = {
        "uff": universal_files() | geometries(),
        "csv": tables(),
        "gzip": {name: gzip.compress(text, mtime=0) for name, text in tables().items()},
        "lvm": {"plain": lvm_file(), "comma": lvm_file(decimal=",")},
        "parquet": {
            "plain": binary.parquet_file(compression="none", use_dictionary=False),
            "snappy": binary.parquet_file(),
        },
        "feather": {"plain": binary.feather_file(), "lz4": binary.feather_file("lz4")},
        "matlab": matlab_files(),
        "hdf5": {"vectors": binary.hdf5_file(), "matrix": binary.hdf5_file(_matrix)},
        "tdms": {"plain": binary.tdms_file()},
        "wav": {"int16": binary.wav_file()},
        "manifest": {"whole": MANIFEST.encode()},
        BESIDE: RUNS,
    }
    for kind, files in written.items():
        folder = CORPUS / kind
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            (folder / name).write_bytes(content)


if __name__ == "__main__":
    main()
