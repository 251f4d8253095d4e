"""What a simulation shows: tables and pictures in files, JSON, or a table on the screen."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model import Bifurcation, ForcedRing, HubResponse
from pipelines.cli import terminal
from pipelines.cli.terminal import Column, print_table
from pipelines.plots import forced as figures_forced
from pipelines.plots import waves as figures_waves
from pipelines.plots.style import Margins, figure_bytes, styled_figure
from pipelines.simulate.responses import (
    PER_LINE_FORCE,
    CleatResponse,
    LoadedSweep,
    SimulatedInertance,
)
from pipelines.simulate.tyre import (
    SimulatedTyre,
    free_frequencies,
    frequency_columns,
    frequency_lists,
    hub_columns,
    instabilities,
    largest_at_hub,
    tyre_to_simulate,
)
from pipelines.storage.atomic import file_written_whole
from pipelines.storage.tables import write_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FEW_LINES = 20  # so many are printed, of more only the peaks


@dataclass(frozen=True)
class Targets:
    """Where a result goes.

    Parameters
    ----------
    table, figure : Path or None
        Files to write.
    as_json : bool
        Whether the result is printed for machines.
    """

    table: Path | None
    figure: Path | None
    as_json: bool

    @property
    def screen(self) -> bool:
        """Whether people read it from the screen."""
        return not self.as_json and self.table is None


def announced(path: Path | None, *, accept_changes: bool = False) -> SimulatedTyre:
    """The tyre to simulate; standard error says so where none was given."""
    tyre = tyre_to_simulate(path, accept_changes=accept_changes)
    if path is None:
        _say(f"No --tyre given: the parameters are those of {tyre.name}.")
    return tyre


def frequencies(found: Bifurcation, frame: str, targets: Targets) -> None:
    """Show natural frequencies over speed."""
    for sentence in instabilities(found):
        _say(sentence)
    columns = frequency_columns(found)
    _write_table(targets, columns)
    if targets.as_json:
        print_json(frequency_lists(found))
    if targets.screen:
        shown = {name: columns[name] for name in list(columns)[:4]}
        places = {"speed_rad_s": 2, "regressive_hz": 3, "progressive_hz": 3}
        print_rows(f"Frequencies, {frame} frame", shown, places)
    if targets.figure is not None:
        several = found.speed_rad_s.size > 1
        plot = figures_waves.plot_bifurcation if several else figures_waves.plot_wave_frequencies
        with styled_figure(14, 10, margins=Margins(right=1.3)) as (figure, ax):
            plot(found, ax)
        _write_picture(targets, figure)


def inertance(found: SimulatedInertance, tyre: SimulatedTyre, targets: Targets) -> None:
    """Show an inertance; its peaks where nothing else was asked for."""
    note = f"Inertance in {found.unit}"
    if found.unit == PER_LINE_FORCE:
        note += f", per unit of belt width: {tyre.name} has no belt width"
        _say(f"{note}.")
    _write_table(targets, found.columns, note)
    if targets.as_json:
        print_json({"unit": found.unit, **found.columns})
    if targets.screen:
        places = {"frequency_hz": 2, "real": 5, "imag": 5, "magnitude": 5, "phase_deg": 2}
        if found.frequency_hz.size <= FEW_LINES:
            print_rows(f"Inertance, {found.unit}", found.columns, places)
        else:
            peaks = dict(zip(("frequency_hz", "magnitude"), found.peaks, strict=True))
            print_rows(f"Peaks of the inertance, {found.unit}", peaks, places)
    if targets.figure is not None:
        with styled_figure(15, 11, 2, sharex=True, height_ratios=(3, 2)) as (figure, (top, below)):
            figures_forced.plot_inertances({"inertance": found}, top)
            top.set_xlabel("")
            figures_forced.plot_phase(found, below)
        _write_picture(targets, figure)


def cleat(found: CleatResponse, targets: Targets, spectrum: Path | None) -> None:
    """Show the response to a blow; its extremes where nothing else was asked for."""
    _write_table(targets, found.columns, f"{found.observer.quantity} in {found.observer.unit}")
    if spectrum is not None:
        write_columns(spectrum, found.spectrum_columns, f"spectrum in {found.observer.unit}·s")
        _name(targets, "Spectrum", spectrum)
    if targets.as_json:
        print_json(
            {
                "unit": found.observer.unit,
                **found.columns,
                **{f"spectrum_{name}": values for name, values in found.spectrum_columns.items()},
            }
        )
    if targets.screen:
        ends = np.array([np.argmin(found.response), np.argmax(found.response)])
        rows = {"time_s": found.time_s[ends], found.observer.quantity: found.response[ends]}
        title = f"Extremes of the {found.observer.quantity}, {found.observer.unit}"
        print_rows(title, rows, {"time_s": 4, found.observer.quantity: 6})
    if targets.figure is not None:
        room = Margins(between_rows=1.4)
        with styled_figure(15, 12, 2, margins=room) as (figure, (top, below)):
            figures_forced.plot_cleat_response(found, top)
            figures_forced.plot_cleat_spectrum(found, below)
        _write_picture(targets, figure)


def loaded(found: LoadedSweep, targets: Targets) -> None:
    """Show frequencies over load."""
    largest = found.load_n.max()
    _write_table(targets, found.columns)
    if targets.as_json:
        print_json(
            {
                "load_n": found.load_n,
                "frequency_hz": found.frequency_hz,
                "dominant_order": found.dominant_order,
                "contact_deflection_m": found.contact_deflection_m,
            }
        )
    else:
        deflection_mm = 1e3 * found.contact_deflection_m
        terminal.say(f"Deflection in the contact at {largest:g} N: {deflection_mm:.2f} mm")
    if targets.screen:
        print_rows("Frequencies over load", found.columns, {"frequency_hz": 3})
    if targets.figure is not None:
        room = Margins(right=2.2, between_rows=1.9)
        with styled_figure(15, 14, 2, margins=room) as (figure, (top, below)):
            figures_forced.plot_loaded_frequencies(found, top)
            figures_forced.plot_deflection(found, below)
        _write_picture(targets, figure)


def hub(found: HubResponse, forced: ForcedRing, targets: Targets) -> None:
    """Show what reaches the hub; frequencies of the free wheel where nothing else was asked for."""
    wheel = forced.wheel
    columns = hub_columns(found, free=wheel is not None)
    _write_table(targets, columns)
    if targets.as_json:
        print_json(columns)
    if targets.screen:
        places = {"largest": 4, "frequency_hz": 3}
        print_rows("Largest at the hub per N on the belt", largest_at_hub(found), places)
        if wheel is not None:
            roots = free_frequencies(forced.ring, wheel, forced.speed_rad_s)
            print_rows("Undamped, with the free wheel, seen from the tyre", roots, places)
    if targets.figure is not None:
        with styled_figure(15, 9) as (figure, ax):
            figures_forced.plot_transmissibility(found, ax)
        _write_picture(targets, figure)


def _write_table(targets: Targets, columns: Columns, note: str = "") -> None:
    if targets.table is not None:
        write_columns(targets.table, columns, note)
        _name(targets, "Table", targets.table)


def _write_picture(targets: Targets, figure: Figure) -> None:
    if targets.figure is not None:
        write_figure(targets.figure, figure)
        _name(targets, "Figure", targets.figure)


def _name(targets: Targets, what: str, path: Path) -> None:
    """Say where a file is: on standard error where a program reads the other."""
    tell = terminal.complain if targets.as_json else terminal.say
    tell(f"{what}: {path}")


def _say(sentence: str) -> None:
    terminal.complain(sentence)


Columns = Mapping[str, NDArray[Any]]


def write_columns(path: Path, columns: Columns, note: str = "") -> None:
    """Write a table as CSV or Parquet, by the ending of `path`; written atomically.

    Parameters
    ----------
    path : Path
    columns : mapping of str to ndarray
        Columns of equal length.
    note : str
        What a reader must know; a Parquet file carries it as its metadata.
    """
    import pandas as pd  # half a second that only a file costs

    table = pd.DataFrame({name: np.asarray(values) for name, values in columns.items()})
    write_table(path, table, {"note": note} if note else None)


def write_figure(path: Path, figure: Figure) -> None:
    """Write a figure as PNG or SVG, by the ending of `path`; whole or not at all."""
    content = figure_bytes(figure, path.suffix.lower().lstrip("."))
    with file_written_whole(path) as partial:
        partial.write_bytes(content)


def print_json(content: Mapping[str, Any]) -> None:
    """Print arrays, numbers and texts as JSON; numbers that are none become null."""
    listed = {name: _listed(value) for name, value in content.items()}
    print(json.dumps(listed, allow_nan=False))  # noqa: T201


def print_rows(title: str, columns: Mapping[str, ArrayLike], places: Mapping[str, int]) -> None:
    """Print a table for people, each column with its number of digits after the point."""
    shown = [
        Column(name, [_cell(value, places.get(name, 0)) for value in np.asarray(values)])
        for name, values in columns.items()
    ]
    print_table(terminal.screen(), title, shown)


def _listed(value: Any) -> Any:
    if isinstance(value, str):
        return value
    array = np.asarray(value)
    plain = array.astype(object)
    plain[~np.isfinite(array)] = None
    return plain.tolist()


def _cell(value: Any, places: int) -> str:
    if isinstance(value, str):
        return value
    return f"{value:.{places}f}" if np.isfinite(value) else "–"
