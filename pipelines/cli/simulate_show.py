"""Output of the simulations: tables and figures in files, JSON, or a table on the screen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from ema.core.display import DASH
from model import Bifurcation, ForcedRing, HubResponse
from pipelines.cli.screen import print_table
from pipelines.cli.terminal import echo, echo_error, print_json
from pipelines.plots import simulated
from pipelines.plots.draw import draw_plot
from pipelines.plots.plot import Plot
from pipelines.plots.style import write_figure
from pipelines.simulate import responses
from pipelines.simulate import tyre as tyres
from pipelines.storage.tables import write_table

FEW_LINES = 20  # printed; of more only the peaks
Columns = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Request:
    """A tyre to simulate, files to write, and whether JSON is printed."""

    tyre: tyres.SimulatedTyre
    table: Path | None
    figure: Path | None
    as_json: bool

    @property
    def screen(self) -> bool:
        """Whether a table is printed."""
        return not self.as_json and self.table is None


def frequencies(found: Bifurcation, frame: str, request: Request) -> None:
    """Show natural frequencies over speed."""
    for sentence in tyres.instabilities(found):
        echo_error(sentence)
    columns = tyres.frequency_columns(found)
    _write(request, columns, tyres.frequency_lists(found))
    if request.screen:
        shown = {name: columns[name] for name in list(columns)[:4]}
        places = {"speed_rad_s": 2, "regressive_hz": 3, "progressive_hz": 3}
        _print_rows(f"Frequencies, {frame} frame", shown, places)
    _write_picture(request, simulated.frequencies_plot(found))


def inertance(found: responses.SimulatedInertance, request: Request) -> None:
    """Show an inertance; its peaks where there are many lines."""
    note = f"Inertance in {found.unit}"
    if found.unit == responses.PER_LINE_FORCE:
        note += f", per unit of belt width: {request.tyre.name} has no belt width"
        echo_error(f"{note}.")
    _write(request, found.columns, {"unit": found.unit, **found.columns}, note)
    if request.screen:
        places = {"frequency_hz": 2, "real": 5, "imag": 5, "magnitude": 5, "phase_deg": 2}
        if found.frequency_hz.size <= FEW_LINES:
            _print_rows(f"Inertance, {found.unit}", found.columns, places)
        else:
            peaks = dict(zip(("frequency_hz", "magnitude"), found.peaks, strict=True))
            _print_rows(f"Peaks of the inertance, {found.unit}", peaks, places)
    _write_picture(request, simulated.inertance_plot(found))


def cleat(found: responses.CleatResponse, request: Request, spectrum: Path | None) -> None:
    """Show the response to an impact, on the screen its extremes."""
    quantity, unit = found.observer.quantity, found.observer.unit
    spectra = {f"spectrum_{name}": each for name, each in found.spectrum_columns.items()}
    content = {"unit": unit, **found.columns, **spectra}
    _write(request, found.columns, content, f"{quantity} in {unit}")
    if spectrum is not None:
        write_columns(spectrum, found.spectrum_columns, f"spectrum in {unit}·s")
        _name(request, "Spectrum", spectrum)
    if request.screen:
        ends = np.array([np.argmin(found.response), np.argmax(found.response)])
        rows = {"time_s": found.time_s[ends], quantity: found.response[ends]}
        _print_rows(f"Extremes of the {quantity}, {unit}", rows, {"time_s": 4, quantity: 6})
    _write_picture(request, simulated.cleat_plot(found))


def loaded(found: responses.LoadedSweep, request: Request) -> None:
    """Show frequencies over load."""
    names = ("load_n", "frequency_hz", "dominant_order", "contact_deflection_m")
    static = {} if found.static is None else vars(found.static)
    _write(request, found.columns, {name: getattr(found, name) for name in names} | static)
    if not request.as_json:
        deflection_mm = 1e3 * found.contact_deflection_m
        echo(f"Deflection in the contact at {found.load_n.max():g} N: {deflection_mm:.2f} mm")
    if request.screen and found.static is not None:
        curve = {"load_n": found.load_n, "deflection_mm": 1e3 * found.static.deflection_m}
        curve |= {"patch_length_mm": 1e3 * found.static.patch_length_m}
        curve |= {"stiffness_n_mm": 1e-3 * found.static.stiffness_n_m}
        digits = {"deflection_mm": 2, "patch_length_mm": 1, "stiffness_n_mm": 1}
        _print_rows("Deflection over load", curve, digits)
    if request.screen:
        shown = {name: found.columns[name] for name in list(found.columns)[:4]}
        _print_rows("Frequencies over load", shown, {"frequency_hz": 3})
    _write_picture(request, simulated.loaded_plot(found))


def hub(found: HubResponse, forced: ForcedRing, request: Request) -> None:
    """Show forces and moment at the hub, and frequencies of a free wheel."""
    wheel = forced.wheel
    columns = tyres.hub_columns(found, free=wheel is not None)
    _write(request, columns, columns)
    if request.screen:
        places = {"largest": 4, "frequency_hz": 3}
        _print_rows("Largest at the hub per N on the belt", tyres.largest_at_hub(found), places)
        if wheel is not None:
            roots = tyres.free_frequencies(forced.ring, wheel, forced.speed_rad_s)
            _print_rows("Undamped, with the free wheel, seen from the tyre", roots, places)
    _write_picture(request, simulated.hub_plot(found))


def _write(request: Request, columns: Columns, content: Mapping[str, Any], note: str = "") -> None:
    if request.table is not None:
        write_columns(request.table, columns, note)
        _name(request, "Table", request.table)
    if request.as_json:
        print_arrays(content)


def _write_picture(request: Request, plot: Plot) -> None:
    if request.figure is not None:
        write_figure(request.figure, draw_plot(plot))
        _name(request, "Figure", request.figure)


def _name(request: Request, what: str, path: Path) -> None:
    """Name a file, on standard error where standard output is for a program."""
    (echo_error if request.as_json else echo)(f"{what}: {path}")


def write_columns(path: Path, columns: Columns, note: str = "") -> None:
    """Write columns as CSV, or as Parquet with a note, by the ending of `path`."""
    write_table(path, pd.DataFrame(dict(columns)), {"note": note} if note else None)


def print_arrays(content: Mapping[str, Any]) -> None:
    """Print arrays, numbers and texts as JSON; numbers that are not finite become null."""
    print_json({name: np.asarray(value).tolist() for name, value in content.items()})


def _print_rows(title: str, columns: Mapping[str, ArrayLike], places: Mapping[str, int]) -> None:
    """Print a table, each column with its number of digits after the decimal point."""
    cells = (
        [_cell(value, places.get(name, 0)) for value in np.asarray(values)]
        for name, values in columns.items()
    )
    print_table(title, tuple(columns), zip(*cells, strict=True))


def _cell(value: Any, places: int) -> str:
    if isinstance(value, str):
        return value
    return f"{value:.{places}f}" if np.isfinite(value) else DASH
