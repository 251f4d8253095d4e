"""Table 3 and Fig. 3: modes identified from recordings."""

from __future__ import annotations

import numpy as np

from model.reference import TABLE_3_DAMPING_RATIOS, TABLE_3_FREQUENCIES_HZ, TABLE_3_ORDERS
from pipelines.paper.parts import (
    FORCE_DEG,
    MODES,
    RESPONSE_DEG,
    Chapter,
    Column,
    Drawing,
    NumberTable,
    Statement,
    drawing,
    places,
    verdict,
    with_sign,
)
from pipelines.plots import figures
from pipelines.process.validate import RingOrder, ring_orders
from pipelines.report.blocks import Paragraph
from pipelines.results.result import Result

ORIGIN = (
    "The recordings behind the paper are not published. In their place stands the sample "
    "campaign: simulated recordings of a tyre that has the frequencies and damping ratios of "
    "Table 3, with noise, processed like any other campaign. Table 3 and Fig. 3 therefore test the "
    "identification: it has to find again what is printed."
)


def identification(result: Result) -> Chapter:
    """Table 3 and Fig. 3 from a processed campaign."""
    found = orders_found(result)
    table = _table_3(found)
    return Chapter(
        "identification",
        "Identification: Table 3 and Fig. 3",
        (Paragraph(ORIGIN), table, _figure_3(result)),
        (_statement(table),),
    )


def orders_found(result: Result) -> tuple[RingOrder | None, ...]:
    """What was identified of each order of Table 3; None where an order was not found."""
    found = {order.order: order for order in ring_orders(result.modal_model)}
    return tuple(found.get(int(order)) for order in TABLE_3_ORDERS)


def response_row(result: Result) -> int:
    """Row of the FRFs at 100° from the force, node 20 of the paper."""
    force_deg = FORCE_DEG if result.excitation_deg is None else result.excitation_deg
    off = result.frf.position_deg - force_deg - (RESPONSE_DEG - FORCE_DEG)
    return int(np.argmin(np.abs(np.remainder(off + 180.0, 360.0) - 180.0)))


def _table_3(found: tuple[RingOrder | None, ...]) -> NumberTable:
    frequency, frequency_std, damping, damping_std = (
        [float("nan") if order is None else getattr(order, name) for order in found]
        for name in ("frequency_hz", "frequency_std_hz", "damping_ratio", "damping_std")
    )
    return NumberTable(
        "table_3",
        "Table 3: natural frequencies and damping ratios, printed and identified",
        (
            Column("mode n", "order", TABLE_3_ORDERS),
            Column("printed / Hz", "printed_hz", TABLE_3_FREQUENCIES_HZ, show=places(2)),
            Column("identified / Hz", "identified_hz", frequency, frequency_std),
            Column(
                "deviation / %",
                "deviation_percent",
                100.0 * (np.array(frequency) / TABLE_3_FREQUENCIES_HZ - 1.0),
                show=with_sign(3),
            ),
            Column("printed ζ", "printed_damping", TABLE_3_DAMPING_RATIOS, show=places(3)),
            Column("identified ζ", "identified_damping", damping, damping_std),
            Column(
                "deviation / %",
                "damping_deviation_percent",
                100.0 * (np.array(damping) / TABLE_3_DAMPING_RATIOS - 1.0),
                show=with_sign(2),
            ),
        ),
    )


def _statement(table: NumberTable) -> Statement:
    columns = {column.name: np.asarray(column.values) for column in table.columns}
    frequency = float(np.abs(columns["deviation_percent"]).max())
    damping = float(np.abs(columns["damping_deviation_percent"]).max())
    return Statement(
        "Table 3",
        MODES,
        f"All seven are found again: frequencies within {frequency:.2g} %, damping ratios within "
        f"{damping:.2g} %."
        if np.isfinite(frequency)
        else "Not all of the seven orders were identified.",
        verdict(bool(frequency < 1.0 and damping < 10.0), own_data=True),
    )


def _figure_3(result: Result) -> Drawing:
    row = response_row(result)
    frac = float(result.modal_model.frac[row])
    with figures.styled_figure(19, 12, 2, sharex=True, height_ratios=(3, 2)) as (
        figure,
        (magnitude, phase),
    ):
        figures.plot_frf_magnitude(result.frf, result.modal_model, row, magnitude)
        figures.plot_frf_phase(result.frf, result.modal_model, row, phase)
    return drawing(
        "figure_3",
        figure,
        f"Inertance at {result.frf.position_deg[row]:g}° from the force, measured and identified.",
        "Fig. 3: inertance between the radial force and the radial acceleration at 100°, measured "
        f"(dashed) and identified (solid); FRAC {frac:.4f}. The paper shows the same place.",
    )
