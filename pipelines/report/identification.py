"""Sections on what was identified: poles, modes and shapes."""

from __future__ import annotations

from typing import Any

import numpy as np

from ema.core.display import DASH, counted, number, value_with_std
from ema.core.mac import auto_mac
from ema.core.modes import ModalModel, Mode
from ema.poles.stability import METHOD_NAMES
from pipelines.plots.chart import Chart, packed
from pipelines.plots.modes import (
    drive_chart,
    forces,
    matrix_chart,
    mif_chart,
    shapes_plot,
    stability_chart,
)
from pipelines.process.validate import aligned_shape
from pipelines.report.page import Animation, Block, Paragraph, Section, Table
from pipelines.report.summary import listed
from pipelines.results.result import Result
from pipelines.results.tables import each_once, mode_name, row_names
from pipelines.results.verdict import orders_in_doubt, ring_is_usable

NO_MODE = "No mode was found in the band."
ON_CIRCLE = (
    "Deflection around the tyre: undeformed (grey), deformed (blue) with a dot at each measured "
    "position, nodes of the standing part (open circles), force (arrow); 0° is on the right. An "
    "order n shows n waves; a kink at one position is a faulty sensor, not a shape. A standing "
    "wave keeps its nodes, a travelling one moves them around. The ring's shape is that of its "
    "order, turned to the measured one; on the tyre, outward is blue and inward orange."
)
ORDERS_WITHHELD = (
    "The angles of the sensors are in doubt: orders and pairs are withheld, and the shapes below "
    "are drawn at angles that may be wrong."
)
BY_NODE = (
    "Deflection over the nodes, scaled to a largest part of 1. Neighbours should change smoothly; "
    "a single reversed value points to a wrong sign or node."
)


def stability(result: Result) -> Section:
    """Every pole, and why clusters of poles were kept or dropped."""
    diagram = result.diagram
    low, high = diagram.band_hz
    inside = [cluster for cluster in diagram.clusters if low <= cluster.frequency_hz <= high]
    head = ("frequency / Hz", "damping ratio / %", "model orders", "verdict", "reason")
    blocks: list[Block] = [stability_chart(diagram)]
    outside = [cluster for cluster in diagram.clusters if cluster not in inside]
    for caption, clusters in (
        ("Clusters kept", [each for each in inside if each.kept]),
        ("Clusters dropped", [each for each in inside if not each.kept]),
        ("Clusters outside the band; those kept support the fit, not the result", outside),
    ):
        if clusters:
            rows = tuple(
                (
                    *(f"{each.frequency_hz:.2f}", f"{100 * each.damping_ratio:.2f}"),
                    *(str(each.size), "kept" if each.kept else "dropped", each.reason),
                )
                for each in clusters
            )
            title = f"{caption} ({len(clusters)})"
            blocks.append(Table(title, head, rows, words=(3, 4), folded=True))
    return Section("stability", "Stability diagram", tuple(blocks))


def modes(result: Result) -> Section:
    """Frequencies, damping and shapes of the modes, their pairs, and the cross-check."""
    model = result.modal_model
    if not model.modes:
        return Section("modes", "Modes", (Paragraph(NO_MODE, "warning"), *listed(model.notes)))
    doubt = orders_in_doubt(result)
    every = _mode_columns(model, with_orders=not doubt)
    columns = {title: cells for title, cells in every.items() if set(cells) != {DASH}}
    words = tuple(k for k, title in enumerate(columns) if title in ("pair", "status"))
    table = Table.of_columns("Identified modes", columns, words)
    blocks: tuple[Block, ...] = (table, Paragraph(_fit_text(model)), *listed(model.notes))
    orders = (Paragraph(ORDERS_WITHHELD, "bad"),) if doubt else _orders(model)
    return Section("modes", "Modes", (*blocks, *orders, *_cross_check(result)))


