"""The place of a result: at any moment the old one or the new one, whatever stops the writing."""

import hashlib
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import pytest

from ema.core.errors import InputError
from pipelines.storage import atomic as partial
from pipelines.storage.atomic import (
    MARKER,
    partial_name,
    recover,
    remove_abandoned,
    require_free,
    written_whole,
)
from pipelines.storage.checksums import read_marker, write_marker

POSIX = os.name == "posix"
FILE_OPERATIONS = (
    *((os, name) for name in ("rename", "mkdir", "rmdir", "unlink", "fsync", "open")),
    (io, "open"),
)


THEIRS = "written by somebody else"


class Killed(BaseException):
    """The end of the process: from here on it changes nothing any more."""


class Stopper:
    """Stops at the n-th file operation: there once, or from there on like a kill.

    Right before another operation, somebody else may do something.
    """

    def __init__(self, monkeypatch, moment, error, *, for_good, others=None):
        self.count, self.moment, self.error, self.for_good = 0, moment, error, for_good
        self.others, self.paused = others or {}, False
        self.patch = monkeypatch
        for module, name in FILE_OPERATIONS:
            monkeypatch.setattr(module, name, self.watched(getattr(module, name)))

    def watched(self, operation):
        def run(*arguments, **options):
            if self.paused:
                return operation(*arguments, **options)
            self.count += 1
            if self.count in self.others:
                self.paused = True
                self.others.pop(self.count)()
                self.paused = False
            if self.count == self.moment or (self.for_good and self.count > self.moment):
                raise self.error
            return operation(*arguments, **options)

        return run

    @property
    def was_reached(self):
        return self.count >= self.moment


@pytest.fixture
def place(tmp_path):
    """In memory where a system has a folder for it: thousands of renames wait for a disk."""
    memory = Path("/dev/shm")
    if not os.access(memory, os.W_OK):
        memory = tmp_path
    with tempfile.TemporaryDirectory(dir=memory) as folder:
        yield Path(folder) / "results" / "result"


def fill(folder, text):
    (folder / "modes.csv").write_text(text)
    write_marker(folder / MARKER, {"campaign": text})


def write(place, text, **options):
    with written_whole(place, **options) as folder:
        fill(folder, text)


def content(place):
    """The text that all files of a result share, and nothing else; None for no result."""
    if not place.exists():
        return None
    assert sorted(path.name for path in place.iterdir()) == sorted([MARKER, "modes.csv"])
    text = (place / "modes.csv").read_text()
    assert read_marker(place / MARKER).content == {"campaign": text}
    return text


def beside(place):
    return [path.name for path in place.parent.iterdir() if path != place]


def moments(run):
    """Run with a stop at the first, second, … file operation until none is left to stop at."""
    for moment in range(1, 200):
        if not run(moment):
            assert moment > 5
            return
    raise AssertionError("it never ends")


@pytest.mark.parametrize("earlier", [None, "old"])
def test_a_kill_before_any_file_operation(place, monkeypatch, earlier):
    def killed(moment):
        shutil.rmtree(place.parent, ignore_errors=True)
        if earlier:
            write(place, earlier)
        with monkeypatch.context() as patch:
            stopper = Stopper(patch, moment, Killed(), for_good=True)
            with suppress(Killed):
                write(place, "new", force=True)
        reached = stopper.was_reached
        if place.parent.exists():
            recover(place)
        assert content(place) in ({earlier, "new"} if reached else {"new"})
        write_after_a_kill(monkeypatch, place)
        assert content(place) == "next"
        assert beside(place) == []
        return reached

    moments(killed)


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), Killed()])
def test_a_failure_at_any_file_operation(place, monkeypatch, error):
    """One that is survived: an error of the drive, or an interrupt."""

    def failed(moment):
        shutil.rmtree(place.parent, ignore_errors=True)
        write(place, "old")
        outcome = "new"
        with monkeypatch.context() as patch:
            stopper = Stopper(patch, moment, error, for_good=False)
            try:
                write(place, "new", force=True)
            except InputError as refusal:
                assert refusal.found == "No space left on device"
                outcome = "old"
            except Killed:
                outcome = content(place)
        assert content(place) == outcome
        assert all(name.endswith((".partial", ".old")) for name in beside(place))
        return stopper.was_reached

    moments(failed)


def write_after_a_kill(monkeypatch, place):
    with monkeypatch.context() as patch:
        patch.setattr(partial, "_may_run", lambda _: False)
        write(place, "next", force=True)


def in_sight(place):
    """Texts of all files that a user finds there without looking for hidden folders beside it."""
    shown = [path for path in place.parent.iterdir() if not path.name.startswith(".")]
    return [file.read_text() for path in shown for file in path.rglob("*") if file.is_file()]


