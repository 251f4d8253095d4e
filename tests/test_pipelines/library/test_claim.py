"""Versions under pressure: many writers, kills, drives without links, damaged files."""

import errno
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from adding import EACH, without_links
from library import SET, varied, written

from ema.core.errors import InputError
from pipelines.library import numbering as library_claim
from pipelines.library.library import TyreLibrary
from pipelines.library.numbering import numbered_files, write_next
from pipelines.storage.checksums import DamagedFile, sealed, unsealed

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
    """Numbers without gap, each version whole, nothing hidden left behind."""
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
def test_a_kill_during_the_first_addition_leaves_no_tyre_or_a_whole_one(adding):
    assert int(ended(adding("begin", "links"))) > 8


def test_a_rename_that_keeps_what_is_there_claims_numbers_too(folder, monkeypatch):
    monkeypatch.setattr(library_claim, "_RENAME_KEEPS", True)
    monkeypatch.setattr(Path, "rename", windows_rename)
    monkeypatch.setattr(library_claim, "numbered_files", lambda _: {})  # a drive that lists late
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

    monkeypatch.setattr(library_claim, "_RENAME_KEEPS", True)
    monkeypatch.setattr(Path, "rename", rename)
    assert write_next(folder, str) == 1


def test_a_turn_taken_for_abandoned_loses_nothing(folder, monkeypatch):
    """While one writer sleeps before its last step, another takes its turn and its number."""
    monkeypatch.setattr(os, "link", without_links)
    monkeypatch.setattr(library_claim, "ABANDONED_S", 0.05)
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


def test_an_edited_version_is_noticed_and_named(folder, source):
    library = TyreLibrary(folder)
    library.add(source, author="a")
    path = folder / "225-55R17" / "0001.toml"
    path.write_text(path.read_text().replace("19.7", "19.8"))
    with pytest.raises(DamagedFile, match=r"0001\.toml: a checksum that does not fit.*backup"):
        library.version("225-55R17")


def test_every_truncation_is_noticed(folder, source):
    version = TyreLibrary(folder).add(source, author="a")
    path = folder / version.tyre / "0001.toml"
    text = path.read_text()
    for length in range(0, len(text) - 1, 7):
        path.write_text(text[:length])
        with pytest.raises(DamagedFile):
            unsealed(path)


def test_converted_line_ends_are_no_damage(folder, source):
    version = TyreLibrary(folder).add(source, author="a", note="line\nline")
    path = folder / version.tyre / "0001.toml"
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert TyreLibrary(folder).version("225-55R17") == version


def test_bytes_that_are_no_text_are_damage(tmp_path):
    path = tmp_path / "0001.toml"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(DamagedFile, match="no text"):
        unsealed(path)


def test_a_missing_version_is_reported_not_skipped(folder, source):
    library = TyreLibrary(folder)
    for _ in range(3):
        library.add(source, author="a")
    tyre = library.tyre("225-55R17")
    (tyre.path / "0002.toml").unlink()
    whole, damage = tyre.versions()
    assert [version.number for version in whole] == [1, 3]
    assert [Path(error.where).name for error in damage] == ["0002.toml"]
    with pytest.raises(DamagedFile):
        tyre.intact_versions()


def test_a_version_under_another_number_is_damage(folder, source):
    library = TyreLibrary(folder)
    library.add(source, author="a")
    path = folder / "225-55R17" / "0001.toml"
    path.with_name("0002.toml").write_text(path.read_text())
    with pytest.raises(DamagedFile, match="0002"):
        library.version("225-55R17@2")


def test_a_replaced_approved_version_is_noticed(folder, source, tmp_path):
    library = TyreLibrary(folder)
    tyre = library.tyre(library.add(source, author="a").tyre)
    tyre.approve(1, "a")
    (tyre.path / "0001.toml").unlink()
    library.add(written(tmp_path / "other.toml", varied()), author="b")
    with pytest.raises(DamagedFile, match="than the one that was approved"):
        tyre.chosen()


def test_an_approved_version_that_is_gone_is_noticed(folder, source):
    library = TyreLibrary(folder)
    for _ in range(2):
        library.add(source, author="a")
    tyre = library.tyre("225-55R17")
    tyre.approve(2, "a")
    (tyre.path / "0002.toml").unlink()
    with pytest.raises(DamagedFile, match=r"0002.*though it was approved"):
        tyre.chosen()


def test_a_damaged_approval_hides_no_other(folder, source):
    library = TyreLibrary(folder)
    tyre = library.tyre(library.add(source, author="a").tyre)
    tyre.approve(1, "a")
    path = tyre.path / "approvals" / "0001.toml"
    path.write_text(path.read_text().replace('"a"', '"b"'))
    with pytest.raises(DamagedFile, match="approvals"):
        tyre.approved()
    assert tyre.version(1).parameters == SET


def test_the_checksum_is_the_last_line_and_that_of_all_lines_above():
    text = sealed("[table]\nvalue = 1\n")
    assert tomllib.loads(text)["table"]["value"] == 1
    assert text.splitlines()[-1].startswith('sha256 = "')
    assert len(text.splitlines()) == 3


def test_a_tyre_with_damage_can_still_be_added_to(folder, source):
    library = TyreLibrary(folder)
    for _ in range(2):
        library.add(source, author="a")
    (folder / "225-55R17" / "0002.toml").write_text("")
    assert library.add(source, author="a").number == 3
    (folder / "225-55R17" / "0001.toml").write_text("")
    (folder / "225-55R17" / "0003.toml").write_text("")
    with pytest.raises(InputError, match=r"0003\.toml"):
        library.add(source, author="a")
