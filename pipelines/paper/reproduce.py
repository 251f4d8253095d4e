"""The paper reproduced: its tables and figures computed, beside what it prints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from model import (
    ForcedRing,
    RingParameters,
    Wheel,
    bifurcation,
    free_hub_roots,
    frequency_sensitivity,
    hub_response,
    natural_frequencies_hz,
    torsion_frequency_hz,
)
from model.coefficients import PressureLoad
from model.parameters import REFITTED_DAMPING, RING_NAMES, TABLE_3_ORDERS, TABLE_4_RING
from pipelines.paper.forced import forced_response
from pipelines.paper.parts import (
    HIGHEST_HZ,
    Chapter,
    Column,
    NumberTable,
    Statement,
    deviation,
    paper_page,
    statements_table,
    verdict,
)
from pipelines.paper.tables import damping, identification, tuning
from pipelines.paper.waves import waves
from pipelines.plots.chart import Chart
from pipelines.plots.draw import png
from pipelines.plots.ring import hub_plot, sensitivity_chart
from pipelines.process.run import process
from pipelines.report.page import Paragraph
from pipelines.results.result import Result
from pipelines.simulate.campaign import sample_campaign
from pipelines.storage.atomic import require_free, written_whole
from pipelines.storage.checksums import write_marker
from pipelines.storage.tables import write_csv

#: Radius 0.25 m, thickness 5 mm, E = 210 GPa, 7850 kg/m³, free, without pressure.
STEEL_RING = RingParameters(0.25, 7850 * 5e-3, 0.0, 0.0, 210e9 * 5e-3, 210e9 * 5e-3**3 / 12, 0.0)
STEEL = (
    "Section 4 tests the model on the steel ring of its reference [19] and prints no numbers. A "
    "free steel ring (radius 0.25 m, thickness 5 mm) with solutions in closed form takes its "
    "place: Hoppe's inextensional bending, breathing, the extensional wave, and Bryan's split of "
    "a ring that turns 10 times a second. The closed forms neglect the stretch of the middle line "
    "in bending, or bending in the stretch."
)
#: Those of the rim of a car; the paper prints none.
WHEEL = Wheel(mass_kg=12.0, inertia_kg_m2=0.6)
ON_WHEEL = (
    "Eqs 8 to 10 let the wheel move. The paper prints neither mass nor inertia: 12 kg and "
    "0.6 kg m² are assumed. Only orders 0 and 1 move the wheel. As printed (dead pressure, eq 10) "
    "a free wheel that turns together with its tyre is held by a stiffness that no tyre has; with "
    "a pressure that follows the belt it turns freely."
)
ON_SENSITIVITY = (
    "Section 4 mentions a sensitivity analysis and prints no numbers. These are the sensitivities "
    "of the ring of Table 4: k_θ shows in order 1 only, D in the highest orders, K in none. With "
    "all parameters scaled together no frequency changes."
)
PAGE = "paper.html"
FOLDER_MARKER = "paper.json"  # lists the files, by which an earlier reproduction is known


def model_checks() -> Chapter:
    """Steel ring, sensitivities and wheel, from the model alone."""
    steel = _steel_ring()
    symbols = {name: symbol for name, (_, symbol, _) in RING_NAMES.items()}
    sensitivity = frequency_sensitivity(TABLE_4_RING, TABLE_3_ORDERS)
    return Chapter(
        "checks",
        "Steel ring, sensitivity, wheel",
        (
            Paragraph(STEEL),
            steel,
            Paragraph(ON_SENSITIVITY),
            sensitivity_chart(sensitivity, symbols),
            Paragraph(ON_WHEEL),
            _wheel(),
            _figure_of_the_hub(),
        ),
        (_on_steel(steel),),
    )


def _steel_ring() -> NumberTable:
    ring, turns_hz = STEEL_RING, 10.0
    a, rho = ring.mean_radius_m, ring.mass_per_area_kg_m2
    stretch, bend = ring.axial_stiffness_n_m, ring.bending_stiffness_n_m
    bending, turning = np.arange(2, 6), np.arange(2, 5)
    waves = bifurcation(ring, turning, 2.0 * np.pi * turns_hz)
    hoppe = bend * bending**2 * (bending**2 - 1) ** 2 / (rho * a**4 * (bending**2 + 1))
    breathing, extensional = stretch / rho / a**2, 5.0 * stretch / rho / a**2
    squared = np.array([*hoppe, breathing, extensional])
    closed = [*np.sqrt(squared) / (2 * np.pi), *4 * turning / (turning**2 + 1) * turns_hz]
    found = [
        *natural_frequencies_hz(ring, bending),
        float(natural_frequencies_hz(ring, 0)),
        bifurcation(ring, 2, 0.0, extensional=True).regressive_hz.item(),
        *(waves.regressive_hz - waves.progressive_hz)[:, 0],
    ]
    what = [*["bending"] * 4, "breathing", "extensional", *["split at 10 Hz"] * 3]
    columns = (
        Column("what", "what", what),
        Column("order n", "order", [*bending, 0, 2, *turning]),
        Column("closed form / Hz", "closed_form_hz", closed, show=3),
        Column("eq 14 / Hz", "equation_14_hz", found, show=3),
        deviation("deviation_percent", found, closed, 3),
    )
    return NumberTable("steel_ring", "A free steel ring: eq 14 beside closed forms", columns)


def _on_steel(steel: NumberTable) -> Statement:
    apart = float(np.abs(np.asarray(steel.columns[-1].values)).max())
    return Statement(
        "Section 4",
        "on a steel ring the model agrees well with known frequencies",
        f"The ring of [19] is not printed; another one agrees with closed forms within {apart:.2f} "
        "%.",
        verdict(apart < 0.2),
    )


def _wheel() -> NumberTable:
    loads: tuple[PressureLoad, PressureLoad] = ("dead", "follower")
    rows = []
    for load in loads:
        fixed = (
            torsion_frequency_hz(TABLE_4_RING, pressure_load=load),
            float(natural_frequencies_hz(TABLE_4_RING, 1, pressure_load=load)),
        )
        for order in (0, 1):
            roots = free_hub_roots(TABLE_4_RING, WHEEL, order, pressure_load=load)
            rigid, elastic = np.sort(np.abs(roots))[[0, 2]] / (2.0 * np.pi)
            rows.append((load, order, fixed[order], elastic, 0.0 if rigid < 1e-3 else rigid))
    load_of, orders, fixed_hz, free_hz, rigid_hz = zip(*rows, strict=True)
    columns = (
        Column("pressure", "pressure_load", load_of),
        Column("order n", "order", orders),
        Column("fixed hub / Hz", "fixed_hz", fixed_hz, show=2),
        Column("free wheel / Hz", "free_hz", free_hz, show=2),
        Column("tyre and wheel together / Hz", "together_hz", rigid_hz, show=2),
    )
    return NumberTable("wheel", "Orders 0 and 1 with a fixed hub and with a free wheel", columns)


def _figure_of_the_hub() -> Chart:
    forced = ForcedRing(TABLE_4_RING, REFITTED_DAMPING, wheel=WHEEL)
    found = hub_response(forced, np.arange(1.0, HIGHEST_HZ, 0.5))
    plot = replace(hub_plot(found), size_cm=(19, 9))
    return Chart(
        "wheel",
        plot,
        "Forces on a free wheel per unit of radial force on the belt, over frequency.",
        "Force on the free wheel for a radial force of 1 N on the belt at θ = 0, damping refitted "
        "to Table 3. At low frequencies belt and wheel move as one body and the force is their "
        "share of mass; the peak is order 1.",
    )


def reproduce_paper(
    folder: Path, *, force: bool = False, progress: Callable[[str], None] | None = None
) -> tuple[Chapter, ...]:
    """Compute Tables 3 to 5 and Figs. 3 to 12, and write them.

    Parameters
    ----------
    folder : Path
        Gets ``paper.html``, a CSV file per table, a PNG file per figure and ``paper.json``, which
        lists them; written atomically.
    force : bool
        Replace an earlier reproduction.
    progress : callable, optional
        Called with the name of each stage as it starts.

    Raises
    ------
    InputError
        If the folder exists and may not be replaced, or cannot be written.
    """
    require_free(folder, force=force, marker=FOLDER_MARKER)
    with TemporaryDirectory() as scratch:
        result = process(sample_campaign(Path(scratch) / "campaign"), progress=progress)
    if progress is not None:
        progress("Computing the paper's tables and figures …")
    chapters = paper_chapters(result)
    write_paper(chapters, result, folder, force=force)
    return chapters


def paper_chapters(result: Result) -> tuple[Chapter, ...]:
    """All that is computed, from a campaign in place of the paper's recordings."""
    measured = identification(result), tuning(result)
    return (*measured, model_checks(), waves(), damping(), forced_response(result))


def write_paper(
    chapters: tuple[Chapter, ...], result: Result, folder: Path, *, force: bool = False
) -> None:
    """Write page, tables and figures; the folder is written atomically."""
    parts = [part for chapter in chapters for part in chapter.parts]
    pictures = {part.name: png(part.draw()) for part in parts if isinstance(part, Chart)}
    with written_whole(folder, force=force, marker=FOLDER_MARKER) as partial:
        for part in (*parts, statements_table(chapters)):
            if isinstance(part, NumberTable):
                write_csv(partial / f"{part.name}.csv", part.file_columns)
        for name, picture in pictures.items():
            (partial / f"{name}.png").write_bytes(picture)
        page = paper_page(chapters, result, pictures)
        (partial / PAGE).write_text(page, encoding="utf-8", newline="\n")
        about = {key: result.provenance[key] for key in ("software", "created")}
        write_marker(partial / FOLDER_MARKER, about)
