"""Processes that add versions: ``adding.py many|kills|begin FOLDER SOURCE links|turns``.

``many`` adds EACH versions. ``kills`` adds again and again from copies of itself, each killed one
file operation later than the one before, until a copy gets to its end; ``begin`` does so with a new
library each time. Both print how many were killed.
"""

import errno
import os
import signal
import sys
from pathlib import Path

from pipelines.library import numbering
from pipelines.library.library import TyreLibrary

EACH = 10
_OF_FILES = {*("open", "os.link", "os.rename", "os.remove", "os.mkdir", "os.listdir", "os.scandir")}


def without_links(*_):
    raise OSError(errno.EOPNOTSUPP, "no links on this drive")


def add_many(folder, source):
    for _ in range(EACH):
        TyreLibrary(folder).add(source, author=str(os.getpid()))


def add_until_no_kill_is_left(folder, source):
    """Kill before every file operation in turn; numbers must follow each other all the time."""
    library, operation = TyreLibrary(folder), 1
    library.add(source, author="first")  # what is imported on the way is there from now on
    expected = 1
    while killed_before(operation, lambda: library.add(source, author="killed")):
        operation += 1
        (tyre,) = library.tyres()
        found = len(tyre.intact_versions())
        assert found in (expected, expected + 1), (operation, found)
        expected = found + 1
        assert library.add(source, author="next").number == expected, operation
    print(operation - 1)  # noqa: T201


def begin_until_no_kill_is_left(folder, source):
    """The same for the very first version of a library."""
    operation, killed = 0, True
    TyreLibrary(folder.with_name("warm")).add(source, author="first")
    while killed:
        operation += 1
        library = TyreLibrary(folder.with_name(f"{folder.name} {operation}"))
        killed = killed_before(operation, lambda here=library: here.add(source, author="killed"))
        tyres = library.tyres() if library.folder.exists() else ()
        numbers = [each.number for tyre in tyres for each in tyre.intact_versions()]
        assert numbers in ([1], [] if killed else [1]), operation
    print(operation - 1)  # noqa: T201


def killed_before(operation, task):
    """Whether a copy of this process got as far as its n-th file operation, where it is killed."""
    child = os.fork()
    if child == 0:
        left = operation

        def count(event, arguments):
            nonlocal left
            if event in _OF_FILES and not str(arguments[0]).endswith((".py", ".pyc")):
                left -= 1
                if left == 0:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(count)
        status = 1
        try:
            task()
            status = 0
        finally:
            os._exit(status)
    _, status = os.waitpid(child, 0)
    assert status == 0 or os.WIFSIGNALED(status)
    return os.WIFSIGNALED(status)


def main():
    what, folder, source, means = sys.argv[1:]
    if means == "turns":
        os.link = without_links
        if what != "many":
            numbering.ABANDONED_S = 0.05
    tasks = {
        "many": add_many,
        "kills": add_until_no_kill_is_left,
        "begin": begin_until_no_kill_is_left,
    }
    tasks[what](Path(folder), Path(source))


if __name__ == "__main__":
    main()