def references(result: Result) -> tuple[Section, ...]:
    """What each of several forces contributes; nothing for one force."""
    driven, model = result.references, result.modal_model
    if not driven:
        return ()
    names = forces(driven)
    cells = {(each.mode, each.reference): each for each in driven}
    columns = {"mode": [mode_name(mode) for mode in model.modes]}
    for force, name in names.items():
        own = [cells.get((k, force)) for k in range(1, len(model.modes) + 1)]
        columns[f"{name}: drive"] = [DASH if e is None else f"{e.drive:.3f}" for e in own]
        if any(mode.member for mode in model.modes):
            columns[f"{name}: share of its order / %"] = [
                DASH if e is None else f"{100 * e.share:.1f}" for e in own
            ]
    text = (
        f"{counted(len(names), 'force')} were identified together: poles and shapes are common to "
        "all, and each force drives them in its own way. FRFs and fits shown elsewhere in this "
        "report are those of the first force."
    )
    antinodes = [report for report in model.orders if np.isfinite(report.antinode_deg)]
    indicators = [mif_chart(result.diagram)] if result.diagram.mif.size else []
    blocks: list[Block] = [
        Paragraph(text),
        *indicators,
        drive_chart(driven, model),
        Table.of_columns("What each force contributes", columns, (0,)),
    ]
    if antinodes:
        rows = tuple(
            (
                str(each.order),
                value_with_std(each.antinode_deg, each.antinode_std_deg),
                number(np.mod(each.antinode_deg + 90 / each.order, 180 / each.order), 4),
            )
            for each in antinodes
        )
        head = ("order n", "antinode of member a / °", "antinode of member b / °")
        blocks.append(Table("Directions of the pairs, modulo 180°/n", head, rows))
    return (Section("references", "Forces", tuple(blocks)),)


def shapes(result: Result) -> Section:
    """The shapes and how alike they are."""
    if not result.modal_model.modes:
        return Section("shapes", "Shapes", (Paragraph(NO_MODE),))
    if result.frf.n_positions == 1:
        return Section("shapes", "Shapes", (Paragraph("A single position has no shape."),))
    return Section("shapes", "Shapes", (_animation(result), _auto_mac(result)))


def _mode_columns(model: ModalModel, *, with_orders: bool) -> dict[str, list[str]]:
    modes = model.modes
    shape_known = model.frac.size > 1
    return {
        "mode": [str(index) for index, _ in enumerate(modes, 1)],
        "order n": [
            f"{m.order}{m.member}" if with_orders and m.order is not None else DASH for m in modes
        ],
        "frequency / Hz": [value_with_std(m.frequency_hz, m.frequency_std_hz, 5) for m in modes],
        "damping ratio / %": [
            value_with_std(100 * m.damping_ratio, 100 * m.damping_std, 3) for m in modes
        ],
        "MPC": [f"{m.mpc:.3f}" if shape_known else DASH for m in modes],
        "MPD / °": [f"{m.mpd_deg:.1f}" if shape_known else DASH for m in modes],
        "purity": [f"{m.order_purity:.3f}" if np.isfinite(m.order_purity) else DASH for m in modes],
        "modal mass / kg": [
            value_with_std(m.modal_mass_kg, m.modal_mass_std_kg)
            if np.isfinite(m.modal_mass_kg)
            else DASH
            for m in modes
        ],
        "pair": [m.pair.value or DASH if with_orders else DASH for m in modes],
        "status": [f"{m.status}: {m.remark}" if m.remark else m.status for m in modes],
    }


def _orders(model: ModalModel) -> tuple[Block, ...]:
    if not model.orders:
        return ()
    head = ("order n", "pair", "mean frequency / Hz", "mean damping / %", "evidence")
    rows = tuple(
        (
            str(report.order),
            report.pair.verdict,
            value_with_std(report.frequency_hz, report.frequency_std_hz, 5),
            value_with_std(100 * report.damping_ratio, 100 * report.damping_std, 3),
            report.pair.evidence,
        )
        for report in model.orders
    )
    text = (
        "Every order n ≥ 1 of a tyre is a pair of modes, of which one shaker sees one combination. "
        "Each order's own FRFs (the part that goes with cos nθ and sin nθ) are fitted with both. "
        "Frequency and damping here are their mean as the force drives them; the table above shows "
        "both members where they are determined, else the one that is seen, else the mean."
    )
    return (Paragraph(text), Table("Orders one by one", head, rows, words=(1, 4)))


