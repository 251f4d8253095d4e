"""Tables 3 and 5, Fig. 3: modes identified from recordings, and the damping parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model import DampingResult, damping_ratios, identify_damping
from model.parameters import DAMPING_NAMES
from model.reference import (
    TABLE_3_DAMPING_RATIOS,
    TABLE_3_FREQUENCIES_HZ,
    TABLE_3_ORDERS,
    TABLE_4_RING,
    TABLE_5_DAMPING,
)
from pipelines.paper.parts import (
    FORCE_DEG,
    RESPONSE_DEG,
    Chapter,
    Column,
    NumberTable,
    Statement,
    deviation,
    verdict,
    with_unit,
)
from pipelines.plots.chart import Chart
from pipelines.plots.modes import fitted_curves, frf_plot
from pipelines.process.validate import ring_orders
from pipelines.report.blocks import Paragraph
from pipelines.results.labels import place_name
from pipelines.results.result import Result
from pipelines.storage.rounding import plain

ORIGIN = (
    "The recordings behind the paper are not published. They are replaced by the sample "
    "campaign: simulated recordings of a tyre that has the frequencies and damping ratios of "
    "Table 3, with noise, processed like any other campaign. Table 3 and Fig. 3 therefore test the "
    "identification: it has to reproduce what is printed."
)

TABLE_5_NAMES = ("circumferential_n_s_m3", "radial_n_s_m3", "loss_factor")
STARRED = "* The loss factor does not act on the stiffness from hoop tension."


def identification(result: Result) -> Chapter:
    """Table 3 and Fig. 3 from a processed campaign."""
    table = _table_3(result)
    return Chapter(
        "identification",
        "Identification: Table 3 and Fig. 3",
        (Paragraph(ORIGIN), table, _figure_3(result)),
        (_statement(table),),
    )


def response_row(result: Result) -> int:
    """Row of the FRFs at 100° from the force, node 20 of the paper."""
    force_deg = FORCE_DEG if result.excitation_deg is None else result.excitation_deg
    off = result.frf.position_deg - force_deg - (RESPONSE_DEG - FORCE_DEG)
    return int(np.argmin(np.abs(np.remainder(off + 180.0, 360.0) - 180.0)))


def _table_3(result: Result) -> NumberTable:
    known = {order.order: order for order in ring_orders(result.modal_model)}
    found = [known.get(int(order)) for order in TABLE_3_ORDERS]
    frequency, frequency_std, damping, damping_std = (
        [getattr(order, name, float("nan")) for order in found]
        for name in ("frequency_hz", "frequency_std_hz", "damping_ratio", "damping_std")
    )
    columns = (
        Column("mode n", "order", TABLE_3_ORDERS),
        Column("printed / Hz", "printed_hz", TABLE_3_FREQUENCIES_HZ, show=2),
        Column("identified / Hz", "identified_hz", frequency, frequency_std),
        deviation("deviation_percent", np.array(frequency), TABLE_3_FREQUENCIES_HZ, 3),
        Column("printed ζ", "printed_damping", TABLE_3_DAMPING_RATIOS, show=3),
        Column("identified ζ", "identified_damping", damping, damping_std),
        deviation("damping_deviation_percent", np.array(damping), TABLE_3_DAMPING_RATIOS, 2),
    )
    caption = "Table 3: natural frequencies and damping ratios, printed and identified"
    return NumberTable("table_3", caption, columns)


def _statement(table: NumberTable) -> Statement:
    columns = {column.name: np.asarray(column.values) for column in table.columns}
    frequency = float(np.abs(columns["deviation_percent"]).max())
    damping = float(np.abs(columns["damping_deviation_percent"]).max())
    return Statement(
        "Table 3",
        "seven modes between 78.73 and 224.40 Hz with damping ratios from 0.039 to 0.018",
        f"All seven are found again: frequencies within {frequency:.2g} %, damping ratios within "
        f"{damping:.2g} %."
        if np.isfinite(frequency)
        else "Not all of the seven orders were identified.",
        verdict(bool(frequency < 1.0 and damping < 10.0), own_data=True),
    )


def _figure_3(result: Result) -> Chart:
    frf, model, row = result.frf, result.modal_model, response_row(result)
    place = place_name(int(frf.node[row]), float(frf.position_deg[row]))
    plot = frf_plot(frf, model, fitted_curves(frf, model, row), place)
    return Chart(
        "figure_3",
        replace(plot, size_cm=(19, 12)),
        f"Inertance at {frf.position_deg[row]:g}° from the force, measured and identified.",
        "Fig. 3: inertance between the radial force and the radial acceleration at 100°, measured "
        f"(thin) and identified (thick); FRAC {model.frac[row]:.4f}. The paper shows the same "
        "place.",
    )


def refitted(*, on_pretension: bool = True) -> DampingResult:
    """Damping parameters identified from the ratios of Table 3 on the ring of Table 4."""
    return identify_damping(
        TABLE_4_RING, TABLE_3_ORDERS, TABLE_3_DAMPING_RATIOS, on_pretension=on_pretension
    )


def damping() -> Chapter:
    """Table 5, and the damping ratios that follow from it."""
    table, starred = (_times_table_3(on_pretension=choice) for choice in (True, False))
    found = f"damping ratios {table[0]:.1f} to {table[1]:.1f} times those of Table 3"
    return Chapter(
        "damping",
        "Damping: Table 5",
        (
            _table_5(),
            _table_of_ratios(),
            Paragraph(STARRED),
            Paragraph(
                f"Table 5 gives {found} ({starred[0]:.1f} to {starred[1]:.1f} times where the loss "
                "factor spares the pretension): both tables cannot describe one tyre. Where "
                "damping matters below, both are shown: Table 5 as printed, and the parameters "
                "refitted to Table 3.",
                "warning",
            ),
        ),
        (
            Statement(
                "Section 5.3, Table 5",
                "the damping is estimated from the modal analysis",
                f"It gives {found}, which came from the modal analysis.",
                verdict(table[0] > 0.9 and table[1] < 1.1),
            ),
        ),
    )


def _times_table_3(*, on_pretension: bool) -> tuple[float, float]:
    """Smallest and largest ratio of the ring's damping with Table 5 to that of Table 3."""
    parameters = replace(TABLE_5_DAMPING, on_pretension=on_pretension)
    times = damping_ratios(TABLE_4_RING, parameters, TABLE_3_ORDERS) / TABLE_3_DAMPING_RATIOS
    return float(times.min()), float(times.max())


