"""Decisions: from the command line and from records, replayed to the last digit."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import ema
from ema.core.campaign import Processing
from ema.core.edits import ChannelName, Edit, EditKind, PoleName
from ema.core.errors import InputError
from ema.core.finding import Check
from ema.io.formats import read_file
from ema.io.uff.write import write_time_series
from ema.signals.frf_of_spectra import restated
from pipelines.process.refit import refit
from pipelines.process.run import process
from pipelines.report.write import save
from pipelines.results.edits_file import Record, read_edits, record_of, write_edits
from pipelines.results.options import Options
from pipelines.results.store import load
from pipelines.simulate.campaign import simulate_campaign
from pipelines.simulate.laboratory import Laboratory
from pipelines.simulate.laboratory_effects import Effects

WITHOUT_3 = Edit(EditKind.SET_ASIDE, PoleName(121.4), by="me", reason="not at 2.0 bar")
FLIPPED = Edit(EditKind.FLIP, channel=ChannelName("A05", "config_2.uff"))
OUT = Edit(EditKind.CHANNEL_OUT, channel=ChannelName("A07", "config_3.uff"))
NARROW = Edit(EditKind.SETTINGS, settings={"band_hz": [40.0, 200.0], "estimator": "H2"})

# What is identified of the same FRFs with the same decisions is the same: once is enough.
pytestmark = pytest.mark.usefixtures("modes_once")

FEW = Options(processing=Processing(band_hz=(60.0, 160.0)), tune=False)  # modes, to be quick


@pytest.fixture(scope="module")
def short_folder(short_result, tmp_path_factory):
    """Result of the short campaign, without a report; not to be changed."""
    folder = tmp_path_factory.mktemp("short") / "result"
    save(short_result, folder, report=False)
    return folder


@pytest.fixture(scope="module")
def split(process_once, tmp_path_factory):
    """Campaign and result folder of a tyre whose pairs are split by 3 %."""
    place = tmp_path_factory.mktemp("split")
    options = {"duration_s": 8.0, "snr_db": 60.0, "split_percent": 3.0}
    campaign = simulate_campaign(place / "campaign", **options)
    save(process_once(campaign, FEW), place / "result", report=False)
    return campaign, place / "result"


def modes_of(folder):
    return pd.read_csv(folder / "modes.csv", keep_default_na=False)


def assert_same(one, other):
    """Both results hold the same numbers, to the last digit."""
    for mine, yours in zip(one.modal_model.modes, other.modal_model.modes, strict=True):
        for name in ("pole", "frequency_std_hz", "damping_std", "chosen", "pair", "status"):
            assert getattr(mine, name) == getattr(yours, name)
        assert np.array_equal(mine.residues, yours.residues)
    assert one.findings == other.findings
    assert one.modal_model.notes == other.modal_model.notes
    assert one.automatic == other.automatic
    if one.tuning is not None:
        assert one.tuning.ring == other.tuning.ring


@pytest.mark.parametrize("edits", [[WITHOUT_3], [WITHOUT_3, OUT], [NARROW]])
def test_refit_of_a_folder_gives_what_the_recordings_give(short_campaign, short_folder, edits):
    assert_same(process(short_campaign, edits=edits), refit(short_folder, edits))


def test_refit_compensates_masses_and_drift_again(tmp_path):
    effects = Effects(
        sensors=9, runs=3, duration_s=8.0, sensor_mass_kg=0.02, temperature_drift=0.004
    )
    campaign, fewer = Laboratory(effects).campaign(), Processing(band_hz=(60.0, 140.0))
    options = replace(FEW, processing=fewer)
    found = process(campaign, options)
    assert found.sensor_mass.drift.applied
    save(found, tmp_path / "result", report=False)
    left_out = ChannelName("A07", campaign.runs[2].name)
    edits = [
        Edit(EditKind.SET_ASIDE, PoleName(found.modal_model.modes[1].frequency_hz)),
        Edit(EditKind.CHANNEL_OUT, channel=left_out),
    ]
    again = refit(tmp_path / "result", edits)
    assert again.sensor_mass.mass_kg == 0.02
    assert_same(process(campaign, options, edits=edits), again)


def test_no_decisions_give_the_automatic_result(short_result, short_folder):
    edited = refit(short_folder, [WITHOUT_3, OUT])
    back = refit(edited, [])
    assert not back.edits and not back.automatic and "edits" not in back.provenance
    assert_same(replace(back, automatic=()), short_result)


def test_member_of_a_pair_is_set_aside(split, ringmodal):
    campaign, folder = split
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    modes = modes_of(folder)
    order, hz = modes[modes["member"] == "b"][["order", "frequency_hz"]].iloc[0]
    code, _, error = ringmodal("refit", folder, "--set-aside", f"{hz:.2f}", "--reason", "one only")
    assert code == 0, error
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    edited = folder.with_name("result-edited")
    left = modes_of(edited)
    assert len(left) == len(modes) - 1
    assert list(left[left["order"] == order]["member"]) == [""]
    assert not np.any(np.isclose(left["frequency_hz"], hz, rtol=1e-4))
    page = (edited / "report.html").read_text()
    assert "Changed by hand" in page and "one only" in page
    record = read_edits(edited / "edits.toml")
    assert record.edits[0].kind is EditKind.SET_ASIDE and record.edits[0].by and record.edits[0].at
    kept = json.loads((edited / "provenance.json").read_text())["edits"]
    assert [each["reason"] for each in kept] == ["one only"]
    code, out, error = ringmodal("refit", folder, "--edits", edited / "edits.toml", "--no-report")
    assert code == 0 and "exact" in out, error
    assert folder.with_name("result-edited-2").is_dir()
    target = edited.with_name("replayed")
    words = ("--edits", edited / "edits.toml", "--out", target, "--no-report", "--no-tune")
    code, out, error = ringmodal("process", campaign, *words)
    assert code == 0 and "exact" in out, error
    assert (target / "modes.csv").read_bytes() == (edited / "modes.csv").read_bytes()


def test_record_on_other_recordings_is_resolved_anew_or_refused(
    split, short_campaign, ringmodal, tmp_path
):
    _, folder = split
    modes = load(folder).modal_model.modes
    second = next(mode for mode in modes if mode.member == "b")
    edits = (Edit(EditKind.SET_ASIDE, PoleName(second.frequency_hz, second.damping_ratio)), OUT)
    edited = refit(folder, edits)
    save(edited, tmp_path / "edited", report=False)
    record = tmp_path / "edited" / "edits.toml"
    words = ("--edits", record, "--out", tmp_path / "other", "--no-report")
    code, out, error = ringmodal("process", short_campaign, *words)
    # There the order has one mode, a per cent away: it is the mode meant, or none is.
    assert (code == 2 and "edit 1" in error) or (code == 0 and "other inputs" in out)
    far = tmp_path / "far.toml"
    far.write_text('[[edit]]\nkind = "set_aside"\npole = { frequency_hz = 90.0 }\n')
    code, _, error = ringmodal("process", short_campaign, *words[2:], "--edits", far, "--force")
    assert code == 2 and "edit 1" in error and "90" in error and "78." in error


def test_what_decisions_cost_is_told_and_nothing_written(short_folder, ringmodal):
    before = sorted(path.name for path in short_folder.parent.iterdir())
    code, out, _ = ringmodal("refit", short_folder, "--set-aside", "121.4", "--try", "--json")
    told = json.loads(out)
    assert code == 0 and told["change"] > 0
    assert told["misfit_after"] > told["misfit_before"] > 0
    assert [each["order"] for each in told["shifts"]] == [1, 2, 4, 5, 6, 7, 8, 9]
    assert sorted(path.name for path in short_folder.parent.iterdir()) == before


def test_dead_channel_is_brought_back_and_a_flipped_one_stays_flipped(campaign_copy, ringmodal):
    path = campaign_copy / "config_2.uff"
    recording = read_file(path).recording
    quiet = [
        replace(each, samples=np.asarray(each.samples) * (1e-9 if each.name == "A03" else 1.0))
        for each in recording.channels
    ]
    write_time_series(path, quiet, recording.sampling_rate_hz)
    folder = campaign_copy / "result"
    save(process(campaign_copy, FEW), folder, report=False)
    assert load(folder).frf.n_positions == 71
    words = ("--channel-in", "A03@config_2.uff", "--flip", "A05@config_2.uff", "--no-report")
    code, _, error = ringmodal("refit", folder, *words, "--out", campaign_copy / "edited")
    assert code == 0, error
    edited = load(campaign_copy / "edited")
    assert edited.frf.n_positions == 72
    by_hand = [each for each in edited.findings if each.check is Check.BY_HAND]
    assert {each.channel for each in by_hand} == {"A03", "A05"}
    row = next(each for each in edited.corrections if each.channel == "A05")
    assert row.factor == -1.0 and row.is_by_hand and not row.excluded


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--flip", "A99"), "A99"),
        (("--run-out", "config_9.uff"), "config_9.uff"),
        (("--set-aside", "high"), "--set-aside"),
        ((), "--set-aside"),
    ],
)
def test_decisions_on_what_is_not_there_are_refused(short_folder, ringmodal, words, said):
    code, _, error = ringmodal("refit", short_folder, *words)
    assert code == 2 and said in error
    assert [path.name for path in short_folder.parent.iterdir()] == ["result"]


def test_other_blocks_need_the_recordings(short_campaign, short_folder, tmp_path):
    longer = Edit(EditKind.SETTINGS, settings={"block_seconds": 2.0})
    with pytest.raises(InputError, match="process CAMPAIGN --edits"):
        refit(short_folder, [longer])
    edited = process(short_campaign, edits=[longer])
    assert edited.measured.blocks.block_s == 2.0
    save(edited, tmp_path / "edited", report=False)
    assert_same(refit(tmp_path / "edited", edited.edits), edited)


def test_pins_and_exclusions_are_decisions(short_campaign, short_folder, ringmodal, tmp_path):
    out = tmp_path / "pinned"
    words = ("--out", out, "--pin", "78.7,121.4", "--exclude", "145.4", "--no-report")
    code, _, error = ringmodal("process", short_campaign, *words, "--no-tune")
    assert code == 0, error
    assert list(modes_of(out)["chosen"]) == ["kept", "kept"]
    kinds = [edit.kind for edit in read_edits(out / "edits.toml").edits]
    assert kinds == [EditKind.KEEP, EditKind.KEEP, EditKind.ONLY_KEPT, EditKind.SET_ASIDE]


def test_result_of_an_earlier_version_is_read_and_not_refitted(short_folder, tmp_path):
    old = tmp_path / "old"
    shutil.copytree(short_folder, old)
    path = old / "identification.json"
    content = json.loads(path.read_text())
    for name in ("setup", "rows", "forces", "automatic", "automatic_misfit"):
        del content[name]
    path.write_text(json.dumps(content))
    (old / "force.parquet").unlink()
    result = load(old, accept_changes=True)
    assert result.setup is None and len(result.modal_model.modes) == 9
    with pytest.raises(InputError, match="Process the recordings again"):
        refit(result, [WITHOUT_3])


def test_recordings_are_found_from_the_result(short_folder, short_campaign):
    stated = json.loads((short_folder / "provenance.json").read_text())["inputs"]
    assert all((short_folder / each["path"]).is_file() for each in stated)
    known = load(short_folder).provenance["inputs"]
    assert known[0]["path"] == (short_campaign / "campaign.toml").resolve().as_posix()


def test_unchanged_frfs_are_copied_and_replaced_ones_are_not(short_folder, tmp_path):
    result = load(short_folder)
    folder = tmp_path / "result"
    save(result, folder, report=False)
    moved = replace(result, stored=replace(result.stored, folder=tmp_path / "gone"))
    save(moved, tmp_path / "written", report=False)
    for name in ("frf.parquet", "force.parquet", "reference.parquet"):
        assert (folder / name).read_bytes() == (short_folder / name).read_bytes()
        assert np.array_equal(
            load(tmp_path / "written").measured.values, load(folder).measured.values
        )


def test_estimators_follow_from_each_other(short_campaign):
    campaign = ema.read_campaign(short_campaign)
    first = ema.estimate_frf(campaign)
    for estimator in ("H2", "Hv"):
        other = ema.estimate_frf(campaign, estimator=estimator)
        assert np.allclose(restated(first, estimator).values, other.values, rtol=1e-9)
        assert np.allclose(restated(other, "H1").values, first.values, rtol=1e-9)
        assert not other.exact_forces


def test_record_is_written_and_read_back(short_folder, tmp_path):
    everything = (
        replace(WITHOUT_3, at="2026-11-27T14:02:11+00:00"),
        Edit(EditKind.PICK, PoleName(78.8, 0.03, "lsce", 41)),
        *(FLIPPED, OUT, NARROW),
        Edit(EditKind.GAIN, channel=ChannelName("A01"), value=1.1),
        Edit(EditKind.RUN_OUT, run="config_6.uff"),
        Edit(EditKind.ORDER_IS, PoleName(170.8), value=5.0),
        Edit(EditKind.ONLY_KEPT),
        Edit(EditKind.NOTE, reason="a remark"),
    )
    result = load(short_folder)
    signed = {"by": "me", "at": "2026-11-27T14:20:00+00:00", "note": "checked"}
    record = replace(record_of(result), edits=everything, signed=signed)
    path = tmp_path / "edits.toml"
    write_edits(path, record)
    again = read_edits(path)
    assert replace(again, file="") == record
    text = path.read_text()
    path.write_text(text.replace("not at 2.0 bar", "not at 2.1 bar"))
    with pytest.raises(InputError, match="changed after it was signed"):
        read_edits(path)


def test_hand_written_record_needs_no_more_than_edits(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('[[edit]]\nkind = "channel_out"\nchannel = "A07"\n')
    assert replace(read_edits(path), file="") == Record(
        (Edit(EditKind.CHANNEL_OUT, channel=ChannelName("A07")),)
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('kind = "set_asid"', "edit 2, kind: 'set_asid'; .*set_aside"),
        ('kind = "set_aside"', "edit 2: no pole"),
        ('kind = "set_aside"\npole = { frequency = 9 }', "edit 2, pole: 'frequency'"),
        ('kind = "set_aside"\npole = { frequency_hz = "9" }', "edit 2, pole: frequency_hz = '9'"),
        ('kind = "pick"\npole = { frequency_hz = 9, order = 4.5 }', "edit 2, pole: order = 4.5"),
        ('kind = "flip"\nchanel = "A01"', "edit 2 .flip.: 'chanel'; .*channel"),
        ('kind = "gain"\nchannel = "A01"', "edit 2: no value"),
        ('kind = "note"\nat = "yesterday"', "edit 2: at = 'yesterday'"),
        ('kind = "settings"\nsettings = { band_hz = [9, 8] }', "edit 2, settings: band_hz"),
    ],
)
def test_faults_of_a_record_are_named_with_their_place(tmp_path, text, said):
    path = tmp_path / "mine.toml"
    path.write_text(f'[[edit]]\nkind = "no_partners"\n\n[[edit]]\n{text}\n')
    with pytest.raises(InputError, match=f"mine.toml, {said}"):
        read_edits(path)
