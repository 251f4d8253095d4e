"""What every command says, and how: on a screen, into a pipe, for a program."""

from __future__ import annotations

import json
import logging
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import TracebackType
from typing import TYPE_CHECKING, Any

from ema.core.errors import escaped, visible_line
from pipelines.storage.rounding import jsonable

if TYPE_CHECKING:
    from rich.console import Console

_PIPE_WIDTH = 10_000  # a pipe has no edge at which lines would have to break


def screen(*, errors: bool = False) -> Console:
    """Standard output or error: as wide as the terminal, colours on a terminal only.

    ``NO_COLOR``, ``FORCE_COLOR`` and ``COLUMNS`` are respected.
    """
    # Not for the help, which has to be there at once.
    from rich.console import Console

    stream = sys.stderr if errors else sys.stdout
    is_piped = not stream.isatty() and "COLUMNS" not in os.environ
    return Console(stderr=errors, width=_PIPE_WIDTH if is_piped else None, highlight=False)


def say(message: str) -> None:
    """Print one message on standard output."""
    print(printable(message))  # noqa: T201


def print_json(content: Any) -> None:
    """Print a result for programs, in plain ASCII, which every console can show."""
    print(escaped(json.dumps(jsonable(content), indent=2, allow_nan=False)))  # noqa: T201


def complain(message: str) -> None:
    """Print one message on standard error."""
    print(printable(message), file=sys.stderr)  # noqa: T201


class _OnScreen(logging.Handler):
    """Log records as messages on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        complain(record.getMessage())


def show_logs(level: int = logging.WARNING) -> None:
    """Show what the packages log from a level on, as messages on standard error."""
    logging.basicConfig(level=level, handlers=[_OnScreen()], force=True)


def printable(text: str) -> str:
    """A text from a file as a terminal may show it: in one line, without control sequences."""
    return visible_line(text)


def report_fault(
    kind: type[BaseException], fault: BaseException, _: TracebackType | None = None
) -> None:
    """Say in one line that the program failed; Python ends it with exit code 1."""
    complain(
        f"Internal error: {kind.__name__}: {fault}. Please report it "
        "with the command and this line; `ringmodal --debug …` or RINGMODAL_DEBUG=1 shows where."
    )


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Parameters
    ----------
    heading : str
    cells : sequence of str
    is_text : bool
        Left-aligned; numbers are right-aligned.
    folds : bool
        Whether long cells may take several lines.
    """

    heading: str
    cells: Sequence[str]
    is_text: bool = False
    folds: bool = False


def columns_of(
    headings: Sequence[str],
    rows: Sequence[Sequence[str]],
    texts: Sequence[str],
    folding: Sequence[str] = (),
) -> list[Column]:
    """Columns of a table that is known by its rows.

    Parameters
    ----------
    headings : sequence of str
    rows : sequence of sequence of str
        Each with a cell under every heading.
    texts, folding : sequence of str
        Headings of the columns that hold texts, and of those whose cells may take several lines.
    """
    return [
        Column(heading, [row[place] for row in rows], heading in texts, heading in folding)
        for place, heading in enumerate(headings)
    ]


def print_table(
    screen: Console,
    title: str,
    columns: Sequence[Column],
    first_to_go: Sequence[str] = (),
    least_width: int = 12,
) -> None:
    """Print a table; nothing of it is cut off without a word.

    Parameters
    ----------
    screen : rich.console.Console
    title : str
        Above the table; may be empty.
    columns : sequence of Column
        Those without any content are left out.
    first_to_go : sequence of str
        Headings of the columns that are left out where they do not fit, and then named beneath.
    least_width : int
        What a column that folds needs before others are left out for it.
    """
    # Not for the help, which has to be there at once.
    from rich.text import Text

    columns = [column for column in columns if any(column.cells)]
    gone: list[str] = []
    for heading in first_to_go:
        if _width_needed(screen, columns, least_width) <= screen.width:
            break
        if heading in (column.heading for column in columns):
            columns = [column for column in columns if column.heading != heading]
            gone.append(" ".join(heading.split()))
    if _width_needed(screen, columns, least_width) > screen.width:
        columns = [replace(column, folds=True) for column in columns]
    if title:
        screen.print(Text(printable(title), style="italic"), soft_wrap=True)
    screen.print(_table(columns))
    if gone:
        names = ", ".join(gone)
        screen.print(Text(f"Not shown, the screen is too narrow: {names}.", style="dim"))


def _width_needed(screen: Console, columns: Sequence[Column], least_width: int) -> int:
    unlimited = screen.options.update(width=1_000_000)
    full: int = screen.measure(_table(columns), options=unlimited).maximum
    longest = (max(map(len, column.cells)) for column in columns if column.folds)
    return full - sum(max(0, length - least_width) for length in longest)


def _table(columns: Sequence[Column]) -> Any:
    # Not for the help, which has to be there at once.
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for column in columns:
        table.add_column(
            column.heading,
            justify="left" if column.is_text else "right",
            no_wrap=not column.folds,
            overflow="fold",
        )
    for cells in zip(*(column.cells for column in columns), strict=True):
        table.add_row(*(Text(printable(cell)) for cell in cells))
    return table