def _cross_check(result: Result) -> tuple[Block, ...]:
    if not result.opinions:
        return ()
    name = METHOD_NAMES[result.opinions[0].method]
    apart = [opinion for opinion in result.opinions if not opinion.agrees]
    disputed = sum(np.isfinite(each.mode_hz) for each in apart)
    if not apart:
        same = "finds what these modes should show it: it contradicts none of them."
        return (Paragraph(f"A second estimator ({name}) {same}", "good"),)
    head = ("mode / Hz", f"{name}: frequency / Hz", f"{name}: damping / %")
    rows = tuple(
        (number(o.mode_hz, 5), number(o.frequency_hz, 5), number(100 * o.damping_ratio, 3))
        for o in apart
    )
    if not disputed:
        text = f"A second estimator ({name}) contradicts no mode; it has further poles."
        return (Paragraph(text, "good"), Table("Further poles", head, rows))
    text = f"A second estimator ({name}) disagrees on {counted(disputed, 'mode')}; check."
    return (Paragraph(text, "warning"), Table("Where the estimators disagree", head, rows))


def _fit_text(model: ModalModel) -> str:
    low, high = model.fit_band_hz
    band = f"Fitted to {model.frac.size} FRFs between {low:.4g} and {high:.4g} Hz"
    text = f"{band}; ± is one standard deviation."
    if not np.isfinite(model.misfit):
        return text
    left = f"The fit leaves {number(model.misfit, 3)} times the variance of the noise"
    return f"{text} {left} (1 is noise alone); the standard deviations contain what exceeds it."


def _animation(result: Result) -> Animation:
    model = result.modal_model
    on_circle = _on_circle(model)
    caption = ON_CIRCLE if on_circle else BY_NODE
    names = tuple(map(mode_name, model.modes))
    content = {
        "angle_deg": packed(model.position_deg) if on_circle else None,
        "names": row_names(result.frf, np.arange(result.frf.n_positions)),
        "force_deg": result.excitation_deg if on_circle else None,
        "has_ring": on_circle and ring_is_usable(result),
        "modes": [_mode_content(mode, result) for mode in model.modes],
    }
    words = f"Shapes of the modes {'; '.join(names)}.", f"{caption} Dotted: half a period later."

    def printed() -> tuple[Chart, ...]:
        return (Chart("shapes", shapes_plot(model), *words, wide=True),)

    return Animation("shapes", names, content, caption, printed)


def _mode_content(mode: Mode, result: Result) -> dict[str, Any]:
    at_deg = result.modal_model.position_deg
    known = ring_is_usable(result) and mode.is_ring_mode and _on_circle(result.modal_model)
    damping = f"damping ratio {number(100 * mode.damping_ratio, 3)} %"
    said = f"{mode_name(mode)}: {damping}, MPC {mode.mpc:.3f}, MPD {mode.mpd_deg:.1f}°"
    return {"said": said, "real": packed(mode.shape.real), "imag": packed(mode.shape.imag)} | (
        {"ring": packed(aligned_shape(mode, at_deg))} if known else {}
    )


def _auto_mac(result: Result) -> Chart:
    modes = result.modal_model.modes
    names = each_once(
        [f"{m.frequency_hz:.0f}" if m.order is None else f"{m.order}{m.member}" for m in modes]
    )
    values = auto_mac(np.stack([mode.residues for mode in modes]))
    title = "order n" if _on_circle(result.modal_model) else "frequency / Hz"
    finding = f"the largest value off the diagonal is {np.max(values - np.eye(len(names))):.2f}."
    return matrix_chart(
        values,
        names,
        names,
        name="auto-mac",
        titles=(title, title),
        alternative=f"AutoMAC of {len(names)} modes; {finding}",
        caption=f"AutoMAC, measured shapes among themselves; {finding} Large values off the "
        "diagonal mean that the positions do not tell two modes apart, or that one mode was found "
        "twice.",
    )


def _on_circle(model: ModalModel) -> bool:
    return bool(np.isfinite(model.position_deg).all())
