"""A single file that is written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ema.errors import InputError
from pipelines.library_seal import is_sealed
from pipelines.partial import partial_name, remove_abandoned


@contextmanager
def file_written_whole(path: Path) -> Iterator[Path]:
    """Yield a name beside `path`; the file written there takes its place at the end.

    A kill at any moment leaves the old file or the new one.

    Raises
    ------
    InputError
        If it cannot be written, or is a file of a library, which never changes; the old file
        stands and nothing is left behind.
    """
    place = Path(os.path.realpath(path))  # a link to a file stays a link
    if is_sealed(place):
        rule = "a version in a library never changes"
        raise InputError(str(path), "a file of a library", rule, "Choose another place")
    partial = partial_name(place)
    try:
        remove_abandoned(place)
        yield partial
        partial.replace(place)
    except OSError as error:
        raise InputError(
            str(path),
            os.strerror(error.errno) if error.errno else str(error),
            "the file could not be written",
            "Check free space and permissions, or choose another place",
        ) from error
    finally:
        with suppress(OSError):  # it took its place, or its folder is gone
            partial.unlink()
