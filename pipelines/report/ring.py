"""Sections on the ring model: validation and parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from model.identifiability import GIVEN
from model.parameter_names import DAMPING_NAMES, RING_NAMES
from model.ring import natural_frequencies_hz
from model.tuning_result import TuningResult
from pipelines import figures
from pipelines.numbers import DASH, number, plain, signed, value_with_std
from pipelines.report.blocks import Beside, Block, Paragraph, Picture, Section, Table
from pipelines.report.notes import listed, remaining_notes
from pipelines.result import Result, Validation

HEAD = ("parameter", "symbol", "value", "unit", "how obtained")


def validation(result: Result) -> Section:
    """Compare the ring model with the measured modes."""
    title = "Ring model against measurement"
    if result.validation is None or result.tuning is None:
        return Section("validation", title, _left_out(result))
    found = result.validation
    pictures = (
        _scatter(found),
        _mac(found),
        _error(found),
        _dispersion(found, result.tuning),
        *_damping_picture(found),
    )
    return Section("validation", title, (Beside(pictures), _validation_table(found)))


def parameters(result: Result) -> Section:
    """List the parameters of the ring and how each was obtained."""
    title = "Ring parameters"
    tuning = result.tuning
    if tuning is None:
        return Section("parameters", title, _left_out(result))
    blocks: list[Block] = [
        _parameter_table("Ring", tuning.ring, tuning.std, tuning.how, RING_NAMES),
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
    blocks += [_sensitivity(tuning), *_correlation(tuning)]
    return Section("parameters", title, tuple(blocks))


def _left_out(result: Result) -> tuple[Block, ...]:
    text = "The ring steps were left out."
    return (Paragraph(text, "warning"), *listed(remaining_notes(result)))


def _scatter(found: Validation) -> Picture:
    with figures.styled_figure(10.5, 9.5) as (figure, ax):
        figures.plot_frequency_scatter(found, ax)
    return Picture(
        figures.png_uri(figure),
        "Frequencies of the ring model against measured ones, with the ±1 % band.",
        "Frequencies of the ring over measured ones, labelled by order. Points should lie in the "
        "band; the lowest order leaves it first where the foundation is not well determined.",
    )


def _error(found: Validation) -> Picture:
    worst = int(np.argmax(np.abs(found.error_percent)))
    largest = f"{signed(found.error_percent[worst], 2)} %"
    with figures.styled_figure(10.5, 7.5) as (figure, ax):
        figures.plot_frequency_error(found, ax)
    return Picture(
        figures.png_uri(figure),
        f"Deviation of the ring's frequencies by order; the largest is {largest}.",
        f"Deviation of the ring's frequencies with the ±1 % band; the largest is {largest} at "
        f"n = {found.order[worst]}. Deviations that alternate in sign are scatter, a "
        "trend over the order is the model.",
    )


def _mac(found: Validation) -> Picture:
    names = [str(order) for order in found.order]
    lowest = float(np.min(np.diag(found.mac)))
    with figures.styled_figure(10.5, 9.5) as (figure, ax):
        figures.plot_mac(found.mac, names, names, ax)
        ax.set_xlabel("ring model, order n")
        ax.set_ylabel("measured, order n")
    return Picture(
        figures.png_uri(figure),
        f"MAC of measured and model shapes; the lowest value on the diagonal is {lowest:.3f}.",
        f"MAC of measured against model shapes; the lowest value on the diagonal is {lowest:.3f}. "
        "Each model order is a plane of cos nθ and sin nθ; the comparison takes the direction in "
        "it that suits the measurement best.",
    )


def _dispersion(found: Validation, tuning: TuningResult) -> Picture:
    orders = np.arange(1, int(found.order.max()) + 3)
    with figures.styled_figure(10.5, 7.5) as (figure, ax):
        figures.plot_dispersion(found, orders, natural_frequencies_hz(tuning.ring, orders), ax)
    return Picture(
        figures.png_uri(figure),
        "Frequency over order: measured modes and the curve of the ring.",
        "Frequency over order. The measured modes should follow the curve; one that stands off is "
        "wrongly numbered or does not belong to the belt (cavity, wheel, rig).",
    )


def _damping_picture(found: Validation) -> tuple[Picture, ...]:
    if not np.isfinite(found.model_damping).any():
        return ()
    with figures.styled_figure(10.5, 7.5) as (figure, ax):
        figures.plot_damping(found, ax)
    return (
        Picture(
            figures.png_uri(figure),
            "Damping ratio over order, measured and of the ring.",
            "Damping ratio over order, measured and of the ring. Three parameters stand for all "
            "orders: one that stands off loses more or less energy than belt and sidewall explain.",
        ),
    )


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


def _sensitivity(tuning: TuningResult) -> Table:
    found = tuning.sensitivity
    head = ("order n", *(f"d ln f / d ln {RING_NAMES[name][1]}" for name in found.parameters))
    rows = tuple(
        (str(order), *(signed(value, 3) for value in row))
        for order, row in zip(found.orders, found.values, strict=True)
    )
    return Table("Sensitivity: change of the frequency in % for 1 % of the parameter", head, rows)


def _correlation(tuning: TuningResult) -> tuple[Table, ...]:
    found = tuning.correlation
    if len(found.parameters) < 2 or not np.isfinite(found.values).all():
        return ()
    symbols = [RING_NAMES[name][1] for name in found.parameters]
    rows = tuple(
        (symbol, *(signed(value, 2) for value in row))
        for symbol, row in zip(symbols, found.values, strict=True)
    )
    caption = "Correlation of the identified parameters"
    return (Table(caption, ("", *symbols), rows, words=(0,), folded=True),)
