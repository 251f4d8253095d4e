"""Single files: the old one or the new one, nothing beside it."""

import os
import subprocess
import sys

import pytest

from ema.core.errors import InputError
from pipelines.storage.atomic import file_written_whole, partial_name


def test_a_file_appears_when_all_is_written(tmp_path):
    path = tmp_path / "waves.csv"
    path.write_text("old")
    with file_written_whole(path) as partial:
        partial.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_failure_leaves_the_old_file(tmp_path, error):
    path = tmp_path / "waves.csv"
    path.write_text("old")
    expected = InputError if isinstance(error, OSError) else KeyboardInterrupt
    with pytest.raises(expected), file_written_whole(path) as partial:
        partial.write_text("half")
        raise error
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_is_not_there(tmp_path):
    (tmp_path / "file").write_text("")
    for parent in ("nowhere", "file"):
        path = tmp_path / parent / "waves.csv"
        with pytest.raises(InputError, match="could not be written"), file_written_whole(path):
            raise AssertionError("nothing should be written")


@pytest.mark.skipif(os.name == "nt", reason="there, leftovers stay")
def test_what_a_killed_process_left_goes_with_the_next_file(tmp_path):
    path = tmp_path / "waves.csv"
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        pass
    name = partial_name(path).name.replace(f"-{os.getpid()}-", f"-{ended.pid}-")
    (tmp_path / name).write_text("half")
    with file_written_whole(path) as partial:
        partial.write_text("new")
    assert list(tmp_path.iterdir()) == [path]


def test_a_link_to_a_file_stays_a_link(tmp_path):
    (tmp_path / "results").mkdir()
    (tmp_path / "latest.csv").symlink_to("results/waves.csv")
    with file_written_whole(tmp_path / "latest.csv") as partial:
        partial.write_text("new")
    assert (tmp_path / "latest.csv").is_symlink()
    assert (tmp_path / "results" / "waves.csv").read_text() == "new"


@pytest.mark.skipif(os.name == "nt", reason="pipes with a name are of POSIX")
def test_a_pipe_is_written_into_and_never_replaced(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    with file_written_whole(pipe) as partial:
        partial.write_text("new")
    assert os.read(reading, 10) == b"new"
    os.close(reading)
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]
