"""Every figure of the project: ``plot_*(data, …, ax) -> ax``, to be drawn in `styled_figure`."""

from pipelines.plots.data import plot_coherence, plot_drive_point, plot_reference, plot_setup
from pipelines.plots.matrix import plot_mac, plot_signed_matrix
from pipelines.plots.modes import (
    plot_frac,
    plot_frf_magnitude,
    plot_frf_phase,
    plot_shape_by_node,
    plot_shape_on_circle,
    plot_stability,
)
from pipelines.plots.ring import (
    plot_damping,
    plot_dispersion,
    plot_frequency_error,
    plot_frequency_scatter,
)
from pipelines.plots.style import Margins, png, png_uri, styled_figure
from pipelines.results.labels import mode_name, place_name

__all__ = [
    "Margins",
    "mode_name",
    "place_name",
    "plot_coherence",
    "plot_damping",
    "plot_dispersion",
    "plot_drive_point",
    "plot_frac",
    "plot_frequency_error",
    "plot_frequency_scatter",
    "plot_frf_magnitude",
    "plot_frf_phase",
    "plot_mac",
    "plot_reference",
    "plot_setup",
    "plot_shape_by_node",
    "plot_shape_on_circle",
    "plot_signed_matrix",
    "plot_stability",
    "png",
    "png_uri",
    "styled_figure",
]
