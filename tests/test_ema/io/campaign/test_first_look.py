"""Reading leaves samples on disk alone; whoever needs one has them all looked at before."""

import gc
import os
import weakref
from dataclasses import replace

import numpy as np
import pytest
import scipy.io

import ema
from ema.core import files
from ema.core.errors import RecordingFormatError
from ema.core.finding import Check
from ema.core.recording import ACCELERATION, FORCE, Channel
from ema.io.text.csv import write_csv
from ema.io.uff.write import write_time_series
from ema.signals import spikes_and_gaps

RATE_HZ, N_SAMPLES, SPIKE_AT = 1000.0, 8000, 5000
NAMES = ("force", "A01", "A02")
MANIFEST = """schema = 1
[acquisition]
sampling_rate_hz = 1000.0
[grid]
positions = 4
[excitation]
channel = "force"
position_deg = 0.0
[processing]
averages = 8
"""


def channels(number):
    """Steady noise; a run of an odd number has an impossible sample."""
    rows = 5 * np.random.default_rng(number).normal(size=(len(NAMES), N_SAMPLES))
    if number % 2:
        rows[2, SPIKE_AT] = 1e12
    units = ((FORCE, "N"), (ACCELERATION, "m/s^2"), (ACCELERATION, "m/s^2"))
    return [
        Channel(name, quantity, unit, samples, node=node)
        for node, (name, (quantity, unit), samples) in enumerate(
            zip(NAMES, units, rows, strict=True)
        )
    ]


def write_mat(path, written, rate_hz):
    """Without units: what channels measure follows from their roles."""
    scipy.io.savemat(path, {each.name: each.samples for each in written} | {"fs": rate_hz})


WRITERS = {".uff": write_time_series, ".mat": write_mat, ".csv": write_csv}


def campaign_folder(folder, ending):
    text = MANIFEST
    for number in (1, 2, 3):
        file = f"run_{number}{ending}"
        WRITERS[ending](folder / file, channels(number), RATE_HZ)
        text += f'[[runs]]\nfile = "{file}"\npositions_deg = {{ A01 = 0, A02 = 180 }}\n'
    (folder / "campaign.toml").write_text(text)
    return folder


@pytest.fixture(params=WRITERS)
def folder(request, tmp_path):
    return campaign_folder(tmp_path, request.param)


@pytest.fixture
def looks(monkeypatch):
    """Numbers of samples of every look that is taken."""
    taken, take = [], spikes_and_gaps.extents_of

    def counted(channels):
        taken.append(channels[0].n_samples)
        return take(channels)

    monkeypatch.setattr(spikes_and_gaps, "extents_of", counted)
    return taken


def impossible(campaign):
    return [each for each in campaign.findings if each.check is Check.IMPOSSIBLE_SAMPLES]


@pytest.mark.parametrize("ending", [".uff", ".mat"])
def test_samples_on_disk_are_not_read(tmp_path, monkeypatch, ending):
    def refuse(*_):
        raise AssertionError("samples are read")

    folder = campaign_folder(tmp_path, ending)
    with monkeypatch.context() as reading:
        reading.setattr(files, "_read", refuse)
        campaign = ema.read_campaign(folder)
    assert [run.recording.n_samples for run in campaign.runs] == [N_SAMPLES] * 3
    assert len(impossible(campaign)) == 2


@pytest.mark.parametrize("ask", ["findings", "block", "estimate_frf"])
def test_one_look_is_taken_whoever_asks_first(folder, looks, ask):
    campaign = ema.read_campaign(folder)
    assert not looks
    first = campaign.runs[0].responses[1].channel
    if ask == "block":
        first.block(0, 10)
        assert looks == [N_SAMPLES]
    elif ask == "estimate_frf":
        ema.estimate_frf(campaign)
    found = campaign.findings
    assert campaign.findings is found
    assert np.flatnonzero(np.isnan(first.block(0, N_SAMPLES))).tolist() == [SPIKE_AT]
    assert looks == [N_SAMPLES] * 3


def test_findings_come_in_the_order_of_the_runs(folder):
    campaign = ema.read_campaign(folder)
    renamed = replace(campaign, name="another")
    for each in (campaign, renamed):
        assert [(one.run[:5], one.channel) for one in impossible(each)] == [
            ("run_1", "A02"),
            ("run_3", "A02"),
        ]
    of_runs = [one.run[:5] for one in campaign.findings if one.run]
    assert of_runs == sorted(of_runs)


def test_who_keeps_one_channel_does_not_keep_all(tmp_path):
    """As FRFs keep the force of every run."""
    campaign = ema.read_campaign(campaign_folder(tmp_path, ".csv"))
    force = campaign.runs[0].force
    motion = weakref.ref(campaign.runs[0].responses[0].channel.samples)
    force.block(0, 10)
    del campaign
    gc.collect()
    assert motion() is None


def test_a_file_that_changed_since_is_named(tmp_path):
    folder = campaign_folder(tmp_path, ".uff")
    campaign = ema.read_campaign(folder)
    os.utime(folder / "run_2.uff", (0, 0))
    with pytest.raises(RecordingFormatError, match=r"run_2\.uff: changed since it was opened"):
        _ = campaign.findings
