"""Which campaigns a batch finds, and where their results go."""

import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.core.errors import InputError
from pipelines.batch.campaigns import find_campaigns, placed


def folder(root, name, *files):
    path = root / name
    path.mkdir(parents=True, exist_ok=True)
    for file in files:
        (path / file).touch()
    return path


def names(root, out="out"):
    return [each.name for each in find_campaigns(root, root / out)]


def test_campaigns_are_found_at_any_depth_in_the_order_of_their_names(tmp_path):
    for name in ("b", "a/c/d", "a/b"):
        folder(tmp_path, name, "campaign.toml")
    folder(tmp_path, "nothing/here", "notes.md")
    found = find_campaigns(tmp_path, tmp_path / "out")
    assert [each.name for each in found] == ["a/b", "a/c/d", "b"]
    assert [each.place for each in found] == ["a/b", "a/c/d", "b"]
    assert [each.path for each in found] == [
        tmp_path.resolve() / each for each in ("a/b", "a/c/d", "b")
    ]


def test_the_root_may_be_a_campaign_itself(tmp_path):
    root = folder(tmp_path, "tyre", "campaign.toml")
    assert names(root) == ["tyre"]


def test_a_campaign_within_another_has_its_result_beside_that_one(tmp_path):
    root = folder(tmp_path, "tyre", "campaign.toml")
    folder(root, "again/hot", "campaign.toml")
    found = find_campaigns(root, root / "out")
    assert [(each.name, each.place) for each in found] == [
        ("tyre", "tyre"),
        ("tyre/again/hot", "tyre+again+hot"),
    ]


def test_two_results_in_one_place_are_refused(tmp_path):
    for name in ("a", "a/b", "a+b"):
        folder(tmp_path, name, "campaign.toml")
    with pytest.raises(InputError, match=r"ambiguous name.*a\+b.*Rename"):
        find_campaigns(tmp_path, tmp_path / "out")


def test_recordings_without_a_manifest_are_noticed(tmp_path):
    folder(tmp_path, "complete", "campaign.toml")
    folder(tmp_path, "lost", "config_1.uff")
    assert names(tmp_path) == ["complete", "lost"]


def test_recordings_of_a_campaign_and_lists_of_campaigns_are_no_campaigns(tmp_path):
    folder(tmp_path, "tyre", "campaign.toml")
    folder(tmp_path, "tyre/runs", "config_1.uff")
    (tmp_path / "inventory.csv").touch()
    assert names(tmp_path) == ["tyre"]


def test_results_hidden_folders_and_the_own_output_are_passed_over(tmp_path):
    folder(tmp_path, "tyre", "campaign.toml")
    folder(tmp_path, "tyre/result", "provenance.json", "modes.csv")
    folder(tmp_path, "result", "provenance.json", "modes.csv")
    folder(tmp_path, "earlier", "campaigns.parquet", "modes.parquet")
    folder(tmp_path, ".trash/tyre", "campaign.toml")
    folder(tmp_path, "out/results/tyre", "campaign.toml")
    assert names(tmp_path) == ["tyre"]


def test_links_are_followed_once_and_loops_end(tmp_path):
    outside = folder(tmp_path, "archive/tyre", "campaign.toml").parent
    root = folder(tmp_path, "root")
    real = folder(root, "z_real", "campaign.toml")
    (root / "a_link").symlink_to(real)
    (root / "loop").symlink_to(root)
    (root / "archive").symlink_to(outside)
    (real / "up").symlink_to(root)
    (root / "itself").symlink_to(root / "itself")
    assert names(root) == ["archive/tyre", "z_real"]


def test_a_manifest_whose_link_is_broken_is_a_campaign(tmp_path):
    folder(tmp_path, "tyre")
    (tmp_path / "tyre" / "campaign.toml").symlink_to(tmp_path / "gone")
    assert names(tmp_path) == ["tyre"]


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is closed to the superuser")
def test_a_folder_that_cannot_be_looked_into_is_noticed(tmp_path):
    closed = folder(tmp_path, "closed", "campaign.toml")
    closed.chmod(0)
    assert names(tmp_path) == ["closed"]
    closed.chmod(0o700)


def test_no_campaigns_are_refused(tmp_path):
    with pytest.raises(InputError, match="no campaigns"):
        find_campaigns(tmp_path, tmp_path / "out")
    with pytest.raises(InputError, match="nowhere"):
        find_campaigns(tmp_path / "nowhere", tmp_path / "out")
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="a file"):
        find_campaigns(tmp_path / "file", tmp_path / "out")


part = st.text("ab", min_size=1, max_size=2)
names_of_campaigns = st.sets(st.lists(part, min_size=1, max_size=4).map("/".join), min_size=1)


@given(names_of_campaigns)
def test_no_result_lies_within_another(tmp_path_factory, campaigns):
    origin = tmp_path_factory.getbasetemp()
    places = [each.place for each in placed(sorted(campaigns), origin)]
    assert len(set(places)) == len(campaigns)
    for place in places:
        assert not any(other.startswith(f"{place}/") for other in places)
