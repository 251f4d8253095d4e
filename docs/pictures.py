"""Draw the pictures of the documentation from the sample campaign: ``python docs/pictures.py``.

The pictures of the gallery come from its Python blocks: each block that is followed by a picture
defines a `figure`, which is saved as that picture.
"""

import re
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pipelines.plots import figures
from pipelines.plots.draw import write_figure
from pipelines.process.run import process

DOCS = Path(__file__).parent
ROOT = DOCS.parent
GALLERY = DOCS / "gallery.md"
SAMPLE = ROOT / "sample_data" / "tyre_225_55R17"
SHOWN_ANGLE_DEG = 100.0
BLOCK = re.compile(r"```python\n(?P<code>.*?)```(?:\n\n!\[[^\]]*\]\((?P<picture>[^)]+)\))?", re.S)


def draw_result() -> bytes:
    """One FRF, measured and fitted, and the shapes of the modes: the picture of the README."""
    result = process(SAMPLE)
    model = result.modal_model
    row = int(np.argmin(np.abs(result.frf.position_deg - SHOWN_ANGLE_DEG)))
    margins = figures.Margins(1.6, 0.3, 1.15, 0.6, between_columns=0.4, between_rows=0.7)
    with figures.styled_figure(26, 12.4, 3, 6, margins) as (figure, grid):
        left = figure.add_subplot(grid[0, 0].get_gridspec()[:, :3])
        figures.plot_frf_magnitude(result.frf, model, row, left)
        left.set_xlabel("frequency / Hz")
        for ax in grid[:, :3].flat:
            ax.remove()
        for mode, ax in zip(model.modes, grid[:, 3:].flat, strict=False):
            figures.plot_shape_on_circle(mode, model.position_deg, ax)
    return figures.png(figure)


def draw_measures() -> Figure:
    """Which radius, width and angles are meant: cross-section and side view of a tyre."""
    ink, soft, mark = "#222222", "#808080", "#0072B2"
    double: dict[str, Any] = {"arrowstyle": "<->", "shrinkA": 0, "shrinkB": 0}
    with figures.styled_figure(20, 9, 1, 2, figures.Margins(0.2, 0.2, 0.2, 0.7)) as (figure, axes):
        section, side = axes
        for ax, title in ((section, "Cross-section"), (side, "Side view")):
            ax.set_axis_off()
            ax.set_aspect("equal")
            ax.set_title(title)
        wall = np.array([(-0.8, 1.8), (-1.15, 2.3), (-0.95, 2.95), (0.95, 2.95), (1.15, 2.3)])
        section.plot(*np.vstack([wall, (0.8, 1.8)]).T, color=ink, lw=2)
        section.plot([-0.8, -0.7, 0.7, 0.8], [1.8, 1.6, 1.6, 1.8], color=soft, lw=3)
        section.plot([-0.8, 0.8], [2.78, 2.78], color=mark, lw=4)
        section.plot([-1.6, 1.6], [0, 0], color=soft, lw=1, ls="-.")
        section.text(1.62, 0, " axle", color=soft, va="center")
        section.annotate("", (0, 2.78), (0, 0), arrowprops=double | {"color": mark})
        section.text(0.06, 0.9, "mean_radius: axle to\nmiddle of the steel belt", color=mark)
        section.annotate("", (-0.8, 3.15), (0.8, 3.15), arrowprops=double | {"color": mark})
        section.text(0, 3.25, "belt_width: the steel belt", color=mark, ha="center")
        section.annotate("", (-1.15, 2.3), (1.15, 2.3), arrowprops=double | {"color": soft})
        section.text(1.2, 2.3, " section width 225:\n not this", color=soft, va="center")
        section.set(xlim=(-1.9, 2.3), ylim=(-0.3, 3.6))
        around = np.linspace(0, 2 * np.pi, 200)
        for radius, colour, width in ((1.0, ink, 2), (0.93, mark, 3), (0.55, soft, 2)):
            side.plot(radius * np.cos(around), radius * np.sin(around), color=colour, lw=width)
        for k in range(12):
            angle = np.radians(30 * k)
            side.plot(np.cos(angle), np.sin(angle), "o", color=ink, ms=4)
            label = 1.17 * np.cos(angle), 1.17 * np.sin(angle)
            side.text(*label, f"{30 * k}°" if k else "", ha="center", va="center", fontsize=7)
        side.annotate("", (1.02, 0), (1.5, 0), arrowprops={"arrowstyle": "-|>", "color": "#D55E00"})
        side.text(1.55, 0, "force, 0°", color="#D55E00", va="center")
        turn = np.radians(np.linspace(10, 50, 30))
        side.plot(0.75 * np.cos(turn), 0.75 * np.sin(turn), color=ink, lw=1)
        head = {"arrowstyle": "-|>", "color": ink}
        side.annotate(
            "",
            (0.75 * np.cos(turn[-1] + 0.05), 0.75 * np.sin(turn[-1] + 0.05)),
            (0.75 * np.cos(turn[-1]), 0.75 * np.sin(turn[-1])),
            arrowprops=head,
        )
        side.text(0, -1.4, "one side and one way round in all runs", ha="center", color=soft)
        side.set(xlim=(-1.4, 2.2), ylim=(-1.55, 1.4))
    return figure


def draw_gallery() -> dict[str, bytes]:
    """Pictures of the gallery by their path from the page."""
    pictures = {}
    namespace: dict[str, Any] = {}
    with chdir(ROOT):
        for block in BLOCK.finditer(GALLERY.read_text(encoding="utf-8")):
            exec(block["code"], namespace)
            if block["picture"]:
                pictures[block["picture"]] = figures.png(namespace["figure"])
    return pictures


def main() -> None:
    """Write every picture to its place."""
    for name, picture in {"images/result.png": draw_result(), **draw_gallery()}.items():
        (DOCS / name).parent.mkdir(parents=True, exist_ok=True)
        (DOCS / name).write_bytes(picture)
    write_figure(DOCS / "images" / "measures.svg", draw_measures())


if __name__ == "__main__":
    main()
