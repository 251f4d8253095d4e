"""What other users of the machine can do to a batch: nothing that its files' modes do not allow."""

import os
import shutil
import stat
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from fleets import write_campaign

pytestmark = pytest.mark.skipif(
    not Path("/proc/net/unix").exists(), reason="the system does not list its sockets"
)
NOBODY = 65534
N_CAMPAIGNS = 3
SOCKETS = {"tcp": 9, "tcp6": 9, "udp": 9, "udp6": 9, "unix": 6}  # → column of the inode
LISTENING, UDP_BOUND, ACCEPTING = "0A", "07", 0x10000


@contextmanager
def batch_at_work(campaign, umask):
    """A batch with two workers and a umask, in a folder that others may look into."""
    place = Path(tempfile.mkdtemp())  # pytest's own folders are closed
    place.chmod(0o755)
    for number in range(N_CAMPAIGNS):
        write_campaign(campaign, place / "root" / f"tyre_{number}")
    program = [sys.executable, "-m", "pipelines.cli.main"]
    options = ["--jobs", "2", "--no-tune", "--max-order", "20", "--quiet"]
    paths = os.pathsep.join([str(Path(__file__).parents[3]), *sys.path])
    process = subprocess.Popen(
        [*program, "batch", place / "root", "--out", place / "out", *options],
        env={**os.environ, "PYTHONPATH": paths},
        stdout=subprocess.DEVNULL,
        umask=umask,
    )
    try:
        yield process, place
    finally:
        process.kill()
        process.wait()
        shutil.rmtree(place)


@contextmanager
def another_user():
    """Do what follows with the rights of a second user; there needs to be no account of it."""
    groups = os.getgroups()
    os.setgroups([])
    os.setegid(NOBODY)
    os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)
        os.setegid(0)
        os.setgroups(groups)


def family(process):
    """A process and all its children."""
    found = [process]
    for path in Path(f"/proc/{process}/task").glob("*/children"):
        with suppress(OSError):  # it has ended
            for child in path.read_text().split():
                found += family(int(child))
    return found


def listening_inodes():
    """Sockets of this machine that somebody could reach."""
    found = set()
    for kind, column in SOCKETS.items():
        with suppress(OSError):  # a system without it
            for line in Path(f"/proc/net/{kind}").read_text().splitlines()[1:]:
                cells = line.split()
                waits = (
                    bool(int(cells[3], 16) & ACCEPTING) or len(cells) > column + 1
                    if kind == "unix"
                    else cells[3] == (UDP_BOUND if kind.startswith("udp") else LISTENING)
                )
                if waits:
                    found.add(cells[column])
    return found


def reachable(processes):
    """Sockets among those that these processes hold."""
    listening, found = listening_inodes(), []
    for process in processes:
        with suppress(OSError):  # it has ended
            for link in Path(f"/proc/{process}/fd").iterdir():
                with suppress(OSError):
                    target = str(link.readlink())
                    if target.removeprefix("socket:[").rstrip("]") in listening:
                        found.append((process, target))
    return found


def readable(paths):
    """Files and folders whose content may be read."""
    found = []
    for path in paths:
        with suppress(OSError):
            if path.is_dir():
                list(path.iterdir())
            else:
                path.open("rb").close()
            found.append(path)
    return found


def everything(folder):
    """All files and folders in a folder, in which things are renamed meanwhile."""
    for parent, folders, files in os.walk(folder):
        yield from (Path(parent, name) for name in (*folders, *files))


def watched(process, out):
    """Yield as long as a batch runs, with its processes once it has begun to write."""
    while process.poll() is None:
        processes = family(process.pid)
        if len(processes) > 2 and (out / "records").is_dir():  # the batch and two workers
            yield processes
        time.sleep(0.02)
    assert process.returncode == 0


@pytest.fixture(scope="module")
def observed(short_campaign):
    """Of a batch: sockets within reach, look by look, and the modes of all that it wrote."""
    looks, modes = [], {}
    with batch_at_work(short_campaign, 0o027) as (batch, place):
        for processes in watched(batch, place / "out"):
            looks.append(reachable(processes))
            for path in everything(place / "out"):
                with suppress(OSError):  # it has been renamed
                    modes[path] = stat.S_IMODE(path.lstat().st_mode)
    return looks, modes


def test_nothing_that_listens_belongs_to_a_batch(observed):
    looks, _ = observed
    assert len(looks) > 5
    assert not any(looks)


def test_what_does_listen_is_seen():
    with subprocess.Popen(
        [sys.executable, "-c", "import socket; s = socket.create_server(('', 0)); input()"],
        stdin=subprocess.PIPE,
    ) as server:
        while not (found := reachable([server.pid])) and server.poll() is None:
            time.sleep(0.02)
        server.communicate()
    assert len(found) == 1


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can act as another user"
)
def test_a_second_user_reads_nothing_that_was_not_given(short_campaign):
    seen, n_looks = set(), 0
    with batch_at_work(short_campaign, 0o077) as (batch, place):
        (place / "given").write_text("to all")
        for processes in watched(batch, place / "out"):
            inside = [place / "out", *everything(place / "out")]
            secrets = [
                Path(f"/proc/{each}/{what}")
                for each in processes
                for what in ("fd", "environ", "mem")
            ]
            with another_user():
                assert readable([*inside, *secrets, place / "given"]) == [place / "given"]
            seen.update(path.name for path in inside)
            n_looks += 1
    assert n_looks > 5
    assert any(name.endswith(".partial") for name in seen)


def test_what_is_half_written_is_as_open_as_what_is_whole(observed):
    _, modes = observed
    assert any(path.name.endswith(".partial") for path in modes)
    assert all(mode & 0o027 == 0 for mode in modes.values())
