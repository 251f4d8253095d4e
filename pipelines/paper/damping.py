"""Table 5: the damping parameters, against the damping ratios of Table 3."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model import DampingResult, damping_ratios, identify_damping
from model.parameters import DAMPING_NAMES
from model.reference import TABLE_3_DAMPING_RATIOS, TABLE_3_ORDERS, TABLE_4_RING, TABLE_5_DAMPING
from pipelines.paper import parts as paper_printed
from pipelines.paper.parts import (
    Chapter,
    Column,
    NumberTable,
    Statement,
    places,
    verdict,
    with_sign,
    with_unit,
)
from pipelines.report.blocks import Paragraph
from pipelines.storage.rounding import plain

TABLE_5_NAMES = ("circumferential_n_s_m3", "radial_n_s_m3", "loss_factor")
STARRED = "* The loss factor does not act on the stiffness from hoop tension."


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
                paper_printed.DAMPING,
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
            Column(
                "deviation / %",
                "deviation_percent",
                100.0 * (fits[0] / printed - 1.0),
                show=with_sign(0),
            ),
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
    show = places(4)
    return NumberTable(
        "table_5_ratios",
        "Damping ratios: of Table 3, and of the ring with each set of parameters",
        (
            Column("mode n", "order", TABLE_3_ORDERS),
            Column("Table 3", "printed", TABLE_3_DAMPING_RATIOS, show=places(3)),
            Column("Table 5", "table_5", printed, show=show),
            Column("Table 5 over Table 3", "table_5_over_table_3", times, show=places(2)),
            Column("refitted", "refitted", fitted, show=show),
            Column("Table 5*", "table_5_no_pretension", starred, show=show),
            Column("refitted*", "refitted_no_pretension", fitted_starred, show=show),
        ),
    )
