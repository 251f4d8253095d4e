"""A pressure series as a picture, or as a page with its numbers."""

from __future__ import annotations

from math import isfinite
from pathlib import Path

from pipelines.library.series import UNITS_PA, Series, Trend
from pipelines.plots.draw import draw_plot
from pipelines.plots.ring import pressure_plot
from pipelines.plots.style import data_uri, png, write_figure
from pipelines.report.blocks import Block, Paragraph, Picture, Section, Table
from pipelines.report.closing import listed
from pipelines.report.page import render_page
from pipelines.storage.atomic import file_written_whole
from pipelines.storage.rounding import DASH, number, value_with_std

ENDINGS = (".png", ".svg", ".html")
_EXPLANATION = (
    "Points are versions with their standard deviation, the line is fitted with weights 1/σ², the "
    "band is its ± σ. Scatter / σ above 1: the points deviate from the line by more than "
    "their σ; the line's ± is raised by it."
)


def write_series(path: Path, series: Series, unit: str) -> None:
    """Write a series as PNG, SVG or HTML, by the ending of `path`; written atomically."""
    figure = draw_plot(pressure_plot(series, unit))
    if path.suffix.lower() != ".html":
        write_figure(path, figure)
        return
    page = _page(series, unit, data_uri(png(figure)))
    with file_written_whole(path) as partial:
        partial.write_text(page, encoding="utf-8", newline="\n")


def trend_row(trend: Trend, unit: str) -> tuple[str, ...]:
    """Parameter, its value at the mean pressure, that pressure, slope, points and versions."""
    line, per_unit = trend.line, UNITS_PA[unit]
    return (
        trend.name,
        value_with_std(line.value, line.value_std),
        number(line.centre / per_unit, 4),
        value_with_std(line.slope * per_unit, line.slope_std * per_unit),
        f"{line.scatter:.2f}" if isfinite(line.scatter) else DASH,
        ", ".join(map(str, trend.version)),
    )


def headings(unit: str) -> tuple[str, ...]:
    """Headings over the cells of `trend_row`."""
    return (
        "parameter",
        "value (SI)",
        f"at / {unit}",
        f"slope per {unit}",
        "scatter / σ",
        "versions",
    )


def _page(series: Series, unit: str, picture: str) -> str:
    rows = tuple(trend_row(trend, unit) for trend in series.trends)
    about = f"Ring parameters of {series.tyre} over inflation pressure"
    blocks: tuple[Block, ...] = (
        Paragraph(_EXPLANATION),
        Picture(picture, about, "Parameters over inflation pressure", wide=True),
        Table("Values and slopes", headings(unit), rows, (0, 5)),
        *listed(series.notes),
    )
    sections = (Section("series", "Straight lines over pressure", blocks),)
    return render_page("Pressure series", series.tyre, sections)
