"""When a campaign counts as changed, and what is read to know it."""

import os

import pytest
from fleets import edit, write_campaign
from hypothesis import given
from hypothesis import strategies as st

from ema.core.campaign import Processing
from pipelines.batch import state as batch_fingerprint
from pipelines.batch.state import FileState, choices, fingerprint_of, take_fingerprint
from pipelines.results.options import Options

CHOSEN = choices(Options())


@pytest.fixture
def campaign(short_campaign, tmp_path):
    return write_campaign(short_campaign, tmp_path / "campaign")


@pytest.fixture
def read(monkeypatch):
    """Names of the files whose content was read."""
    names, sha256 = [], batch_fingerprint.sha256
    monkeypatch.setattr(
        batch_fingerprint, "sha256", lambda path: names.append(path.name) or sha256(path)
    )
    return names


def touch(path, later_s=10):
    status = path.stat()
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns + later_s * 10**9))


def test_it_covers_the_manifest_and_the_recordings_it_names(campaign):
    (campaign / "notes.txt").write_text("no input")
    found = take_fingerprint(campaign, CHOSEN)
    assert [state.file for state in found.files] == ["campaign.toml", "config_1.uff"]
    assert all(len(state.sha256) == 64 for state in found.files)


def test_nothing_is_read_again_while_sizes_and_times_stand(campaign, read):
    first = take_fingerprint(campaign, CHOSEN)
    assert read == ["campaign.toml", "config_1.uff"]
    assert take_fingerprint(campaign, CHOSEN, first.files) == first
    assert len(read) == 2


def test_a_file_that_was_only_touched_keeps_the_digest(campaign, read):
    first = take_fingerprint(campaign, CHOSEN)
    touch(campaign / "config_1.uff")
    second = take_fingerprint(campaign, CHOSEN, first.files)
    assert read[2:] == ["config_1.uff"]
    assert second.digest == first.digest
    assert second.files != first.files


def test_a_changed_byte_changes_it(campaign):
    first = take_fingerprint(campaign, CHOSEN)
    recording = campaign / "config_1.uff"
    content = bytearray(recording.read_bytes())
    content[-100] ^= 1
    recording.write_bytes(content)
    touch(recording)
    assert take_fingerprint(campaign, CHOSEN, first.files).digest != first.digest


def test_a_changed_manifest_changes_it(campaign):
    first = take_fingerprint(campaign, CHOSEN)
    edit(campaign, "position_deg = 0.0", "position_deg = 10.0")
    assert take_fingerprint(campaign, CHOSEN, first.files).digest != first.digest


def test_a_recording_that_appears_changes_it(campaign):
    recording = campaign / "config_1.uff"
    content = recording.read_bytes()
    recording.unlink()
    first = take_fingerprint(campaign, CHOSEN)
    assert first.files[1] == FileState("config_1.uff")
    recording.write_bytes(content)
    assert take_fingerprint(campaign, CHOSEN, first.files).digest != first.digest


@pytest.mark.parametrize(
    "other",
    [
        Options(max_order=40),
        Options(Processing(band_hz=(20.0, 200.0))),
        Options(given={"mass_per_area_kg_m2": 19.7}),
        Options(pinned_hz=(78.7,)),
        Options(tune=False),
    ],
)
def test_any_option_changes_it(campaign, other):
    assert take_fingerprint(campaign, choices(other)) != take_fingerprint(campaign, CHOSEN)


def test_another_version_changes_it(campaign, monkeypatch):
    monkeypatch.setattr(batch_fingerprint, "software_version", lambda: "99.0")
    assert choices(Options()) != CHOSEN


@pytest.mark.parametrize("manifest", [None, "schema = ", "schema = 1\nunknown = 1\n"])
def test_of_a_faulty_manifest_the_recordings_do_not_matter(campaign, manifest):
    if manifest is None:
        (campaign / "campaign.toml").unlink()
    else:
        (campaign / "campaign.toml").write_text(manifest)
    assert [each.file for each in take_fingerprint(campaign, CHOSEN).files] == ["campaign.toml"]


words = st.text(max_size=5)
states = st.lists(st.builds(FileState, words, st.integers(), st.integers(), words), max_size=3)


@given(states, states, words, words)
def test_digests_are_equal_only_for_equal_contents(first, second, chosen, other):
    contents = [
        ([(state.file, state.sha256) for state in files], text)
        for files, text in ((first, chosen), (second, other))
    ]
    same = fingerprint_of(first, chosen).digest == fingerprint_of(second, other).digest
    assert same == (contents[0] == contents[1])
