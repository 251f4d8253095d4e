"""Files of a library whose checksum fits, and whose content is none that was ever written."""

import tomllib

import pytest
import tomlkit
from library import DESIGNATION, varied, written

from pipelines.library.history import history_of
from pipelines.library.library import TyreLibrary
from pipelines.storage.checksums import DamagedFile, sealed


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
