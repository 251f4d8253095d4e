"""Files that do not belong together are refused; what is only poorer is recorded."""

import re

import numpy as np
import pytest
from builders import binary58, floats, force58, nodes15, response58

import ema
from ema.core.errors import ManifestError, RecordingFormatError

RUN = """
[[runs]]
file = "{name}"
positions_deg = {{ A01 = {first}, A02 = {second} }}
"""


def recording(seed, n=4000, *, rate_step="  5.00000E-04", force_scale=1.0):
    noise = np.random.default_rng(seed)
    channels = [("force", (13, 0, 0, "Force", "N")), ("A01", None), ("A02", None), ("REF", None)]
    parts = []
    for name, axis in channels:
        values = noise.standard_normal(n) * (force_scale if name == "force" else 1.0)
        header = {"axis": axis} if axis else {}
        parts.append(binary58(floats(values), name=name, n=n, step=rate_step, node=0, **header))
    return b"".join(parts)


@pytest.fixture
def campaign(tmp_path):
    def build(runs, files, reference=("REF", "REF")):
        text = 'schema = 1\n[grid]\npositions = 4\n[excitation]\nchannel = "force"\n'
        for number, ((first, second), content) in enumerate(zip(runs, files, strict=True), 1):
            name = f"run_{number}.uff"
            text += RUN.format(name=name, first=first, second=second)
            if reference[number - 1]:
                text += f'reference = "{reference[number - 1]}"\n'
            (tmp_path / name).write_bytes(content)
        (tmp_path / "campaign.toml").write_text(text)
        return ema.read_campaign(tmp_path)

    return build


def grid_findings(campaign):
    checks = ("grid", "reference", "length")
    return [(f.check, f.verdict, f.detail) for f in campaign.findings if f.check in checks]


def test_all_is_well(campaign):
    found = campaign([(0, 90), (180, 270)], [recording(1), recording(2)])
    assert grid_findings(found) == []


def test_a_duplicated_file_is_refused_with_both_names(campaign):
    message = "run_2.uff: a duplicated file; it is run_1.uff again"
    with pytest.raises(RecordingFormatError, match=message):
        campaign([(0, 90), (180, 270)], [recording(1), recording(1)])


def test_files_that_differ_far_inside_are_no_duplicates(campaign):
    content = bytearray(recording(1, n=40_000))
    content[200_000] ^= 1  # neither at the start, nor in the middle, nor at the end
    campaign([(0, 90), (180, 270)], [recording(1, n=40_000), bytes(content)])


def test_another_rate_is_refused(campaign):
    with pytest.raises(RecordingFormatError, match=r"run_1\.uff was sampled at 2000 Hz"):
        other = recording(2, rate_step="  1.00000E-03")
        campaign([(0, 90), (180, 270)], [recording(1), other])


def test_positions_missing_and_repeated_are_named(campaign):
    found = campaign([(0, 90), (90, 180)], [recording(1), recording(2)])
    assert grid_findings(found) == [
        ("grid", "warning", "1 of 4 grid positions not measured: 270 degrees"),
        ("grid", "warning", "measured in several runs and averaged: 90 degrees; intended?"),
    ]


def test_a_planned_repetition_is_no_warning(campaign):
    found = campaign([(0, 90), (0, 90)], [recording(1), recording(2)])
    assert ("grid", "ok", "each position measured in 2 runs and averaged") in grid_findings(found)


@pytest.mark.parametrize(
    ("reference", "detail"),
    [
        (("REF", ""), "no reference sensor in run_2.uff: not compared with the other runs"),
        (("", ""), "no run has a reference sensor"),
    ],
)
def test_an_absent_reference_is_recorded(campaign, reference, detail):
    found = campaign([(0, 90), (180, 270)], [recording(1), recording(2)], reference)
    ((check, verdict, text),) = grid_findings(found)
    assert (check, verdict) == ("reference", "warning")
    assert detail in text


def test_a_shorter_run_is_recorded(campaign):
    found = campaign([(0, 90), (180, 270)], [recording(1), recording(2, n=3000)])
    ((check, verdict, text),) = grid_findings(found)
    assert (check, verdict) == ("length", "warning")
    assert text == "1.5 s long, others 2 s: fewer averages"


def test_channels_of_different_length_are_refused(tmp_path):
    path = tmp_path / "a.uff"
    path.write_bytes(force58() + response58(n=9))
    message = "8 samples of 'force', 9 of 'A01'"
    with pytest.raises(RecordingFormatError, match=re.escape(message)):
        ema.read_campaign(path)


def test_a_silent_excitation_is_refused_by_the_frfs(campaign):
    found = campaign([(0, 90), (180, 270)], [recording(1), recording(2, force_scale=0.0)])
    with pytest.raises(ema.InputError, match=r"run_2.uff, channel 'force': a constant"):
        ema.estimate_frf(found)


def test_files_of_one_name_are_told_apart_by_their_folder(tmp_path):
    for seed, folder in enumerate(("monday", "tuesday")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "run.uff").write_bytes(recording(seed))
    found = ema.read_campaign([tmp_path / "monday" / "run.uff", tmp_path / "tuesday" / "run.uff"])
    assert [run.name for run in found.runs] == ["monday/run.uff", "tuesday/run.uff"]


def test_a_level_that_makes_no_sense_is_recorded(campaign):
    found = campaign([(0, 90), (180, 270)], [recording(1), recording(2, force_scale=1e-4)])
    levels = [(f.run, f.channel, f.verdict) for f in found.findings if f.check == "level"]
    assert levels == [("run_2.uff", "force", "warning")]


def test_a_run_of_the_manifest_that_holds_nothing_is_refused(campaign):
    geometry = nodes15({1: (1, 0, 0)})
    with pytest.raises(
        ManifestError, match=r"runs\.2 \(run_2\.uff\): neither time series nor FRFs"
    ):
        campaign([(0, 90), (180, 270)], [recording(1), geometry])
    with pytest.raises(RecordingFormatError, match="only blanks or zeros"):
        campaign([(0, 90), (180, 270)], [recording(1), bytes(5000)])
