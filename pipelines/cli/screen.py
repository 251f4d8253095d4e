"""Tables and progress on a terminal, drawn by rich; plain lines where there is no terminal."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from time import monotonic
from typing import Any

from rich import progress
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pipelines.cli.terminal import printable, show_logs

_PIPE_WIDTH = 10_000  # characters: lines in a pipe need not break
_LEAST_WIDTH = 10  # characters that a folding column keeps before other columns are left out


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


def say(text: str) -> None:
    """Print a sentence on standard output, broken at the width of the screen."""
    screen().print(Text(printable(text)))


def print_table(
    title: str,
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    texts: Sequence[str] = (),
    folding: Sequence[str] = (),
    first_to_go: Sequence[str] = (),
) -> None:
    """Print a table on standard output; columns without any content are left out.

    Columns of `texts` are flush left, numbers flush right; long cells of `folding` columns may take
    several lines. Where the table is too wide, the columns `first_to_go` are left out in this order
    and named below it; before that, folding columns shrink to `_LEAST_WIDTH` characters.
    """
    output = screen()
    by_column = zip(*rows, strict=True)  # none where there are no rows
    columns = {name: each for name, each in zip(head, by_column, strict=False) if any(each)}
    left_out: list[str] = []

    def drawn(folding: Collection[str]) -> Table:
        table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
        for name in columns:
            side: Any = "left" if name in texts else "right"
            table.add_column(name, justify=side, no_wrap=name not in folding, overflow="fold")
        for cells in zip(*columns.values(), strict=True):
            table.add_row(*(Text(printable(cell)) for cell in cells))
        return table

    def is_too_wide() -> bool:
        unlimited = output.options.update(width=1_000_000)
        full = output.measure(drawn(folding), options=unlimited).maximum
        longest = (max(map(len, columns[name])) for name in folding if name in columns)
        return full - sum(max(0, length - _LEAST_WIDTH) for length in longest) > output.width

    for name in first_to_go:
        if not is_too_wide():
            break
        if columns.pop(name, None):
            left_out.append(" ".join(name.split()))
    if title:
        output.print(Text(printable(title), style="italic"), soft_wrap=True)
    output.print(drawn(columns if is_too_wide() else folding))
    if left_out:
        names = ", ".join(left_out)
        output.print(Text(f"Not shown, the screen is too narrow: {names}.", style="dim"))


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


class Bars(Progress, progress.Progress):
    """A bar for each stage, with the time it took or will take, while the context lasts.

    The last one is filled only if the context ends without an error.
    """

    def __init__(self, console: Console) -> None:
        super().__init__(
            progress.TextColumn("{task.description}", markup=False),
            progress.BarColumn(),
            progress.TextColumn("{task.fields[count]}"),
            progress.TimeRemainingColumn(compact=True, elapsed_when_finished=True),
            console=console,
        )
        self._bar: progress.TaskID | None = None

    def stage(self, activity: str) -> None:
        """Fill the bar of the stage before and begin a new one."""
        self._fill()
        self._bar = self.add_task(printable(activity), total=None, count="")

    def step(self, done: int, total: int) -> None:
        """Move the bar."""
        if self._bar is not None:
            self.update(self._bar, completed=done, total=total, count=f"{done}/{total}")

    def line(self, text: str) -> None:
        """Print a text above the bars."""
        self.console.print(Text(printable(text)))

    def __exit__(self, *error: Any) -> None:
        if error == (None, None, None):
            self._fill()
        super().__exit__(*error)

    def _fill(self) -> None:
        if self._bar is not None:
            total = self.tasks[self._bar].total or 1
            self.update(self._bar, completed=total, total=total)


@contextmanager
def shown(*, quiet: bool) -> Iterator[Progress]:
    """Progress on standard error: bars on a terminal, lines elsewhere, nothing if `quiet`."""
    if quiet:
        show_logs(logging.ERROR)
        yield Progress()
    elif sys.stderr.isatty():
        with Bars(Console(stderr=True)) as bars:
            yield bars
    else:
        yield Lines()


def duration(seconds: float) -> str:
    """A rounded time: "40 s", "12 min", "3 h 20 min"."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
