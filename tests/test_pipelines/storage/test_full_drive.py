"""A drive that is really full: every writer says so with exit code 2 and leaves nothing behind."""

import os
import shutil
import subprocess

import pytest
from library import SET, written
from tyre_property_files import content

from pipelines.report.write import save

MOUNT = shutil.which("mount")
pytestmark = pytest.mark.skipif(
    MOUNT is None or not hasattr(os, "geteuid") or os.geteuid() != 0,
    reason="only root makes a small drive",
)
ROOM_KB = 16


@pytest.fixture
def drive(tmp_path):
    """A drive of 16 kB in memory, all but full."""
    place = tmp_path / "drive"
    place.mkdir()
    options = ["-t", "tmpfs", "-o", f"size={ROOM_KB}k", "tmpfs", place]
    if subprocess.run([MOUNT, *options], capture_output=True, check=False).returncode:
        pytest.skip("no drive can be made here")
    try:
        yield place
    finally:
        subprocess.run([shutil.which("umount"), "-l", place], check=True)


def fill(drive):
    with (drive / "full").open("wb", buffering=0) as file:
        try:
            for _ in range(ROOM_KB * 1024):
                file.write(b"x")
        except OSError:
            return


@pytest.fixture(scope="module")
def stored(short_result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("stored") / "result"
    save(short_result, folder, report=False)
    return folder


@pytest.fixture(scope="module")
def toml(tmp_path_factory):
    return written(tmp_path_factory.mktemp("set") / "set.toml", SET)


COMMANDS = {
    "export to one file": ("export", "RESULT", "--out", "DRIVE/out.uff"),
    "export to a folder": ("export", "RESULT", "--format", "csv", "--out", "DRIVE/out"),
    "export as JSON": ("export", "RESULT", "--out", "DRIVE/out.json"),
    "a table": ("simulate", "frequencies", "--out", "DRIVE/f.csv"),
    "a table in Parquet": ("simulate", "frequencies", "--out", "DRIVE/f.parquet"),
    "a figure": ("simulate", "frequencies", "--figure", "DRIVE/f.png"),
    "a campaign": ("simulate", "campaign", "DRIVE/campaign", "--duration-s", "1"),
    "a new library": ("tyre", "add", "SET", "--library", "DRIVE/library"),
    "a new tyre": ("tyre", "add", "SET", "--library", "DRIVE"),
    "a set": ("tyre", "export", "SET", "--out", "DRIVE/set.json"),
    "modal targets": ("tyre", "modal-targets", "SET", "--out", "DRIVE/targets.txt"),
}


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS.keys())
def test_nothing_is_left_behind(ringmodal, stored, toml, drive, command):
    fill(drive)
    places = {"RESULT": str(stored), "SET": str(toml)}
    arguments = [places.get(word, word.replace("DRIVE", str(drive))) for word in command]
    code, _, errors = ringmodal(*arguments)
    assert code == 2, errors
    assert errors.splitlines()[-1].startswith("Error: ")
    assert "Traceback" not in errors
    assert [path.name for path in drive.iterdir()] == ["full"]


def test_a_property_file_keeps_its_content_and_gets_no_empty_copy(ringmodal, toml, drive):
    tir = drive / "tyre.tir"
    before = content()
    tir.write_bytes(before)
    fill(drive)
    code, _, errors = ringmodal("tyre", "update-tir", tir, "--from", toml, "--yes")
    assert code == 2, errors
    assert tir.read_bytes() == before
    assert sorted(path.name for path in drive.iterdir()) == ["full", "tyre.tir"]


def test_there_is_room_for_the_new_file_but_not_for_the_copy(ringmodal, toml, drive):
    tir = drive / "tyre.tir"
    tir.write_bytes(content())
    fill(drive)
    with (drive / "full").open("rb+") as file:
        file.truncate(file.seek(0, os.SEEK_END) - 4096)  # a page of the drive
    code, _, errors = ringmodal("tyre", "update-tir", tir, "--from", toml, "--yes")
    assert code == 2, errors
    assert tir.read_bytes() == content()
    assert sorted(path.name for path in drive.iterdir()) == ["full", "tyre.tir"]


def test_a_draft(ringmodal, campaign_copy, drive):
    (campaign_copy / "campaign.toml").unlink()
    folder = drive / "campaign"
    folder.mkdir()
    for path in campaign_copy.glob("*.uff"):
        (folder / path.name).symlink_to(path)
    fill(drive)
    code, _, errors = ringmodal("init", folder)
    assert code == 2, errors
    assert not (folder / "campaign.toml").exists()
    assert not list(folder.glob(".*"))
