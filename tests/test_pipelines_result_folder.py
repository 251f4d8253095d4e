"""The place of a result: at any moment the old one or the new one, whatever stops the writing."""

import io
import os
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from pipelines.exchange import exchange

from ema.errors import InputError
from pipelines import partial, result_folder
from pipelines.partial import partial_name, remove_abandoned
from pipelines.result_folder import MARKER, recover, require_free, written_whole

POSIX = os.name == "posix"
FILE_OPERATIONS = (
    *((os, name) for name in ("rename", "mkdir", "rmdir", "unlink", "fsync", "open")),
    (io, "open"),
    (result_folder, "exchange"),
)


class Killed(BaseException):
    """The end of the process: from here on it changes nothing any more."""


class Stopper:
    """Stops at the n-th file operation: there once, or from there on like a kill."""

    def __init__(self, monkeypatch, moment, error, *, for_good):
        self.count, self.moment, self.error, self.for_good = 0, moment, error, for_good
        self.patch = monkeypatch
        for module, name in FILE_OPERATIONS:
            monkeypatch.setattr(module, name, self.watched(getattr(module, name)))

    def watched(self, operation):
        def run(*arguments, **options):
            self.count += 1
            if self.count == self.moment or (self.for_good and self.count > self.moment):
                raise self.error
            return operation(*arguments, **options)

        return run

    @property
    def was_reached(self):
        return self.count >= self.moment


@pytest.fixture
def place(tmp_path):
    return tmp_path / "results" / "result"


def fill(folder, text):
    (folder / MARKER).write_text(text)
    (folder / "modes.csv").write_text(text)


def write(place, text, **options):
    with written_whole(place, **options) as folder:
        fill(folder, text)


def content(place):
    """The text that all files of a result share, and nothing else; None for no result."""
    if not place.exists():
        return None
    assert sorted(path.name for path in place.iterdir()) == sorted([MARKER, "modes.csv"])
    texts = {path.read_text() for path in place.iterdir()}
    assert len(texts) == 1
    return texts.pop()


def beside(place):
    return [path.name for path in place.parent.iterdir() if path != place]


def moments(run):
    """Run with a stop at the first, second, … file operation until none is left to stop at."""
    for moment in range(1, 200):
        if not run(moment):
            assert moment > 5
            return
    raise AssertionError("it never ends")


@pytest.mark.parametrize("in_one_step", [True, False])
@pytest.mark.parametrize("earlier", [None, "old"])
def test_a_kill_before_any_file_operation(place, monkeypatch, in_one_step, earlier):
    def killed(moment):
        shutil.rmtree(place.parent, ignore_errors=True)
        if earlier:
            write(place, earlier)
        with monkeypatch.context() as patch:
            if not in_one_step:
                patch.setattr(result_folder, "exchange", lambda *_: False)
            stopper = Stopper(patch, moment, Killed(), for_good=True)
            with suppress(Killed):
                write(place, "new", force=True)
        reached = stopper.was_reached
        if place.parent.exists():
            recover(place)
        assert content(place) in ({earlier, "new"} if reached else {"new"})
        with monkeypatch.context() as patch:
            patch.setattr(partial, "_may_run", lambda _: False)
            write(place, "next", force=True)
        assert content(place) == "next"
        assert beside(place) == []
        return reached

    moments(killed)


@pytest.mark.parametrize("in_one_step", [True, False])
@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), Killed()])
def test_a_failure_at_any_file_operation(place, monkeypatch, in_one_step, error):
    """One that is survived: an error of the drive, or an interrupt."""

    def failed(moment):
        shutil.rmtree(place.parent, ignore_errors=True)
        write(place, "old")
        outcome = "new"
        with monkeypatch.context() as patch:
            if not in_one_step:
                patch.setattr(result_folder, "exchange", lambda *_: False)
            stopper = Stopper(patch, moment, error, for_good=False)
            try:
                write(place, "new", force=True)
            except InputError as refusal:
                assert refusal.found == "No space left on device"
                outcome = "old"
            except Killed:
                outcome = content(place)
        assert content(place) == outcome
        assert all(name.endswith(".partial") or name == ".result.old" for name in beside(place))
        return stopper.was_reached

    moments(failed)


def test_a_failure_while_writing_leaves_nothing_and_makes_no_folders(place):
    with pytest.raises(ZeroDivisionError), written_whole(place / "deep" / "result") as folder:
        fill(folder, "new")
        raise ZeroDivisionError
    assert not place.parent.exists()


@pytest.mark.skipif(sys.platform not in ("linux", "darwin"), reason="the system cannot exchange")
def test_folders_change_places_in_one_step(tmp_path):
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text(name)
    assert exchange(tmp_path / "one", tmp_path / "other")
    assert (tmp_path / "one" / "file").read_text() == "other"
    assert (tmp_path / "other" / "file").read_text() == "one"
    assert not exchange(tmp_path / "one", tmp_path / "missing")
    assert (tmp_path / "one" / "file").read_text() == "other"


@pytest.mark.parametrize("platform", ["win32", "freebsd14"])
def test_elsewhere_they_do_not_and_a_result_is_replaced_all_the_same(place, monkeypatch, platform):
    monkeypatch.setattr(sys, "platform", platform)
    write(place, "old")
    assert not exchange(place, place.parent)
    write(place, "new", force=True)
    assert content(place) == "new"
    assert beside(place) == []


def test_what_was_moved_aside_is_put_back(place):
    write(place, "old")
    place.rename(place.with_name(".result.old"))
    recover(place)
    assert content(place) == "old"
    assert beside(place) == []
    place.rename(place.with_name(".result.old"))
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
