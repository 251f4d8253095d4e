"""Sections on what was identified: poles, modes, FRFs, shapes."""

from __future__ import annotations

import numpy as np

from ema.mac import auto_mac
from ema.modes import ModalModel, Mode
from ema.stability import Cluster
from pipelines import charts_stability, figures
from pipelines.numbers import DASH, number, value_with_std
from pipelines.report.blocks import Beside, Block, Paragraph, Picture, Section, Table
from pipelines.report.notes import listed
from pipelines.result import Result

SHOWN_ANGLE_DEG = 100.0  # the angle from the force that the literature on this test shows
MOST_COLUMNS = 4
NO_MODE = "No mode was found in the band."
CIRCLE_MARGINS = figures.Margins(0.1, 0.1, 0.1, 0.6, between_columns=0.2, between_rows=0.6)
NODE_MARGINS = figures.Margins(0.8, 0.1, 0.6, 0.6, between_columns=0.8, between_rows=1.2)


def stability(result: Result) -> Section:
    """Show every pole, and why clusters of them were kept or dropped."""
    diagram = result.diagram
    low, high = diagram.band_hz
    inside = [cluster for cluster in diagram.clusters if low <= cluster.frequency_hz <= high]
    kept = [cluster for cluster in inside if cluster.kept]
    dropped = [cluster for cluster in inside if not cluster.kept]
    beyond = [cluster for cluster in diagram.clusters if cluster not in inside]
    head = ("frequency / Hz", "damping ratio / %", "model orders", "verdict", "reason")
    blocks: list[Block] = [charts_stability.stability_chart(diagram)]
    for caption, clusters in (
        ("Clusters kept", kept),
        ("Clusters dropped", dropped),
        ("Clusters outside the band; those kept support the fit, not the result", beyond),
    ):
        if clusters:
            rows = tuple(map(_cluster_row, clusters))
            title = f"{caption} ({len(clusters)})"
            blocks.append(Table(title, head, rows, words=(3, 4), folded=True))
    return Section("stability", "Stability diagram", tuple(blocks))


def modes(result: Result) -> Section:
    """List the modes."""
    model = result.modal_model
    if not model.modes:
        found: Block = Paragraph(NO_MODE, "warning")
        return Section("modes", "Modes", (found, *listed(model.notes)))
    columns = {
        title: cells for title, cells in _mode_columns(model).items() if set(cells) != {DASH}
    }
    rows = tuple(zip(*columns.values(), strict=True))
    table = Table("Identified modes", tuple(columns), rows, words=(len(columns) - 1,))
    blocks: tuple[Block, ...] = (table, Paragraph(_fit_text(model)), *listed(model.notes))
    return Section("modes", "Modes", (*blocks, *_orders(model), *_opinions(result)))


def responses(result: Result) -> Section:
    """Show measured and fitted FRFs, and how alike they are everywhere."""
    if not result.modal_model.modes:
        return Section("frf", "Measured and fitted FRFs", (Paragraph(NO_MODE),))
    pictures = tuple(_response(result, row) for row in shown_rows(result))
    frac = (_frac(result),) if result.frf.n_positions > 1 else ()
    return Section("frf", "Measured and fitted FRFs", (Beside((*pictures, *frac)),))


def shapes(result: Result) -> Section:
    """Show the shapes and how alike they are among each other."""
    model = result.modal_model
    if not model.modes:
        return Section("shapes", "Shapes", (Paragraph(NO_MODE),))
    if result.frf.n_positions == 1:
        return Section("shapes", "Shapes", (Paragraph("A single position holds no shape."),))
    return Section("shapes", "Shapes", (_shapes(model), _auto_mac(model)))


def shown_rows(result: Result) -> tuple[int, ...]:
    """Rows of the FRFs worth showing: at the force, at 100° from it, and the worst fitted.

    Without a circle of sensors the first row stands for the first two.
    """
    angles = result.frf.position_deg
    rows = [0]
    if np.isfinite(angles).all():
        start = result.excitation_deg or 0.0
        rows = [_nearest(angles, start), _nearest(angles, start + SHOWN_ANGLE_DEG)]
    return tuple(dict.fromkeys([*rows, int(np.argmin(result.modal_model.frac))]))


def _nearest(angles: np.ndarray, angle: float) -> int:
    return int(np.argmin(np.abs((angles - angle + 180) % 360 - 180)))


def _cluster_row(cluster: Cluster) -> tuple[str, ...]:
    return (
        f"{cluster.frequency_hz:.2f}",
        f"{100 * cluster.damping_ratio:.2f}",
        str(cluster.size),
        "kept" if cluster.kept else "dropped",
        cluster.reason,
    )


def _mode_columns(model: ModalModel) -> dict[str, list[str]]:
    modes = model.modes
    shape_known = model.frac.size > 1
    return {
        "mode": [str(index) for index, _ in enumerate(modes, 1)],
        "order n": [DASH if m.order is None else f"{m.order}{m.member}" for m in modes],
        "frequency / Hz": [value_with_std(m.frequency_hz, m.frequency_std_hz, 5) for m in modes],
        "damping ratio / %": [
            value_with_std(100 * m.damping_ratio, 100 * m.damping_std, 3) for m in modes
        ],
        "MPC": [f"{m.mpc:.3f}" if shape_known else DASH for m in modes],
        "MPD / °": [f"{m.mpd_deg:.1f}" if shape_known else DASH for m in modes],
        "purity": [f"{m.order_purity:.3f}" if np.isfinite(m.order_purity) else DASH for m in modes],
        "status": [m.status for m in modes],
    }


