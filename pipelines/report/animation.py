"""The section on shapes: each one moves on the circle, and their AutoMAC."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ema.core.mac import auto_mac
from ema.core.modes import ModalModel, Mode
from pipelines.plots.chart import Chart, Drawing, packed
from pipelines.plots.charts_matrix import mac_chart
from pipelines.report.blocks import Animation, Beside, Paragraph, Section
from pipelines.results.labels import mode_name, row_names
from pipelines.results.result import Result
from pipelines.storage.rounding import number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NO_MODE = "No mode was found in the band."
MOST_COLUMNS = 4
ON_CIRCLE = (
    "Deflection around the tyre: undeformed (grey), deformed (blue) with a dot at each measured "
    "position, nodes of the standing part (open circles), force (arrow); 0° is on the right. An "
    "order n shows n waves; a kink at one position is a faulty sensor, not a shape. A standing "
    "wave keeps its nodes, a travelling one moves them around."
)
BY_NODE = (
    "Deflection over the nodes, scaled to a largest part of 1. Neighbours should change smoothly; "
    "a single reversed value points to a wrong sign or node."
)


def shapes(result: Result) -> Section:
    """Show the shapes and how alike they are among each other."""
    if not result.modal_model.modes:
        return Section("shapes", "Shapes", (Paragraph(NO_MODE),))
    if result.frf.n_positions == 1:
        return Section("shapes", "Shapes", (Paragraph("A single position holds no shape."),))
    return Section("shapes", "Shapes", (Beside((_animation(result), _auto_mac(result))),))


def _animation(result: Result) -> Animation:
    model = result.modal_model
    on_circle = _on_circle(model)
    caption = ON_CIRCLE if on_circle else BY_NODE
    names = tuple(map(mode_name, model.modes))
    content = {
        "angle_deg": packed(model.position_deg) if on_circle else None,
        "names": _row_names(result),
        "force_deg": result.excitation_deg if on_circle else None,
        "modes": [_mode_content(mode) for mode in model.modes],
    }
    drawing = Drawing(
        "shapes",
        f"Shapes of the modes {'; '.join(names)}.",
        f"{caption} Dotted: half a period later.",
        lambda: _draw(result),
        wide=True,
    )
    return Animation("shapes", names, content, caption, (drawing,))


def _mode_content(mode: Mode) -> dict[str, Any]:
    """A shape, and what is said about it."""
    shape = mode.shape
    said = (
        f"{mode_name(mode)}: damping ratio {number(100 * mode.damping_ratio, 3)} %, "
        f"MPC {mode.mpc:.3f}, MPD {mode.mpd_deg:.1f}°"
    )
    return {"said": said, "real": packed(shape.real), "imag": packed(shape.imag)}


def _auto_mac(result: Result) -> Chart:
    modes = result.modal_model.modes
    names = _labels(modes)
    values = auto_mac(np.stack([mode.residues for mode in modes]))
    title = "order n" if _on_circle(result.modal_model) else "frequency / Hz"
    largest = f"{np.max(values - np.eye(len(names))):.2f}"
    return mac_chart(
        values,
        names,
        names,
        name="auto-mac",
        titles=(title, title),
        alternative=f"AutoMAC of {len(names)} modes; the largest value off the diagonal is "
        f"{largest}.",
        caption="AutoMAC, measured shapes among themselves; the largest value off the diagonal is "
        f"{largest}. Large values off the diagonal mean that the positions do not tell two modes "
        "apart, or that one mode was found twice.",
    )


def _labels(modes: tuple[Mode, ...]) -> list[str]:
    """Short names of the modes, each once."""
    short = [
        f"{mode.frequency_hz:.0f}" if mode.order is None else f"{mode.order}{mode.member}"
        for mode in modes
    ]
    return [
        name if short.count(name) == 1 else f"{name} ({index})"
        for index, name in enumerate(short, 1)
    ]


def _on_circle(model: ModalModel) -> bool:
    return bool(np.isfinite(model.position_deg).all())


def _row_names(result: Result) -> list[str]:
    return row_names(result.frf, np.arange(result.frf.n_positions))


def _draw(result: Result) -> Figure:
    # Loads matplotlib, which the page on a screen does without.
    from pipelines.plots import figures

    model = result.modal_model
    on_circle = _on_circle(model)
    columns = min(MOST_COLUMNS, len(model.modes))
    rows = -(-len(model.modes) // columns)
    margins = (
        figures.Margins(0.1, 0.1, 0.1, 0.6, between_columns=0.2, between_rows=0.6)
        if on_circle
        else figures.Margins(0.8, 0.1, 0.6, 0.6, between_columns=0.8, between_rows=1.2)
    )
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
                figures.plot_shape_by_node(mode, _row_names(result), ax)
    return figure
