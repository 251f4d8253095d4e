"""One campaign in every format: the same modes, whatever the lab's program wrote."""

import h5py
import nptdms
import numpy as np
import pandas as pd
import pytest
import scipy.io
from systems import (
    TABLE_3_DAMPING,
    TABLE_3_HZ,
    damping_of,
    frequency_hz_of,
    pole,
    responses_to,
    tyre_residues,
    white,
)

import ema
from ema.core.recording import ACCELERATION, FORCE, Channel
from ema.io.text.csv import write_csv
from ema.io.uff.write import write_time_series

RATE_HZ = 1000.0
SENSORS_DEG = {1: (0.0, 45.0, 90.0, 135.0), 2: (180.0, 225.0, 270.0, 315.0)}
REFERENCE_DEG = 20.0
NAMES = ("A01", "A02", "A03", "A04", "REF")
UNITS = ("m/s^2", "g", "m/s^2", "g", "m/s^2")
TO_SI = {"m/s^2": 1.0, "g": 9.80665}
BAND_HZ = (50.0, 160.0)
POLES = pole(TABLE_3_HZ[:4], TABLE_3_DAMPING[:4])

MANIFEST = """schema = 1
[grid]
positions = 8
[excitation]
channel = "force"
position_deg = 0.0
[processing]
averages = 5
"""


@pytest.fixture(scope="module")
def runs():
    """Two runs of 20 s: a force in N, four accelerations, two of them in g, and a reference."""
    return {run: channels_of(run, angles) for run, angles in SENSORS_DEG.items()}


def channels_of(run, angles):
    force = white(20_000, seed=run)
    residues = tyre_residues(np.array([*angles, REFERENCE_DEG]), POLES)
    clean = responses_to(force, RATE_HZ, POLES, residues)
    signals = clean + 1e-3 * clean.std() * white(force.size, seed=10 + run, n_rows=len(NAMES))
    sensors = [
        Channel(name, ACCELERATION, unit, signal / TO_SI[unit], TO_SI[unit])
        for name, unit, signal in zip(NAMES, UNITS, signals, strict=True)
    ]
    return [Channel("force", FORCE, "N", force), *sensors]


def uff(**options):
    return lambda path, channels: write_time_series(path, channels, RATE_HZ, **options)


def comma_table(path, channels):
    write_csv(path, channels, RATE_HZ)


def european_table(path, channels):
    write_csv(path, channels, RATE_HZ)
    text = path.read_text().replace(",", ";").replace(".", ",")
    path.write_bytes(text.replace("\n", "\r\n").encode("cp1252"))


def frame_of(channels):
    columns = {f"{each.name} [{each.unit}]": each.samples for each in channels}
    time_s = pd.Index(np.arange(channels[0].n_samples) / RATE_HZ, name="time")
    return pd.DataFrame(columns, index=time_s)


def parquet(path, channels):
    frame_of(channels).to_parquet(path)


def feather(path, channels):
    frame_of(channels).reset_index().to_feather(path)


def matlab(path, channels):
    names = np.array([each.name for each in channels], dtype=object)
    units = np.array([each.unit for each in channels], dtype=object)
    data = np.stack([each.samples for each in channels], axis=1)
    scipy.io.savemat(path, {"data": data, "names": names, "units": units, "fs": RATE_HZ})


def hdf5(path, channels):
    with h5py.File(path, "w") as file:
        file.attrs["sampling_rate_hz"] = RATE_HZ
        for each in channels:
            file.create_dataset(each.name, data=each.samples).attrs["unit"] = each.unit


def tdms(path, channels):
    with nptdms.TdmsWriter(path) as file:
        for start in range(0, channels[0].n_samples, 6000):
            file.write_segment([tdms_piece(each, slice(start, start + 6000)) for each in channels])


def tdms_piece(channel, piece):
    properties = {"unit_string": channel.unit, "wf_increment": 1 / RATE_HZ}
    return nptdms.ChannelObject("run", channel.name, channel.samples[piece], properties)


SINGLE, DOUBLE = 1e-4, 1e-6
FORMATS = {
    "58 ASCII single": ("uff", uff(binary=False, precision="single"), SINGLE),
    "58 ASCII double": ("uff", uff(binary=False, precision="double"), DOUBLE),
    "58b single": ("uff", uff(precision="single"), SINGLE),
    "58b double": ("uff", uff(precision="double"), DOUBLE),
    "58b single big-endian": ("uff", uff(precision="single", byte_order="big"), SINGLE),
    "58b double big-endian": ("uff", uff(precision="double", byte_order="big"), DOUBLE),
    "CSV": ("csv", comma_table, DOUBLE),
    "European CSV": ("csv", european_table, DOUBLE),
    "Parquet": ("parquet", parquet, DOUBLE),
    "Feather": ("feather", feather, DOUBLE),
    "MATLAB": ("mat", matlab, DOUBLE),
    "HDF5": ("h5", hdf5, DOUBLE),
    "TDMS": ("tdms", tdms, DOUBLE),
}


def modes_of(runs, folder, ending, write):
    """Frequencies in Hz and damping ratios, from a campaign of files."""
    manifest = MANIFEST
    for run, channels in runs.items():
        write(folder / f"run_{run}.{ending}", channels)
        angles = zip(NAMES, (*SENSORS_DEG[run], REFERENCE_DEG), strict=True)
        places = ", ".join(f"{name} = {angle}" for name, angle in angles)
        manifest += f'[[runs]]\nfile = "run_{run}.{ending}"\nreference = "REF"\n'
        manifest += f"positions_deg = {{ {places} }}\n"
    (folder / "campaign.toml").write_text(manifest)
    campaign = ema.read_campaign(folder)
    assert campaign.findings == ()
    frf = ema.estimate_frf(campaign)
    diagram = ema.build_stability(frf, band_hz=BAND_HZ, max_order=30)
    modes = ema.fit_modes(frf, ema.select_poles(diagram)).modes
    return np.array([(mode.frequency_hz, mode.damping_ratio) for mode in modes]).T


@pytest.fixture(scope="module")
def expected(runs, tmp_path_factory):
    """Modes from 58b in double precision, little-endian: the samples as they were made."""
    return modes_of(runs, tmp_path_factory.mktemp("58b"), "uff", uff(precision="double"))


def test_the_modes_are_those_of_the_system(expected):
    frequency_hz, damping = expected
    np.testing.assert_allclose(frequency_hz, frequency_hz_of(POLES), rtol=1e-3)
    np.testing.assert_allclose(damping, damping_of(POLES), rtol=0.02)


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_modes(runs, expected, tmp_path, name):
    ending, write, tolerance = FORMATS[name]
    found = modes_of(runs, tmp_path, ending, write)
    np.testing.assert_allclose(found, expected, rtol=tolerance)
