"""Draw the picture of the README from the sample campaign: ``python docs/pictures.py``."""

from pathlib import Path

import numpy as np

from pipelines import figures
from pipelines.process import process

DOCS = Path(__file__).parent
SAMPLE = DOCS.parent / "sample_data" / "tyre_225_55R17"
SHOWN_ANGLE_DEG = 100.0


def draw_result() -> bytes:
    """One FRF, measured and fitted, and the shapes of the modes."""
    result = process(SAMPLE)
    model = result.modal_model
    row = int(np.argmin(np.abs(result.frf.position_deg - SHOWN_ANGLE_DEG)))
    margins = figures.Margins(1.6, 0.3, 1.15, 0.6, between_columns=0.4, between_rows=0.7)
    with figures.styled_figure(26, 8.4, 2, 6, margins) as (figure, grid):
        left = figure.add_subplot(grid[0, 0].get_gridspec()[:, :2])
        figures.plot_frf_magnitude(result.frf, model, row, left)
        left.set_xlabel("frequency / Hz")
        for ax in grid[:, :2].flat:
            ax.remove()
        for mode, ax in zip(model.modes, grid[:, 2:].flat, strict=False):
            figures.plot_shape_on_circle(mode, model.position_deg, ax)
    return figures.png(figure)


if __name__ == "__main__":
    (DOCS / "images").mkdir(exist_ok=True)
    (DOCS / "images" / "result.png").write_bytes(draw_result())
