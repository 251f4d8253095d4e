"""Numbered files: many writers, kills, drives without links, full drives."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest
from adding import EACH, without_links
from library import written

from pipelines.library import numbering
from pipelines.library.library import TyreLibrary
from pipelines.library.numbering import numbered_files, write_next

WRITERS = 4
_RENAME = Path.rename
forked = pytest.mark.skipif(not hasattr(os, "fork"), reason="the system cannot copy a process")


@pytest.fixture
def source(tmp_path):
    return written(tmp_path / "tyre.toml")


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "library"


def windows_rename(self, target):
    """A rename as Windows has it: it fails where the name is taken."""
    if Path(target).exists():
        raise FileExistsError(errno.EEXIST, "taken")
    _RENAME(self, target)


@pytest.fixture
def adding(folder, source):
    """Start a process that adds versions; its output is what it found."""

    def start(what, means):
        tests = Path(__file__).parents[2]
        program = [sys.executable, tests / "adding.py", what, folder, source, means]
        paths = os.pathsep.join([str(tests.parent), *sys.path])
        environment = {**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1"}
        return subprocess.Popen(program, env=environment, stdout=subprocess.PIPE, text=True)

    return start


def ended(process):
    """Output of a process that did what it should."""
    with process:
        output = process.communicate()[0]
    assert process.returncode == 0
    return output


def assert_all_there(folder, count):
    """Consecutive numbers, each version complete, no hidden files left."""
    (tyre,) = TyreLibrary(folder).tyres()
    versions = tyre.intact_versions()
    assert [version.number for version in versions] == list(range(1, count + 1))
    assert len({version.entry.id for version in versions}) == count
    assert sorted(path.name for path in tyre.path.iterdir()) == [
        f"{number:04}.toml" for number in range(1, count + 1)
    ]
    return versions


@pytest.mark.parametrize("means", ["links", "turns"])
def test_writers_at_the_same_time_get_numbers_of_their_own(adding, folder, means):
    writers = [adding("many", means) for _ in range(WRITERS)]
    assert [ended(writer) for writer in writers] == [""] * WRITERS
    versions = assert_all_there(folder, WRITERS * EACH)
    authors = [version.entry.author for version in versions]
    assert sorted(authors.count(author) for author in set(authors)) == [EACH] * WRITERS


@forked
@pytest.mark.parametrize("means", ["links", "turns"])
def test_a_kill_before_any_file_operation_loses_at_most_the_version_being_written(
    adding, folder, means
):
    kills = int(ended(adding("kills", means)))
    assert kills > 8
    (tyre,) = TyreLibrary(folder).tyres()
    assert_all_there(folder, tyre.newest)
    assert tyre.newest > kills


@forked
def test_a_kill_during_the_first_addition_leaves_no_tyre_or_a_complete_one(adding):
    assert int(ended(adding("begin", "links"))) > 8


def test_a_rename_that_keeps_what_is_there_claims_numbers_too(folder, monkeypatch):
    monkeypatch.setattr(numbering, "_RENAME_KEEPS", True)
    monkeypatch.setattr(Path, "rename", windows_rename)
    monkeypatch.setattr(numbering, "numbered_files", lambda _: {})  # a drive that lists late
    for number in (1, 2, 3):
        assert write_next(folder, "text {}".format) == number
    assert (folder / "0002.toml").read_text() == "text 2"
    assert len(list(folder.iterdir())) == 3


def test_a_file_held_by_a_virus_scanner_is_tried_again(folder, monkeypatch):
    refusals = [PermissionError(errno.EACCES, "held")] * 2

    def rename(self, target):
        if refusals:
            raise refusals.pop()
        windows_rename(self, target)

    monkeypatch.setattr(numbering, "_RENAME_KEEPS", True)
    monkeypatch.setattr(Path, "rename", rename)
    assert write_next(folder, str) == 1


def test_a_turn_taken_for_abandoned_loses_nothing(folder, monkeypatch):
    """While one writer sleeps before its last step, another takes its turn and its number."""
    monkeypatch.setattr(os, "link", without_links)
    monkeypatch.setattr(numbering, "ABANDONED_S", 0.05)
    asleep = [True]

    def late_rename(self, target):
        if self.name == ".turn" and asleep:
            asleep.clear()
            assert write_next(folder, "other {}".format) == 1
        return _RENAME(self, target)

    monkeypatch.setattr(Path, "rename", late_rename)
    assert write_next(folder, "own {}".format) == 2
    assert [path.read_text() for path in numbered_files(folder).values()] == ["other 1", "own 2"]
    assert len(list(folder.iterdir())) == 2


def test_a_full_drive_leaves_nothing_behind(folder, monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, "no space left")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="no space") as refused:
        write_next(folder, str)
    assert refused.value.filename == str(folder)
    assert not folder.exists()


def test_a_full_drive_leaves_no_empty_library(folder, source, monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, "no space left")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="no space"):
        TyreLibrary(folder).add(source, author="a")
    assert not folder.exists()
    folder.mkdir()
    with pytest.raises(OSError, match="no space"):
        TyreLibrary(folder).add(source, author="a")
    assert list(folder.iterdir()) == []