def _orders(model: ModalModel) -> tuple[Block, ...]:
    if not model.orders:
        return ()
    head = ("order n", "pair", "alone: frequency / Hz", "alone: damping / %", "evidence")
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
        "Each order's own FRFs (the part that goes with cos nθ and sin nθ) are tested for a second "
        "pole and identified by themselves, independently of the table above."
    )
    return (Paragraph(text), Table("Orders one by one", head, rows, words=(1, 4)))


def _opinions(result: Result) -> tuple[Block, ...]:
    if not result.opinions:
        return ()
    name = {"plscf": "p-LSCF", "lsce": "LSCE"}[result.opinions[0].method]
    apart = [opinion for opinion in result.opinions if not opinion.agrees]
    if not apart:
        text = (
            f"A second estimator ({name}) finds the same modes, within 0.5 % and 10 % of damping."
        )
        return (Paragraph(text, "good"),)
    head = ("mode / Hz", f"{name}: frequency / Hz", f"{name}: damping / %")
    rows = tuple(
        (number(o.mode_hz, 5), number(o.frequency_hz, 5), number(100 * o.damping_ratio, 3))
        for o in apart
    )
    text = f"A second estimator ({name}) disagrees on {len(apart)} modes; look at these twice."
    return (Paragraph(text, "warning"), Table("Where the estimators disagree", head, rows))


def _fit_text(model: ModalModel) -> str:
    low, high = model.fit_band_hz
    text = (
        f"Fitted to {model.frac.size} FRFs between {low:.4g} and {high:.4g} Hz; ± is one standard "
        "deviation."
    )
    if not np.isfinite(model.misfit):
        return text
    return (
        f"{text} The fit leaves {number(model.misfit, 3)} times the variance of the noise (1 is "
        "noise alone); the standard deviations contain what exceeds it."
    )


def _response(result: Result, row: int) -> Picture:
    frf, model = result.frf, result.modal_model
    with figures.styled_figure(13, 10, 2, sharex=True, height_ratios=(3, 2)) as (
        figure,
        (top, low),
    ):
        figures.plot_frf_magnitude(frf, model, row, top)
        figures.plot_frf_phase(frf, model, row, low)
    name = figures.place_name(int(frf.node[row]), float(frf.position_deg[row]))
    return Picture(
        figures.png_uri(figure),
        f"Magnitude and phase of the inertance at {name}, measured and fitted.",
        f"Inertance at {name}, FRAC {model.frac[row]:.4f}. The fitted curve should pass through "
        "the measured one at peaks and between them; a shift between peaks points to a missing "
        "mode. Grey: fitted, but outside the band of interest.",
    )


def _frac(result: Result) -> Picture:
    model = result.modal_model
    worst = int(np.argmin(model.frac))
    name = figures.place_name(int(model.node[worst]), float(model.position_deg[worst]))
    with figures.styled_figure(13, 7) as (figure, ax):
        figures.plot_frac(model, ax)
    return Picture(
        figures.png_uri(figure),
        f"FRAC of all positions; the lowest is {model.frac[worst]:.4f} at {name}.",
        f"FRAC, measured against fitted, at every position; the lowest is {model.frac[worst]:.4f} "
        f"at {name} (dashed: 0.9). A single low value points to a faulty sensor, many of them to "
        "missing modes.",
    )


def _shapes(model: ModalModel) -> Picture:
    columns = min(MOST_COLUMNS, len(model.modes))
    rows = -(-len(model.modes) // columns)
    on_circle = bool(np.isfinite(model.position_deg).all())
    margins = CIRCLE_MARGINS if on_circle else NODE_MARGINS
    height = (4.6 if on_circle else 3.6) * rows
    with figures.styled_figure(17.5, height, rows, columns, margins, squeeze=False) as (
        figure,
        grid,
    ):
        for ax in grid.flat[len(model.modes) :]:
            ax.set_axis_off()
        for mode, ax in zip(model.modes, grid.flat, strict=False):
            if on_circle:
                figures.plot_shape_on_circle(mode, model.position_deg, ax)
            else:
                figures.plot_shape_by_node(mode, _node_names(model), ax)
    caption = (
        "Shapes, largest deflection drawn as 0.3 radii: undeformed (grey), deformed (solid), half "
        "a period later (dotted); 0° is on the right. An order n shows n waves around the circle; "
        "a single kink is a faulty sensor, not a shape."
        if on_circle
        else "Shapes over the nodes, scaled to a largest part of 1. Neighbours should change "
        "smoothly; a single reversed bar points to a wrong sign or node."
    )
    names = "; ".join(map(figures.mode_name, model.modes))
    return Picture(figures.png_uri(figure), f"Shapes of the modes {names}.", caption, wide=True)


def _node_names(model: ModalModel) -> list[str]:
    return [str(node) if node >= 0 else str(row) for row, node in enumerate(model.node, 1)]


def _auto_mac(model: ModalModel) -> Picture:
    names = [_label(mode) for mode in model.modes]
    values = auto_mac(np.stack([mode.residues for mode in model.modes]))
    with figures.styled_figure(10.5, 9.5) as (figure, ax):
        figures.plot_mac(values, names, names, ax)
        on_circle = model.modes[0].order is not None
        ax.set_xlabel("order n" if on_circle else "frequency / Hz")
        ax.set_ylabel("order n" if on_circle else "frequency / Hz")
    largest = float(np.max(values - np.eye(len(names))))
    return Picture(
        figures.png_uri(figure),
        f"AutoMAC of {len(names)} modes; the largest value off the diagonal is {largest:.2f}.",
        f"AutoMAC, measured shapes among themselves; the largest value off the diagonal is "
        f"{largest:.2f}. Large values off the diagonal mean that the positions do not tell two "
        "modes apart, or that one mode was found twice.",
    )


def _label(mode: Mode) -> str:
    return f"{mode.frequency_hz:.0f}" if mode.order is None else f"{mode.order}{mode.member}"
