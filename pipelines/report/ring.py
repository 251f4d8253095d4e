"""Sections on the ring model: validation and parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.identifiability import AT_BOUND, GIVEN, NOT_IDENTIFIED
from model.parameters import DAMPING_NAMES, RING_NAMES
from model.ring import natural_frequencies_hz
from model.tuning import TuningResult
from pipelines.plots.chart import Chart
from pipelines.plots.modes import mac_chart
from pipelines.plots.ring import (
    correlation_chart,
    damping_chart,
    deviation_chart,
    dispersion_chart,
    scatter_chart,
    sensitivity_chart,
)
from pipelines.process.validate import ring_orders
from pipelines.report.blocks import Beside, Block, Paragraph, Section, Table
from pipelines.report.closing import listed, remaining_notes
from pipelines.results.result import Result, Validation
from pipelines.storage.rounding import DASH, number, plain, signed, value_with_std

HEAD = ("parameter", "symbol", "value", "unit", "how obtained")


def validation(result: Result) -> Section:
    """Compare the ring model with the measured modes."""
    title = "Ring model against measurement"
    if result.validation is None or result.tuning is None:
        return Section("validation", title, _left_out(result))
    found = result.validation
    std_hz, damping_std = _measured_std(result, found.order)
    blocks: tuple[Block, ...] = (
        Beside((scatter_chart(found, std_hz), _mac(found))),
        _dispersion(found, std_hz, result.tuning),
        Beside((deviation_chart(found, std_hz), *_damping(found, damping_std))),
        _validation_table(found),
    )
    return Section("validation", title, blocks)


def parameters(result: Result) -> Section:
    """List the parameters of the ring and how each was obtained."""
    title = "Ring parameters"
    tuning = result.tuning
    if tuning is None:
        return Section("parameters", title, _left_out(result))
    blocks: list[Block] = [
        _parameter_table("Ring", tuning.ring, tuning.std, tuning.how, RING_NAMES),
        *_undetermined(tuning),
        *listed(tuning.notes),
    ]
    if result.damping is not None:
        damping = result.damping
        blocks += [
            _parameter_table("Damping", damping.damping, damping.std, damping.how, DAMPING_NAMES),
            *listed(damping.notes),
        ]
    blocks.append(
        Paragraph(
            "± is one standard deviation. Not identified: the measured frequencies do not "
            "determine the parameter, its value is an assumption. At bound: the search ended on a "
            "limit, the value is not an optimum. All stiffnesses, masses and damping values are "
            "per unit of belt width."
        )
    )
    blocks.append(_influence(tuning))
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
    return (
        np.array([np.nan if each is None else each.frequency_std_hz for each in known]),
        np.array([np.nan if each is None else each.damping_std for each in known]),
    )


def _mac(found: Validation) -> Chart:
    names = [str(order) for order in found.order]
    lowest = float(np.min(np.diag(found.mac)))
    return mac_chart(
        found.mac,
        names,
        names,
        name="mac",
        titles=("measured, order n", "ring model, order n"),
        alternative="MAC of measured and model shapes; the lowest value on the diagonal is "
        f"{lowest:.3f}.",
        caption=f"MAC of measured against model shapes; the lowest value on the diagonal is "
        f"{lowest:.3f}. Each model order is a plane of cos nθ and sin nθ; the comparison takes the "
        "direction in it that suits the measurement best.",
    )


def _dispersion(found: Validation, std_hz: NDArray[np.float64], tuning: TuningResult) -> Chart:
    orders = np.arange(1, int(found.order.max()) + 3)
    ring_hz = natural_frequencies_hz(tuning.ring, orders)
    return dispersion_chart(found, orders, ring_hz, std_hz)


def _damping(found: Validation, std: NDArray[np.float64]) -> tuple[Chart, ...]:
    if not np.isfinite(found.model_damping).any():
        return ()
    return (damping_chart(found, std),)


def _validation_table(found: Validation) -> Table:
    head = (
        "order n",
        "measured / Hz",
        "ring / Hz",
        "deviation / %",
        "measured damping / %",
        "ring damping / %",
        "MAC",
    )
    rows = tuple(
        (
            str(order),
            f"{measured:.2f}",
            f"{ring:.2f}",
            signed(error, 2),
            number(100 * measured_damping, 3),
            number(100 * ring_damping, 3),
            f"{mac:.3f}",
        )
        for order, measured, ring, error, measured_damping, ring_damping, mac in zip(
            found.order,
            found.measured_hz,
            found.model_hz,
            found.error_percent,
            found.measured_damping,
            found.model_damping,
            np.diag(found.mac),
            strict=True,
        )
    )
    return Table("Measured modes and the tuned ring", head, rows)


def _parameter_table(
    caption: str,
    values: Any,
    std: Mapping[str, float],
    how: Mapping[str, str],
    names: Mapping[str, tuple[str, str, str]],
) -> Table:
    rows = tuple(
        (
            title,
            symbol,
            _value(getattr(values, name), std.get(name), how.get(name, "")),
            unit,
            how.get(name, DASH),
        )
        for name, (title, symbol, unit) in names.items()
        if getattr(values, name) is not None
    )
    return Table(caption, HEAD, rows, words=(0, 1, 3, 4))


def _value(value: float, std: float | None, how: str) -> str:
    return plain(value) if how == GIVEN else value_with_std(value, std)


def _undetermined(tuning: TuningResult) -> tuple[Paragraph, ...]:
    """Name what the measurement did not give, and what to do about it."""
    missing = [RING_NAMES[name][0] for name, how in tuning.how.items() if how == NOT_IDENTIFIED]
    bound = [RING_NAMES[name][0] for name, how in tuning.how.items() if how == AT_BOUND]
    if not missing and not bound:
        return (Paragraph("Every parameter that was sought is identified.", "good"),)
    said = [f"Not identified: {', '.join(missing)}."] if missing else []
    said += [f"At bound: {', '.join(bound)}."] if bound else []
    advice = "Modes of higher order, or a value known from elsewhere (--given), would help."
    return (Paragraph(" ".join([*said, advice]), "warning"),)


def _influence(tuning: TuningResult) -> Beside:
    """Sensitivities, and correlations where they are known."""
    symbols = {name: symbol for name, (_, symbol, _) in RING_NAMES.items()}
    charts = [sensitivity_chart(tuning.sensitivity, symbols)]
    found = tuning.correlation
    if len(found.parameters) >= 2 and np.isfinite(found.values).all():
        charts.append(correlation_chart(found, symbols))
    return Beside(tuple(charts))
