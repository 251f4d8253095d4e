"""The ring model: validation and parameters, and a series of them over inflation pressure."""

from __future__ import annotations

from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ema.core.display import DASH, number, signed, value_with_std
from model.identifiability import AT_BOUND, NOT_IDENTIFIED
from model.parameters import DAMPING_NAMES, RING_NAMES
from model.ring import natural_frequencies_hz
from model.tuning import TuningResult
from model.verdict import State
from pipelines.plots import ring as plots
from pipelines.plots.chart import Chart
from pipelines.plots.modes import matrix_chart
from pipelines.process.validate import ring_orders
from pipelines.report.page import Beside, Block, Paragraph, Picture, Section, Table, render_page
from pipelines.report.summary import listed, remaining_notes
from pipelines.results.options import UNITS_PA, Units, parameter_rows
from pipelines.results.result import Result, Validation
from pipelines.results.verdict import orders_in_doubt, ring_is_usable
from pipelines.storage.atomic import file_written_whole

if TYPE_CHECKING:  # a report shows none of these
    from pipelines.library.history import Series, Trend

HEAD = ("parameter", "symbol", "value", "unit", "how obtained")
WORDS = (0, 1, 3, 4)
HOW_OBTAINED = (
    "± is one standard deviation. Not identified: an error of half the value cannot be ruled out, "
    "or the measurement tells nothing of it. At bound: the search ended on a limit, the value is "
    "not an optimum. All stiffnesses, masses and damping values are per unit of belt width."
)
IN_DOUBT = (
    "The angles of the sensors are in doubt, and with them every order: the ring that follows from "
    "them is withheld."
)
TONES = {State.GOOD: "good", State.DOUBTFUL: "warning", State.BAD: "bad"}
ENDINGS = (".png", ".svg", ".html")
_EXPLANATION = (
    "Points are versions with their standard deviation, the line is fitted with weights 1/σ², the "
    "band is its ± σ. Scatter / σ above 1: the points deviate from the line by more than "
    "their σ; the line's ± is raised by it."
)


def validation(result: Result) -> Section:
    """The ring model compared with the measured modes."""
    title = "Ring model against measurement"
    if result.validation is None or result.tuning is None:
        return Section("validation", title, _left_out(result))
    if orders_in_doubt(result):
        return Section("validation", title, (Paragraph(IN_DOUBT, "bad"),))
    found = result.validation
    std_hz, damping_std = _measured_std(result, found.order)
    damped = np.isfinite(found.model_damping).any()
    damping = (plots.damping_chart(found, damping_std),) if damped else ()
    orders = np.arange(1, int(found.order.max()) + 3)
    ring_hz = natural_frequencies_hz(result.tuning.ring, orders)
    blocks: tuple[Block, ...] = (
        Beside((plots.scatter_chart(found, std_hz), _mac(found))),
        plots.dispersion_chart(found, orders, ring_hz, std_hz),
        Beside((plots.deviation_chart(found, std_hz), *damping)),
        _validation_table(found),
    )
    return Section("validation", title, blocks)


def parameters(result: Result, units: Units = Units.LAB) -> Section:
    """The parameters of the ring and how each was obtained."""
    title = "Ring parameters"
    tuning = result.tuning
    if tuning is None:
        return Section("parameters", title, _left_out(result))
    usable = ring_is_usable(result)
    rows = parameter_rows(tuning.ring, tuning, RING_NAMES, units)
    table = Table("Ring", HEAD, tuple(rows), WORDS)
    blocks: list[Block] = [
        _verdict(tuning) if usable or not orders_in_doubt(result) else Paragraph(IN_DOUBT, "bad"),
        table if usable else _withheld(table),
        *(_undetermined(tuning) if usable else ()),
        *listed(tuning.notes),
    ]
    if (damping := result.damping) is not None:
        rows = parameter_rows(damping.damping, damping, DAMPING_NAMES, units)
        table = Table("Damping", HEAD, tuple(rows), WORDS)
        blocks += [table if usable else _withheld(table), *listed(damping.notes)]
    blocks += [Paragraph(HOW_OBTAINED), _influence(tuning)]
    return Section("parameters", title, tuple(blocks))


