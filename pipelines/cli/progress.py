"""How far a command is: bars with the time left on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING, Any, Protocol

from pipelines.cli.terminal import printable

if TYPE_CHECKING:
    from rich.progress import TaskID


class Progress(Protocol):
    """What a command tells while it works."""

    def stage(self, activity: str) -> None:
        """Tell that a stage starts, and thereby that the one before has ended."""

    def step(self, done: int, total: int) -> None:
        """Tell how many equal parts of the stage are done."""

    def line(self, text: str) -> None:
        """Tell something in a line of its own."""


class Silent:
    """No progress at all."""

    def stage(self, activity: str) -> None:
        """Nothing."""

    def step(self, done: int, total: int) -> None:
        """Nothing."""

    def line(self, text: str) -> None:
        """Nothing."""


class Lines:
    """A line for each stage, and lines with the count and the time left where there are any."""

    def __init__(self) -> None:
        self._start_s = monotonic()
        self._count = ""

    def stage(self, activity: str) -> None:
        """Print the activity."""
        self._start_s, self._count = monotonic(), ""
        self._print(activity)

    def step(self, done: int, total: int) -> None:
        """Keep the count for the next line."""
        left_s = (monotonic() - self._start_s) / done * (total - done)
        left = f", {duration(left_s)} left" if done < total else ""
        self._count = f"[{done}/{total}{left}] "

    def line(self, text: str) -> None:
        """Print a text behind the count."""
        self._print(self._count + text)

    def _print(self, text: str) -> None:
        print(printable(text), file=sys.stderr, flush=True)  # noqa: T201


class Bars:
    """A bar for each stage, with the time it took or will take.

    Parameters
    ----------
    display : rich.progress.Progress
    """

    def __init__(self, display: Any) -> None:
        self._display = display
        self._bar: TaskID | None = None

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
        # Not for the help, which has to be there at once.
        from rich.text import Text

        self._display.console.print(Text(printable(text)))

    def end(self) -> None:
        """Fill the last bar."""
        if self._bar is not None:
            total = self._display.tasks[self._bar].total or 1
            self._display.update(self._bar, completed=total, total=total)


@contextmanager
def shown(*, quiet: bool) -> Iterator[Progress]:
    """Progress on standard error, as suits it: bars on a terminal, lines elsewhere.

    Parameters
    ----------
    quiet : bool
        Nothing at all.
    """
    if quiet:
        yield Silent()
    elif sys.stderr.isatty():
        # Not for the help, which has to be there at once.
        from rich.console import Console

        with bars_on(Console(stderr=True)) as bars:
            yield bars
    else:
        yield Lines()


@contextmanager
def bars_on(console: Any) -> Iterator[Bars]:
    """Bars on a terminal; the last one is full only if the block ends well."""
    # Not for the help, which has to be there at once.
    from rich import progress

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
    """A time as one reads it: "40 s", "12 min", "3 h 20 min"."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
