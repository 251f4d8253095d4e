"""A draft manifest says what the recordings tell, and names what they do not."""

import shutil
import tomllib

import pytest

from ema.errors import InputError
from pipelines.draft import draft_manifest, write_draft
from pipelines.options import Options
from pipelines.process import process


@pytest.fixture
def bare(short_campaign, tmp_path):
    """The recordings of a campaign without its manifest."""
    folder = tmp_path / "bare"
    folder.mkdir()
    for path in short_campaign.glob("*.uff"):
        shutil.copy(path, folder)
    return folder


def test_recordings_with_nodes_need_only_pressure_and_radius(bare):
    draft = draft_manifest(bare)
    assert len(draft.missing) == 1
    assert "inflation_pressure_pa and mean_radius_m" in draft.missing[0]
    content = tomllib.loads(draft.text)
    assert content["grid"]["positions"] == 72
    assert content["excitation"]["channel"] == "force"
    assert [run["reference"] for run in content["runs"]] == ["REF"] * 6
    assert content["acquisition"]["sampling_rate_hz"] == 2000.0


def test_a_filled_in_draft_gives_the_modes_of_the_manifest(bare, short_result):
    path = write_draft(bare, draft_manifest(bare))
    text = path.read_text(encoding="utf-8")
    text = text.replace("# inflation_pressure_pa = <Pa>", "inflation_pressure_pa = 220000.0")
    path.write_text(text.replace("# mean_radius_m = <m>", "mean_radius_m = 0.33"), encoding="utf-8")
    result = process(bare, Options())
    assert result.tuning is not None
    found = [mode.frequency_hz for mode in result.modal_model.modes]
    assert found == [mode.frequency_hz for mode in short_result.modal_model.modes]


def test_an_existing_manifest_is_kept(bare):
    draft = draft_manifest(bare)
    write_draft(bare, draft)
    with pytest.raises(InputError, match="not overwritten"):
        write_draft(bare, draft)
    assert write_draft(bare, draft, force=True).is_file()


def test_a_folder_without_recordings_is_refused(tmp_path):
    with pytest.raises(InputError, match="no recordings"):
        draft_manifest(tmp_path)
