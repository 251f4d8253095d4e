"""Files of versions and approvals: edited, damaged, missing, forged."""

import tomllib
from pathlib import Path

import pytest
import tomlkit
from library import DESIGNATION, SET, varied, written

from ema.core.errors import InputError
from pipelines.library.history import history_of
from pipelines.library.library import TyreLibrary
from pipelines.storage.checksums import DamagedFile, sealed, unsealed


@pytest.fixture
def source(tmp_path):
    return written(tmp_path / "tyre.toml")


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "library"


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


@pytest.fixture
def tyre(tmp_path):
    """A tyre with two versions, the first of them approved."""
    library = TyreLibrary(tmp_path / "library")
    for recording in "12":
        library.add(written(tmp_path / "set.toml", varied(recording)), author="Ada")
    found = library.tyre(DESIGNATION)
    found.approve(1, "Ada")
    return found


def forge(path, change):
    """Change the content of a file and give it the checksum of what it is then."""
    content = tomllib.loads(path.read_text())
    change(content)
    for table in (content, content.get("version")):
        if isinstance(table, dict):
            table.pop("sha256", None)
    path.write_text(sealed(tomlkit.dumps(content)))


@pytest.mark.parametrize(
    "change",
    [
        lambda content: content.pop("author"),
        lambda content: content.update(author=3),
        lambda content: content.update(version="1"),
        lambda content: content.update(event="forget"),
        lambda content: content.pop("version_sha256"),
        lambda content: content.update(note=[1]),
    ],
)
def test_an_approval_that_nobody_wrote_is_damage(tyre, change):
    forge(tyre.path / "approvals" / "0001.toml", change)
    with pytest.raises(DamagedFile, match=r"approvals/0001\.toml"):
        tyre.approved()


@pytest.mark.parametrize(
    "change",
    [
        lambda content: content["version"].pop("author"),
        lambda content: content["version"].update(note=1.5),
        lambda content: content.update(version=7),
        lambda content: content.pop("ring"),
        lambda content: content["ring"]["mean_radius_m"].update(value="wide"),
        lambda content: content.update(more={"last": True}),  # the checksum ends up in there
    ],
)
def test_a_version_that_nobody_wrote_is_damage(tyre, change):
    forge(tyre.path / "0002.toml", change)
    assert [error.where for error in history_of(tyre).damage] == [str(tyre.path / "0002.toml")]


def test_a_checksum_over_what_is_no_toml_is_damage(tyre):
    (tyre.path / "0002.toml").write_text(sealed("schema = = 1\n"))
    with pytest.raises(DamagedFile, match=r"0002\.toml"):
        tyre.version(2)


def test_damage_of_an_approved_version_is_named_once(tyre):
    (tyre.path / "0001.toml").write_text("")
    assert [error.where for error in history_of(tyre).damage] == [str(tyre.path / "0001.toml")]
