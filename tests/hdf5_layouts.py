"""HDF5 files of one recording, in the layouts that labs use."""

from __future__ import annotations

import h5py
import numpy as np

RATE_HZ = 2000.0
N = 50
NOISE = np.random.default_rng(3).standard_normal((N, 2))
NAMES, UNITS = ["force", "A01"], ["N", "g"]


def add(place, name, samples, unit=None, **attributes):
    dataset = place.create_dataset(name, data=samples)
    dataset.attrs.update(attributes if unit is None else {"unit": unit, **attributes})
    return dataset


def of_file(file):
    add(file, "force", NOISE[:, 0], "N")
    add(file, "A01", NOISE[:, 1], "g")
    file.attrs["sampling_rate_hz"] = RATE_HZ


def of_group(file):
    group = file.create_group("measurement/run_1")
    group.create_dataset("force [N]", data=NOISE[:, 0])
    group.create_dataset("A01 [g]", data=NOISE[:, 1, None])
    group.parent.attrs["sample_rate"] = "2000 Hz"


def of_datasets(file):
    add(file, "force", NOISE[:, 0], np.bytes_("N"), dt=1 / RATE_HZ)
    add(file, "A01", NOISE[:, 1], "g", fs=np.array([RATE_HZ]))


def with_time(file):
    add(file, "time", 1e3 * np.arange(N) / RATE_HZ, "ms")
    add(file, "force", NOISE[:, 0], units="N")
    add(file, "A01", NOISE[:, 1], units="g")


def with_a_number(file):
    of_file(file)
    del file.attrs["sampling_rate_hz"]
    file["fs"] = RATE_HZ


def matrix(file):
    add(file, "data", NOISE, names=NAMES, units=UNITS, fs=RATE_HZ)


def matrix_of_rows(file):
    add(
        file, "data", NOISE.T, channels=np.array(NAMES, "S"), units=np.array(UNITS, "S"), fs=RATE_HZ
    )


def in_chunks(file):
    for column, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True)):
        made = file.create_dataset(name, data=NOISE[:, column], chunks=(7,), shuffle=True)
        made.attrs["unit"] = unit
    file.attrs["Fs"] = RATE_HZ


def compressed(file):
    options = {"compression": "gzip", "fletcher32": True}
    made = file.create_dataset("x", data=NOISE, **options)
    made.attrs.update({"labels": NAMES, "unit": UNITS})
    file.attrs["dt"] = 1 / RATE_HZ


LAYOUTS = [of_file, of_group, of_datasets, with_time, with_a_number, matrix, matrix_of_rows]
LAYOUTS += [in_chunks, compressed]


def written(tmp_path, *writers, **options):
    with h5py.File(tmp_path / "a.h5", "w", **options) as file:
        for write in writers:
            write(file)
    return tmp_path / "a.h5"
