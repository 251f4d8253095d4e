"""Plain messages on standard output and error; tables and progress bars are in `screen`."""

from __future__ import annotations

import json
import logging
import sys
from types import TracebackType
from typing import Any

from ema.core.display import jsonable
from ema.core.errors import escaped
from ema.core.errors import visible_line as printable

__all__ = ["echo", "echo_error", "print_json", "printable", "report_fault", "show_logs"]


def echo(message: str) -> None:
    """Print one line on standard output, control characters in it made visible."""
    print(printable(message))  # noqa: T201


def echo_error(message: str) -> None:
    """Print one line on standard error, control characters in it made visible."""
    print(printable(message), file=sys.stderr)  # noqa: T201


def print_json(content: Any) -> None:
    """Print a result for programs, in plain ASCII, which every console can show."""
    print(escaped(json.dumps(jsonable(content), indent=2, allow_nan=False)))  # noqa: T201


class _OnScreen(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        echo_error(record.getMessage())


def show_logs(level: int = logging.WARNING) -> None:
    """Print what the packages log from a level on, as messages on standard error."""
    logging.basicConfig(level=level, handlers=[_OnScreen()], force=True)


def report_fault(
    kind: type[BaseException], fault: BaseException, _: TracebackType | None = None
) -> None:
    """Report an internal error in one line; Python then ends with exit code 1."""
    echo_error(
        f"Internal error: {kind.__name__}: {fault}. Please report it "
        "with the command and this line; `ringmodal --debug …` or RINGMODAL_DEBUG=1 shows where."
    )