def _left_out(result: Result) -> tuple[Block, ...]:
    text = "The ring steps were left out."
    return (Paragraph(text, "warning"), *listed(remaining_notes(result)))


def _measured_std(
    result: Result, orders: NDArray[np.int_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Standard deviations of measured frequencies and damping ratios; NaN where unknown."""
    measured = {each.order: each for each in ring_orders(result.modal_model)}
    known = [measured.get(int(order)) for order in orders]
    frequency_std_hz, damping_std = (
        np.array([getattr(each, name, np.nan) for each in known])
        for name in ("frequency_std_hz", "damping_std")
    )
    return frequency_std_hz, damping_std


def _mac(found: Validation) -> Chart:
    names = [str(order) for order in found.order]
    finding = f"the lowest value on the diagonal is {np.min(np.diag(found.mac)):.3f}."
    return matrix_chart(
        found.mac,
        names,
        names,
        name="mac",
        titles=("measured, order n", "ring model, order n"),
        alternative=f"MAC of measured and model shapes; {finding}",
        caption=f"MAC of measured against model shapes; {finding} Each model order is a plane of "
        "cos nθ and sin nθ; the comparison takes the direction in it that suits the measurement "
        "best.",
    )


def _validation_table(found: Validation) -> Table:
    columns = {
        "order n": map(str, found.order),
        "measured / Hz": [f"{value:.2f}" for value in found.measured_hz],
        "ring / Hz": [f"{value:.2f}" for value in found.model_hz],
        "deviation / %": [signed(value, 2) for value in found.error_percent],
        "measured damping / %": [number(100 * value, 3) for value in found.measured_damping],
        "ring damping / %": [number(100 * value, 3) for value in found.model_damping],
        "MAC": [f"{value:.3f}" for value in np.diag(found.mac)],
    }
    return Table.of_columns("Measured modes and the tuned ring", columns)


def _withheld(table: Table) -> Table:
    """A table of values that are not to be used, shown on demand."""
    return replace(table, caption=f"{table.caption}: values found, not to be used", folded=True)


def _verdict(tuning: TuningResult) -> Paragraph:
    """Whether a ring describes the tyre, and the pressure model of the parameters."""
    found = tuning.verdict
    orders = ", ".join(map(str, found.orders_used))
    fits = "The ring has the measured frequencies" if found.is_good else found.state.capitalize()
    says = "; ".join((fits, *(each.detail for each in found.evidence)))
    text = f"{says}. Orders used: {orders}. Pressure: {tuning.pressure_load} load."
    return Paragraph(text, TONES[found.state])


def _undetermined(tuning: TuningResult) -> tuple[Paragraph, ...]:
    """Parameters that the measurement does not determine, and the remedy."""
    missing = [RING_NAMES[name][0] for name, how in tuning.how.items() if how == NOT_IDENTIFIED]
    bound = [RING_NAMES[name][0] for name, how in tuning.how.items() if how == AT_BOUND]
    if not missing and not bound:
        return (Paragraph("Every parameter to be identified is identified.", "good"),)
    parts = (("Not identified", missing), ("At bound", bound))
    found = [f"{what}: {', '.join(names)}." for what, names in parts if names]
    advice = "Modes of higher order, or a value known from elsewhere (--given), would help."
    return (Paragraph(" ".join([*found, advice]), "warning"),)


def _influence(tuning: TuningResult) -> Beside:
    """Sensitivities, and correlations where they are known."""
    symbols = {name: symbol for name, (_, symbol, _) in RING_NAMES.items()}
    charts = [plots.sensitivity_chart(tuning.sensitivity, symbols)]
    found = tuning.correlation
    if len(found.parameters) >= 2 and np.isfinite(found.values).all():
        charts.append(plots.correlation_chart(found, symbols))
    return Beside(tuple(charts))


def write_series(path: Path, series: Series, unit: str) -> None:
    """Write a series as PNG, SVG or HTML, by the ending of `path`; written atomically."""
    # Load matplotlib (0.4 s), which the pages of a result do without.
    from pipelines.plots import draw

    figure = draw.draw_plot(plots.pressure_plot(series, unit))
    if path.suffix.lower() != ".html":
        draw.write_figure(path, figure)
        return
    page = _page(series, unit, draw.data_uri(draw.png(figure)))
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
