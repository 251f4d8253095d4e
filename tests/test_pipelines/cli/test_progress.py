"""Progress: bars on a terminal, lines elsewhere, nothing when quiet."""

import io
import re

import numpy as np
import pytest
from rich.console import Console

import ema
from pipelines.cli import screen as progress
from pipelines.cli.screen import Bars, Lines, duration, shown


@pytest.fixture
def clock(monkeypatch):
    """A clock that goes when told to."""
    now = [0.0]
    monkeypatch.setattr(progress, "monotonic", lambda: now[0])

    def pass_by(seconds):
        now[0] += seconds

    return pass_by


def drawn(work):
    """The last state of the bars after `work`, as text."""
    screen = io.StringIO()
    terminal = Console(file=screen, force_terminal=True, width=100, color_system=None)
    with Bars(terminal) as bars:
        work(bars)
    frames = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", screen.getvalue()).replace("\r", "\n")
    return [line.rstrip() for line in frames.splitlines() if line.strip()]


def test_lines_count_and_tell_the_time_left(clock, capsys):
    lines = Lines()
    lines.stage("Processing …")
    for done in (1, 2, 3):
        clock(100)
        lines.step(done, 3)
        lines.line(f"tyre_{done}")
    assert capsys.readouterr().err.splitlines() == [
        "Processing …",
        "[1/3, 3 min left] tyre_1",
        "[2/3, 2 min left] tyre_2",
        "[3/3] tyre_3",
    ]


def test_a_new_stage_has_no_count_yet(clock, capsys):
    lines = Lines()
    clock(1)
    lines.step(1, 6)
    lines.stage("Next …")
    lines.line("here")
    assert capsys.readouterr().err.splitlines() == ["Next …", "here"]


def test_names_from_files_cannot_control_the_terminal(capsys):
    Lines().line("tyre\x1b[2J\n2")
    assert capsys.readouterr().err == "tyre[U+001B][2J 2\n"
    assert any("tyre[U+001B][2J [red]2" in line for line in drawn(_tell("tyre\x1b[2J [red]2")))


def _tell(text):
    return lambda bars: bars.line(text)


def test_bars_show_every_stage_and_the_count_of_its_steps():
    def work(bars):
        bars.stage("Reading …")
        bars.stage("Estimating FRFs …")
        bars.step(6, 6)
        bars.stage("Identifying modes …")

    last = drawn(work)[-3:]
    assert last[0].startswith("Reading …")
    assert re.match(r"Estimating FRFs … +━+ 6/6", last[1])
    assert last[2].startswith("Identifying modes …")
    assert "/" not in last[0] + last[2]


def test_a_bar_is_not_filled_by_a_failure():
    def work(bars):
        bars.stage("Estimating FRFs …")
        bars.step(2, 6)
        raise RuntimeError

    screen = io.StringIO()
    with (
        pytest.raises(RuntimeError),
        Bars(Console(file=screen, force_terminal=True, width=100)) as bars,
    ):
        work(bars)
    assert "2/6" in screen.getvalue()
    assert screen.getvalue().endswith("\x1b[?25h")  # the cursor is back


def test_quiet_tells_nothing(capsys):
    with shown(quiet=True) as silent:
        silent.stage("Reading …")
        silent.step(1, 2)
        silent.line("tyre")
    assert capsys.readouterr().err == ""


def test_what_is_no_terminal_gets_lines():
    with shown(quiet=False) as lines:
        assert isinstance(lines, Lines)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0, "0 s"), (89.4, "89 s"), (90, "2 min"), (5300, "88 min"), (5400, "1 h 30 min")],
)
def test_durations_as_one_reads_them(seconds, text):
    assert duration(seconds) == text


def test_every_run_is_told_as_its_frfs_are_done(short_campaign):
    told = []
    campaign = ema.read_campaign(short_campaign)
    frf = ema.estimate_frf(campaign, progress=lambda *counts: told.append(counts))
    assert told == [(done, 6) for done in range(1, 7)]
    np.testing.assert_array_equal(frf.values, ema.estimate_frf(campaign).values)