def _table_5() -> NumberTable:
    printed = np.array([getattr(TABLE_5_DAMPING, name) for name in TABLE_5_NAMES])
    both = [refitted(), refitted(on_pretension=False)]
    fits = [[getattr(found.damping, name) for name in TABLE_5_NAMES] for found in both]
    stds = [[found.std.get(name, float("nan")) for name in TABLE_5_NAMES] for found in both]
    return NumberTable(
        "table_5",
        "Table 5: damping parameters printed, and refitted to the damping ratios of Table 3",
        (
            Column("parameter", "parameter", [with_unit(DAMPING_NAMES[n]) for n in TABLE_5_NAMES]),
            Column("printed", "printed", printed, show=plain),
            Column("refitted", "refitted", fits[0], stds[0]),
            deviation("deviation_percent", fits[0], printed, 0),
            Column("refitted*", "refitted_no_pretension", fits[1], stds[1]),
        ),
    )


def _table_of_ratios() -> NumberTable:
    printed, starred = (
        damping_ratios(TABLE_4_RING, replace(TABLE_5_DAMPING, on_pretension=on), TABLE_3_ORDERS)
        for on in (True, False)
    )
    fitted, fitted_starred = (refitted(on_pretension=on).model for on in (True, False))
    times = printed / TABLE_3_DAMPING_RATIOS
    columns = (
        Column("mode n", "order", TABLE_3_ORDERS),
        Column("Table 3", "printed", TABLE_3_DAMPING_RATIOS, show=3),
        Column("Table 5", "table_5", printed, show=4),
        Column("Table 5 over Table 3", "table_5_over_table_3", times, show=2),
        Column("refitted", "refitted", fitted, show=4),
        Column("Table 5*", "table_5_no_pretension", starred, show=4),
        Column("refitted*", "refitted_no_pretension", fitted_starred, show=4),
    )
    caption = "Damping ratios: of Table 3, and of the ring with each set of parameters"
    return NumberTable("table_5_ratios", caption, columns)
