"""Files that a manifest names stay within its folder, on every system."""

from pathlib import Path, PurePath

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.core.errors import ManifestError
from ema.core.files import resolve
from ema.io.campaign.manifest import MANIFEST_NAME

PARTS = ("..", ".", "run", "recordings", "inner", "outer", "config_1.uff", "C:", "", "\\", "~")


@pytest.fixture
def manifest(tmp_path):
    """Path of a manifest, with a recording below it and a secret outside its folder."""
    campaign = tmp_path / "campaign"
    (campaign / "recordings").mkdir(parents=True)
    (campaign / "recordings" / "config_1.uff").write_text("")
    (tmp_path / "secret.uff").write_text("")
    (tmp_path / "campaign_2").mkdir()
    return campaign / MANIFEST_NAME


@pytest.fixture(scope="module")
def linked(tmp_path_factory):
    """Path of a manifest beside a link to a folder of its own and one that leads out."""
    root = tmp_path_factory.mktemp("linked")
    (root / "campaign" / "recordings").mkdir(parents=True)
    (root / "campaign" / "inner").symlink_to("recordings")
    (root / "campaign" / "outer").symlink_to("..")
    return root / "campaign" / MANIFEST_NAME


def assert_refused(manifest, file):
    with pytest.raises(ManifestError, match="stay within its folder"):
        resolve(manifest, file)


@pytest.mark.parametrize(
    "file",
    [
        "recordings/config_1.uff",
        "./recordings/config_1.uff",
        "recordings/../recordings/config_1.uff",
        "../campaign/recordings/config_1.uff",
    ],
)
def test_ways_to_a_file_of_the_campaign(manifest, file):
    expected = manifest.parent / "recordings" / "config_1.uff"
    assert resolve(manifest, file) == expected.resolve()


@pytest.mark.parametrize(
    "file",
    [
        "..",
        "../secret.uff",
        "recordings/../../secret.uff",
        "../campaign_2/config_1.uff",
        "/etc/passwd",
        "//server/share/config_1.uff",
        "C:/lab/config_1.uff",
        "C:\\lab\\config_1.uff",
        "C:config_1.uff",
        "\\lab\\config_1.uff",
        "\\\\server\\share\\config_1.uff",
        "\\\\?\\C:\\lab\\config_1.uff",
        "config_1.uff\0",
        "\0",
    ],
)
def test_ways_out_are_refused_on_every_system(manifest, file):
    assert_refused(manifest, file)


def test_a_file_with_the_name_of_a_drive_changes_nothing(manifest):
    try:
        (manifest.parent / "C:\\lab.uff").write_text("")
    except OSError:
        pytest.skip("the system has no such names")
    assert_refused(manifest, "C:\\lab.uff")


@pytest.mark.parametrize("target", ["../secret.uff", "/etc/passwd", "../nowhere.uff"])
def test_a_link_to_a_file_outside(manifest, target):
    (manifest.parent / "link.uff").symlink_to(target)
    assert_refused(manifest, "link.uff")


def test_a_link_to_a_folder_outside(manifest, tmp_path):
    (manifest.parent / "link").symlink_to(tmp_path, target_is_directory=True)
    assert_refused(manifest, "link/secret.uff")
    assert_refused(manifest, "link/campaign/../secret.uff")


def test_a_link_in_a_circle(manifest):
    (manifest.parent / "link").symlink_to("link")
    assert_refused(manifest, "link/config_1.uff")


def test_links_within_the_campaign_and_to_it_are_followed(manifest, tmp_path):
    (manifest.parent / "link.uff").symlink_to("recordings/config_1.uff")
    (tmp_path / "latest").symlink_to("campaign", target_is_directory=True)
    expected = (manifest.parent / "recordings" / "config_1.uff").resolve()
    assert resolve(manifest, "link.uff") == expected
    assert resolve(tmp_path / "latest" / MANIFEST_NAME, "link.uff") == expected


@given(st.lists(st.sampled_from(PARTS), min_size=1, max_size=6))
def test_whatever_is_accepted_lies_within(linked, parts):
    try:
        target = resolve(linked, "/".join(parts))
    except ManifestError:
        return
    assert Path(target).is_relative_to(linked.parent.resolve())
    assert ".." not in PurePath(target).parts