@pytest.mark.parametrize("name", [".notes.txt", ".git", "modes.csv", MARKER])
@pytest.mark.parametrize("kill_after", [0, 1, 2, 3, 5, 1000])
def test_what_somebody_puts_into_a_result_at_any_moment_is_not_lost(
    place, monkeypatch, name, kill_after
):
    """It is new or takes the place of a file of the result, and a kill may follow soon."""

    def added(moment):
        shutil.rmtree(place.parent, ignore_errors=True)
        write(place, "old")
        theirs = []

        def add():
            if place.is_dir():
                theirs.append(place / name)
                if name == ".git":
                    (place / name).mkdir()
                    theirs[0] = place / name / "config"
                theirs[0].write_text(THEIRS)

        with monkeypatch.context() as patch:
            end = moment + kill_after
            stopper = Stopper(patch, end, Killed(), for_good=True, others={moment: add})
            with suppress(Killed, InputError):
                write(place, "new", force=True)
        recover(place)
        with suppress(InputError):
            write_after_a_kill(monkeypatch, place)
        assert not theirs or THEIRS in in_sight(place)
        assert place.is_dir()
        return stopper.count >= moment

    moments(added)


def test_a_failure_while_writing_leaves_nothing_and_makes_no_folders(place):
    with pytest.raises(ZeroDivisionError), written_whole(place / "deep" / "result") as folder:
        fill(folder, "new")
        raise ZeroDivisionError
    assert not place.parent.exists()


def test_what_was_moved_aside_is_put_back(place):
    write(place, "old")
    aside = partial_name(place, "old")
    place.rename(aside)
    recover(place)
    assert content(place) == "old"
    assert beside(place) == []
    place.rename(aside)
    with pytest.raises(InputError, match="an earlier result"):
        require_free(place, force=False)
    assert content(place) == "old"


def test_of_two_writers_the_last_wins_with_force_and_the_first_without(place):
    with written_whole(place, force=True) as slow:
        fill(slow, "slow")
        write(place, "fast")
    assert content(place) == "slow"
    shutil.rmtree(place)
    with pytest.raises(InputError, match="an earlier result"), written_whole(place) as slow:
        fill(slow, "slow")
        write(place, "fast")
    assert content(place) == "fast"
    assert beside(place) == []


def test_only_what_the_dead_left_is_removed(place):
    place.parent.mkdir()
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        pass
    own = partial_name(place)
    dead = own.with_name(own.name.replace(f"-{os.getpid()}-", f"-{ended.pid}-"))
    living = own.with_name(own.name.replace(f"-{os.getpid()}-", f"-{os.getppid()}-"))
    foreign = own.with_name(dead.name.replace(".result.", ".result.elsewhere"))
    other = own.with_name(dead.name.replace(".result.", ".result_2."))
    for path in (own, dead, living, foreign, other):
        path.mkdir()
        (path / "modes.csv").write_text("")
    file = dead.with_name(
        dead.name.replace(".partial", "").rpartition("-")[0] + "-01234567.partial"
    )
    file.write_text("")
    remove_abandoned(place)
    stays = {own, living, foreign, other} | (set() if POSIX else {dead, file})
    assert set(place.parent.iterdir()) == stays


def test_a_link_to_a_result_stays_a_link(place, tmp_path):
    write(place, "old")
    link = tmp_path / "latest"
    link.symlink_to(place, target_is_directory=True)
    write(link, "new", force=True)
    assert link.is_symlink()
    assert content(place) == "new"
    assert beside(place) == []


def test_a_result_has_the_rights_of_any_new_folder(place):
    (place.parent / "any").mkdir(parents=True)
    write(place, "new")
    assert place.stat().st_mode == (place.parent / "any").stat().st_mode


def test_a_drive_cannot_be_a_result(place, monkeypatch):
    place.mkdir(parents=True)
    monkeypatch.setattr(os.path, "ismount", lambda path: Path(path) == place)
    with pytest.raises(InputError, match=r"a drive.*Choose a folder in it"):
        require_free(place, force=False)


@pytest.mark.skipif(not POSIX or os.geteuid() == 0, reason="nothing is read-only to root")
def test_a_read_only_place_is_refused(place):
    write(place, "old")
    place.chmod(0o555)
    with pytest.raises(InputError, match="a read-only folder"):
        require_free(place, force=True)
    place.chmod(0o755)
    place.parent.chmod(0o555)
    with pytest.raises(InputError, match="Permission denied"):
        require_free(place.parent / "new", force=False)
    place.parent.chmod(0o755)


@pytest.mark.skipif(sys.platform != "linux", reason="a place that refuses even root")
def test_a_place_that_refuses_folders_is_noticed_before_anything_is_written():
    with pytest.raises(InputError, match="could not be written"):
        require_free(Path("/proc/result"), force=False)


def test_a_name_too_long_is_noticed(tmp_path):
    with pytest.raises(InputError, match="name too long"):
        require_free(tmp_path / ("n" * 300), force=False)


