"""What is not complete yet has a name of its own beside its place; what a kill left is removed."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


def partial_name(place: Path) -> Path:
    """A new hidden name beside `place`, which tells the machine and the process it belongs to."""
    return place.with_name(
        f"{_prefix(place)}{os.getpid()}-{secrets.token_hex(4)}.partial",
    )


@contextmanager
def partial_folder(place: Path) -> Iterator[Path]:
    """Yield a new folder beside `place` that is gone at the end, unless it was renamed.

    What killed processes of this machine left beside `place` is removed first.

    Raises
    ------
    OSError
        If no folder can be made there.
    """
    remove_abandoned(place)
    partial = partial_name(place)
    try:
        partial.mkdir()
        yield partial
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def remove_abandoned(place: Path) -> None:
    """Remove what processes that are gone left beside `place`.

    A process that runs, or runs on another machine, keeps what it has. On Windows nothing is
    removed: there is no harmless question whether a process runs.

    Raises
    ------
    OSError
        If the folder of `place` cannot be listed.
    """
    ours = re.compile(re.escape(_prefix(place)) + r"(\d{1,9})-[0-9a-f]{8}\.partial")
    for path in place.parent.iterdir():
        found = ours.fullmatch(path.name)
        if found is None or _may_run(int(found[1])):
            continue
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def discard(path: Path, place: Path) -> None:
    """Remove a folder beside `place` such that a kill leaves no half of it under its name."""
    discarded = partial_name(place)
    with suppress(OSError):  # it is not there, or stays until the next time
        path.rename(discarded)
        shutil.rmtree(discarded, ignore_errors=True)


def _prefix(place: Path) -> str:
    machine = re.sub(r"\W", "_", socket.gethostname())
    return f".{place.name}.{machine}-"


def _may_run(process: int) -> bool:
    if os.name == "nt":  # there, os.kill ends a process whatever the signal
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # somebody else's
        return True
    return True
