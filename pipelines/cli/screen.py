"""Tables and progress on a terminal, drawn by rich; plain lines where there is no terminal."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from time import monotonic

from rich import progress
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pipelines.cli.terminal import printable, show_logs

_PIPE_WIDTH = 10_000  # characters: lines in a pipe need not break
_LEAST_WIDTH = 12  # characters that a folding column keeps before other columns are left out


def screen(*, errors: bool = False) -> Console:
    """Standard output or error: as wide as the terminal, colours on a terminal only.

    ``NO_COLOR``, ``FORCE_COLOR`` and ``COLUMNS`` are respected.
    """
    stream = sys.stderr if errors else sys.stdout
    is_piped = not stream.isatty() and "COLUMNS" not in os.environ
    return Console(stderr=errors, width=_PIPE_WIDTH if is_piped else None, highlight=False)


def warn(text: str) -> None:
    """Print a warning on standard error, in colour on a terminal."""
    screen(errors=True).print(Text(printable(f"Warning: {text}"), style="yellow"))


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    heading: str
    cells: Sequence[str]
    is_text: bool = False  # left-aligned; numbers are right-aligned
    folds: bool = False  # whether long cells may take several lines


def columns_of(
    headings: Sequence[str],
    rows: Sequence[Sequence[str]],
    texts: Sequence[str],
    folding: Sequence[str] = (),
) -> list[Column]:
    """Columns from rows; `texts` and `folding` are headings of columns as in `Column`."""
    return [
        Column(heading, [row[place] for row in rows], heading in texts, heading in folding)
        for place, heading in enumerate(headings)
    ]


def print_table(
    title: str,
    columns: Sequence[Column],
    first_to_go: Sequence[str] = (),
    least_width: int = _LEAST_WIDTH,
) -> None:
    """Print a table on standard output; columns without any content are left out.

    Where the table is too wide, the columns with the headings `first_to_go` are left out in this
    order and named below it; before that, a folding column shrinks to `least_width` characters.
    """
    output = screen()
    columns = [column for column in columns if any(column.cells)]
    left_out: list[str] = []
    for heading in first_to_go:
        if _width_needed(output, columns, least_width) <= output.width:
            break
        if heading in (column.heading for column in columns):
            columns = [column for column in columns if column.heading != heading]
            left_out.append(" ".join(heading.split()))
    if _width_needed(output, columns, least_width) > output.width:
        columns = [replace(column, folds=True) for column in columns]
    if title:
        output.print(Text(printable(title), style="italic"), soft_wrap=True)
    output.print(_table(columns))
    if left_out:
        names = ", ".join(left_out)
        output.print(Text(f"Not shown, the screen is too narrow: {names}.", style="dim"))


def _width_needed(output: Console, columns: Sequence[Column], least_width: int) -> int:
    unlimited = output.options.update(width=1_000_000)
    full = output.measure(_table(columns), options=unlimited).maximum
    longest = (max(map(len, column.cells)) for column in columns if column.folds)
    return full - sum(max(0, length - least_width) for length in longest)


def _table(columns: Sequence[Column]) -> Table:
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


class Progress:
    """Progress of a command; this base class shows nothing."""

    def stage(self, activity: str) -> None:
        """Start a stage, which ends the one before."""

    def step(self, done: int, total: int) -> None:
        """Report how many equal parts of the stage are done."""

    def line(self, text: str) -> None:
        """Print a line."""


class Lines(Progress):
    """A line for each stage, and lines with a count and the time left."""

    def __init__(self) -> None:
        self._start_s = monotonic()
        self._count = ""

    def stage(self, activity: str) -> None:
        """Print the activity."""
        self._start_s, self._count = monotonic(), ""
        self.line(activity)

    def step(self, done: int, total: int) -> None:
        """Keep the count for the next line."""
        left_s = (monotonic() - self._start_s) / done * (total - done)
        left = f", {duration(left_s)} left" if done < total else ""
        self._count = f"[{done}/{total}{left}] "

    def line(self, text: str) -> None:
        """Print a text after the count."""
        print(printable(self._count + text), file=sys.stderr, flush=True)  # noqa: T201


class Bars(Progress):
    """A bar for each stage, with the time it took or will take."""

    def __init__(self, display: progress.Progress) -> None:
        self._display = display
        self._bar: progress.TaskID | None = None

    def stage(self, activity: str) -> None:
        """Fill the bar of the stage before and begin a new one."""
        self.end()
        self._bar = self._display.add_task(printable(activity), total=None, count="")

    def step(self, done: int, total: int) -> None:
        """Move the bar."""
        if self._bar is not None:
            count = f"{done}/{total}"
            self._display.update(self._bar, completed=done, total=total, count=count)

    def line(self, text: str) -> None:
        """Print a text above the bars."""
        self._display.console.print(Text(printable(text)))

    def end(self) -> None:
        """Fill the last bar."""
        if self._bar is not None:
            total = self._display.tasks[self._bar].total or 1
            self._display.update(self._bar, completed=total, total=total)


@contextmanager
def shown(*, quiet: bool) -> Iterator[Progress]:
    """Progress on standard error: bars on a terminal, lines elsewhere, nothing if `quiet`."""
    if quiet:
        show_logs(logging.ERROR)
        yield Progress()
    elif sys.stderr.isatty():
        with bars_on(Console(stderr=True)) as bars:
            yield bars
    else:
        yield Lines()


@contextmanager
def bars_on(console: Console) -> Iterator[Bars]:
    """Bars on a terminal; the last one is filled only if the block ends without an error."""
    columns = (
        progress.TextColumn("{task.description}", markup=False),
        progress.BarColumn(),
        progress.TextColumn("{task.fields[count]}"),
        progress.TimeRemainingColumn(compact=True, elapsed_when_finished=True),
    )
    with progress.Progress(*columns, console=console) as display:
        bars = Bars(display)
        yield bars
        bars.end()


def duration(seconds: float) -> str:
    """A rounded time: "40 s", "12 min", "3 h 20 min"."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