def test_a_folder_that_vanishes_while_it_is_written(place):
    with pytest.raises(InputError, match="could not be written"), written_whole(place) as folder:
        fill(folder, "new")
        shutil.rmtree(place.parent)
    assert not place.parent.exists()


def test_a_folder_that_vanishes_before_is_made_again(place):
    place.parent.mkdir()
    require_free(place, force=False)
    place.parent.rmdir()
    write(place, "new")
    assert content(place) == "new"


def snapshot(folder):
    """Everything in a folder: names, links, contents."""
    found = {}
    for path in folder.rglob("*"):
        is_plain = path.is_file() and not path.is_symlink()
        found[path] = path.read_bytes() if is_plain else path.is_symlink()
    return found


def links_elsewhere(place):
    (place.parent / "thesis.txt").write_text(THEIRS)
    (place / "thesis.txt").symlink_to(place.parent / "thesis.txt")


def is_linked(place):
    (place / "modes.csv").rename(place.parent / "modes.csv")
    (place / "modes.csv").symlink_to(place.parent / "modes.csv")


def lists_names_alone(place):
    content = {"campaign": "old", "files": ["modes.csv", MARKER]}
    (place / MARKER).write_text(json.dumps(content))


def lists_one_more(place):
    (place / "thesis.txt").write_text(THEIRS)
    content = json.loads((place / MARKER).read_text())
    content["files"]["thesis.txt"] = hashlib.sha256(THEIRS.encode()).hexdigest()
    (place / MARKER).write_text(json.dumps(content))


THEIR_DOINGS = {
    "a note": lambda place: (place / "notes.txt").write_text(THEIRS),
    "a hidden note": lambda place: (place / ".notes.txt").write_text(THEIRS),
    "a repository": lambda place: (place / ".git").mkdir(),
    "a folder": lambda place: (place / "src").mkdir(),
    "a link": links_elsewhere,
    "a file made a link": is_linked,
    "a changed file": lambda place: (place / "modes.csv").write_text(THEIRS),
    "a folder named like litter": lambda place: (place / ".DS_Store").mkdir(),
    "a damaged list": lambda place: (place / MARKER).write_text("{"),
    "a list of their own": lambda place: (place / MARKER).write_text('{"what": "my own"}'),
    "a list that is none": lambda place: (place / MARKER).write_text('{"files": 3}'),
    "a list of names": lists_names_alone,
    "a longer list": lists_one_more,
}


@pytest.mark.parametrize("doing", THEIR_DOINGS)
def test_what_the_program_did_not_write_is_never_replaced(place, doing):
    write(place, "old")
    THEIR_DOINGS[doing](place)
    before = snapshot(place.parent)
    with pytest.raises(InputError), written_whole(place, force=True):
        raise AssertionError("it was taken for an earlier result")
    assert snapshot(place.parent) == before


def test_a_folder_with_a_list_that_is_not_the_programs_is_never_replaced(place):
    (place / "src").mkdir(parents=True)
    (place / "src" / "thesis.txt").write_text(THEIRS)
    (place / MARKER).write_text('{"what": "my own"}')
    before = snapshot(place.parent)
    with pytest.raises(InputError, match=MARKER):
        write(place, "new", force=True)
    assert snapshot(place.parent) == before


@pytest.mark.parametrize("name", ["Thumbs.db", "desktop.ini", ".DS_Store"])
def test_what_file_managers_leave_is_in_nobodys_way(place, name):
    write(place, "old")
    (place / name).write_text("")
    write(place, "new", force=True)
    assert content(place) == "new"
    shutil.rmtree(place)
    place.mkdir()
    (place / name).write_text("")
    write(place, "next")
    assert content(place) == "next"
    assert beside(place) == []


def test_a_change_is_replaced_where_it_was_accepted_and_only_as_it_was_then(place):
    write(place, "old")
    (place / "modes.csv").write_text("edited")
    accepted = {"modes.csv": hashlib.sha256(b"edited").hexdigest()}
    with written_whole(place, force=True, accepted=accepted) as folder:
        fill(folder, "new")
    assert content(place) == "new"
    (place / "modes.csv").write_text("edited again")
    with pytest.raises(InputError, match=r"modes\.csv"):
        require_free(place, force=True, accepted=accepted)
    assert beside(place) == []


def test_what_a_killed_process_left_stays_where_it_holds_something_else(place, monkeypatch):
    place.parent.mkdir()
    left, other = partial_name(place), partial_name(place)
    for folder in (left, other):
        folder.mkdir()
        (folder / "modes.csv").write_text("half")
    (other / ".git").mkdir()
    monkeypatch.setattr(partial, "_may_run", lambda _: False)
    remove_abandoned(place)
    assert set(place.parent.iterdir()) == {other}
