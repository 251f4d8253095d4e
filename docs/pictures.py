"""Draw the pictures of the documentation from the sample campaign: ``python docs/pictures.py``.

The pictures of the gallery come from its Python blocks: each block that is followed by a picture
defines a `figure`, which is saved as that picture.
"""

import re
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.plots import figures
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


if __name__ == "__main__":
    main()
