"""What every command says, and how: on a screen, into a pipe, for a program."""

from __future__ import annotations

import errno
import json
import math
import os
import sys
from types import TracebackType
from typing import TYPE_CHECKING, Any

from ema.visible import escaped, visible_line

if TYPE_CHECKING:
    from rich.console import Console

_OF_DRIVES = (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EROFS, errno.EFBIG)
_PIPE_WIDTH = 10_000  # a pipe has no edge at which lines would have to break


def screen(*, errors: bool = False) -> Console:
    """Standard output or error: as wide as the terminal, colours on a terminal only.

    ``NO_COLOR``, ``FORCE_COLOR`` and ``COLUMNS`` are respected.
    """
    from rich.console import Console

    stream = sys.stderr if errors else sys.stdout
    is_piped = not stream.isatty() and "COLUMNS" not in os.environ
    return Console(stderr=errors, width=_PIPE_WIDTH if is_piped else None, highlight=False)


def say(message: str) -> None:
    """Print one message on standard output."""
    print(printable(message))  # noqa: T201


def print_json(content: Any) -> None:
    """Print a result for programs, in plain ASCII, which every console can show."""
    print(escaped(json.dumps(plain(content), indent=2, allow_nan=False)))  # noqa: T201


def complain(message: str) -> None:
    """Print one message on standard error."""
    print(printable(message), file=sys.stderr)  # noqa: T201


def printable(text: str) -> str:
    """A text from a file as a terminal may show it: in one line, without control sequences."""
    return visible_line(text)


def file_trouble(error: OSError) -> str:
    """Message for a file, or a drive, that cannot be read or written any more."""
    return (
        f"Error: {error.filename or 'drive'}: {error.strerror}; it could be neither read nor "
        "written. Check that the drive is there, its free space and what it permits."
    )


def is_drive_trouble(error: OSError) -> bool:
    """Whether a file or its drive is at fault; what a library writes may not name the file."""
    return error.filename is not None or error.errno in _OF_DRIVES


def out_of_memory(error: MemoryError) -> str:
    """Message for recordings that are too large for the machine."""
    detail = f" ({error})" if str(error) else ""
    return (
        f"Error: not enough memory{detail}. "
        "Close other programs, take shorter blocks or a narrower band, or use a larger machine."
    )


def report_fault(
    kind: type[BaseException], fault: BaseException, _: TracebackType | None = None
) -> None:
    """Say in one line that the program failed; Python ends it with exit code 1."""
    complain(
        f"Internal error: {kind.__name__}: {fault}. Please report it "
        "with the command and this line; `ringmodal --debug …` or RINGMODAL_DEBUG=1 shows where."
    )


def plain(value: Any) -> Any:
    """Values as JSON has them: without NaN, infinity, dates and numpy's numbers."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if hasattr(value, "isoformat"):  # a date or time out of TOML
        return value.isoformat()
    if hasattr(value, "item"):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
