"""A campaign that is being measured: what its runs are worth, and what to do next."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from reviewing import Page, until

from ema.core.finding import Check
from ema.io.formats import read_file
from ema.io.uff.write import write_time_series
from pipelines.review.answers import Office
from pipelines.review.watch import advice, expected, looked_at, settled
from pipelines.simulate.campaign import FORCE_RMS_N, simulate_campaign

LATER = 10.0  # seconds after which a file counts as written


@pytest.fixture
def rig(short_campaign, tmp_path):
    """A campaign of which the manifest is there, and how a run comes to it."""
    folder = tmp_path / "rig"
    folder.mkdir()
    shutil.copy(short_campaign / "campaign.toml", folder)

    def measure(*numbers, of=short_campaign):
        for number in numbers:
            path = Path(shutil.copy(of / f"config_{number}.uff", folder))
            past = path.stat().st_mtime - LATER
            os.utime(path, (past, past))
        return folder

    return measure


def seen(folder):
    runs = expected(folder)
    found = looked_at(runs, list(settled(runs)))
    return {run.name: run for run in found}, advice(runs, found)


def test_a_campaign_that_has_not_begun(rig):
    runs, (verdict, text) = seen(rig())
    assert [run.state for run in runs.values()] == ["missing"] * 6
    assert verdict == "ok"
    assert text.startswith("Next is run 1 (config_1.uff). Turn the sensors: A01 at 0°, A02 at 30°")


def test_the_next_position_of_the_sensors(rig):
    runs, (verdict, text) = seen(rig(1, 2))
    assert [run.state for run in runs.values()] == ["measured"] * 2 + ["missing"] * 4
    assert verdict == "ok"
    assert "run 3 (config_3.uff). Turn the sensors by +5°: A01 at 10°" in text
    assert "REF" not in text  # it stays
    content = runs["config_1.uff"].content
    assert content["coherence"] > 0.9
    assert content["force_n"] == pytest.approx([FORCE_RMS_N], rel=0.05)
    assert content["unit"] == "m/s²"
    assert 0 < content["sensors"][0] < content["sensors"][1]


def test_a_whole_campaign(rig):
    _, (verdict, text) = seen(rig(1, 2, 3, 4, 5, 6))
    assert (verdict, text) == ("ok", "All 6 runs are measured. Process the campaign.")


def test_a_file_that_is_being_written(rig):
    folder = rig(1)
    (folder / "config_2.uff").write_bytes((folder / "config_1.uff").read_bytes()[:5000])
    runs, (verdict, text) = seen(folder)
    assert runs["config_2.uff"].state == "being written"
    assert (verdict, text) == ("wait", "Run 2 (config_2.uff) is being written.")


def test_a_broken_file_is_measured_again(rig):
    folder = rig(1, 2)
    path = folder / "config_2.uff"
    path.write_bytes(path.read_bytes()[:5000])
    os.utime(path, (0, 0))
    runs, (verdict, text) = seen(folder)
    assert [run.state for run in list(runs.values())[:2]] == ["measured", "unreadable"]
    assert verdict == "warning"
    assert text.startswith("Measure run 2 (config_2.uff) again: ")


def test_a_noisy_run_is_repeated(rig, tmp_path):
    noisy = simulate_campaign(tmp_path / "noisy", duration_s=4.0, snr_db=-20.0)
    rig(1, 3)
    runs, (verdict, text) = seen(rig(2, of=noisy))
    assert verdict == "warning"
    assert text.startswith("Repeat run 2 (config_2.uff), because: ")
    assert runs["config_1.uff"].faults == []


def test_a_clipped_run_is_repeated(rig):
    """One sensor at its limit for a fifth of the time: processing would leave it out."""
    path = rig(1, 2) / "config_2.uff"
    channels = [  # copies: the file is written again
        replace(each, samples=np.array(each.samples)) for each in read_file(path).recording.channels
    ]
    limit = 1.2 * np.std(channels[4].samples)
    channels[4] = replace(channels[4], samples=np.clip(channels[4].samples, -limit, limit))
    write_time_series(path, channels, 2000.0, precision="single")
    os.utime(path, (0, 0))
    runs, (verdict, text) = seen(path.parent)
    assert verdict == "warning"
    assert text.startswith("Repeat run 2 (config_2.uff), because: ")
    (fault,) = {(each.check, each.channel) for each in runs["config_2.uff"].faults}
    assert fault == (Check.CLIPPED, channels[4].name)


def test_a_drift_of_the_tyre_is_seen_by_the_reference(rig, tmp_path):
    drifting = simulate_campaign(tmp_path / "drifting", duration_s=20.0, drift_percent=0.5)
    folder = tmp_path / "rig"
    folder.mkdir(exist_ok=True)
    shutil.copy(drifting / "campaign.toml", folder)
    runs, _ = seen(rig(1, 2, 3, of=drifting))
    drift = [run.content["reference_drift_percent"] for run in list(runs.values())[:3]]
    assert drift == pytest.approx([0.0, 0.5, 1.0], abs=0.02)


def test_recordings_without_a_manifest(rig):
    folder = rig(1, 2)
    (folder / "campaign.toml").unlink()
    runs, (verdict, text) = seen(folder)
    assert [run.state for run in runs.values()] == ["measured"] * 2
    assert verdict == "ok"
    assert "Turn the sensors for the next one" in text


def test_runs_whose_places_nobody_states_are_checked_each_alone(rig):
    """Sensors that were turned measure other FRFs: that is no fault of a run."""
    folder = rig(1, 2)
    (folder / "campaign.toml").unlink()
    for path in folder.glob("*.uff"):
        recording = read_file(path).recording
        table = np.column_stack([each.samples[:4000] for each in recording.channels])
        heads = [f"{each.name} [{each.unit}]" for each in recording.channels]
        stamps = np.arange(len(table)) / recording.sampling_rate_hz
        csv = path.with_suffix(".csv")
        lines = np.column_stack([stamps, table])
        np.savetxt(csv, lines, "%.6g", ",", header=",".join(["time [s]", *heads]), comments="")
        os.utime(csv, (0, 0))
        path.unlink()
    runs, (verdict, text) = seen(folder)
    assert [run.state for run in runs.values()] == ["measured"] * 2
    assert (verdict, text[:21]) == ("ok", "2 runs are in order. ")
    csv.write_text("t,ch1,ch2\n" + "".join(f"{k / 2000},{k % 7},{k % 5}\n" for k in range(4000)))
    os.utime(csv, (0, 0))
    runs, (verdict, text) = seen(folder)
    assert runs[csv.name].state == "not checked"  # the file is good: not to be measured again
    assert verdict == "warning"
    assert "ringmodal init" in text


def test_the_page_is_told_of_a_new_run(rig):
    folder = rig(1)
    desk = Office(folder)
    try:
        name = desk.name_of(folder)
        page = Page(desk, name)

        def states():
            return [run["state"] for run in page.client.get(f"/api/w/{name}").json()["runs"]]

        assert states() == ["measured"] + ["missing"] * 5
        rig(2)
        until(states, lambda found: found[:2] == ["measured"] * 2)
        (folder / "campaign.toml").write_text("schema = [")
        told = until(
            lambda: page.client.get(f"/api/w/{name}").json()["advice"],
            lambda found: found["verdict"] == "warning",
        )
        assert "campaign.toml" in told["text"]
    finally:
        desk.close()
