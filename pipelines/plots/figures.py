"""Every figure of the report on an axis of your own, to be drawn in `styled_figure`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray

from ema.checks.quality import ReferenceCheck
from ema.core.frf import FRF
from ema.core.modes import ModalModel, Mode
from ema.poles.stability import StabilityDiagram
from pipelines.plots import measurement, modes, ring
from pipelines.plots.chart import Chart
from pipelines.plots.draw import draw
from pipelines.plots.plot import Margins as Margins
from pipelines.plots.plot import Plot
from pipelines.plots.style import png as png
from pipelines.plots.style import styled_figure as styled_figure
from pipelines.results.labels import place_name
from pipelines.results.result import Validation

Ends = tuple[float, float]
Stds = NDArray[np.float64]


def plot_setup(
    frf: FRF, ax: Axes, excitation_deg: float | None = None, reference_deg: float | None = None
) -> Axes:
    """The tyre with its measured positions by run, the force and the reference sensor."""
    return _only(measurement.setup_chart(frf, excitation_deg, reference_deg), ax)


def plot_coherence(frf: FRF, ax: Axes, band_hz: Ends | None = None) -> Axes:
    """Map of the coherence, position by position over frequency; grey where it is unknown."""
    band = band_hz or (float(frf.frequency_hz[0]), float(frf.frequency_hz[-1]))
    return _only(measurement.coherence_chart(frf, band), ax)


def plot_reference(reference: ReferenceCheck, ax: Axes, band_hz: Ends | None = None) -> Axes:
    """The reference sensor's inertances of all runs, one over the other."""
    return _only(measurement.reference_chart(reference, band_hz), ax)


def plot_stability(diagram: StabilityDiagram, ax: Axes) -> Axes:
    """The stability diagram; the mode indicator has its own axis behind."""
    return _only(modes.stability_chart(diagram), ax)


def plot_frf_magnitude(frf: FRF, model: ModalModel, row: int, ax: Axes) -> Axes:
    """Magnitude of one FRF, measured (thin) and fitted (thick); `row` is one of `frf`."""
    return draw(_frf(frf, model, row).panels[0], ax)


def plot_frf_phase(frf: FRF, model: ModalModel, row: int, ax: Axes) -> Axes:
    """Phase of one FRF, measured (thin) and fitted (thick), between −180° and 180°."""
    return draw(_frf(frf, model, row).panels[1], ax)


def plot_shape_on_circle(mode: Mode, position_deg: ArrayLike, ax: Axes) -> Axes:
    """A shape on the circle: undeformed (grey), deformed, half a period later (dotted)."""
    return draw(modes.shape_panel(mode, position_deg), ax)


def plot_shape_by_node(mode: Mode, names: Sequence[str], ax: Axes) -> Axes:
    """A shape as bars over the names of its nodes, where there is no circle."""
    return draw(modes.shape_by_node_panel(mode, names), ax)


def plot_mac(
    values: ArrayLike, row_names: Sequence[str], column_names: Sequence[str], ax: Axes
) -> Axes:
    """A MAC matrix with its values."""
    return _only(modes.matrix_chart(values, row_names, column_names), ax)


def plot_frac(model: ModalModel, ax: Axes) -> Axes:
    """FRAC of measured against fitted FRFs, position by position."""
    return _only(modes.frac_chart(model), ax)


def plot_frequency_scatter(validation: Validation, ax: Axes, std_hz: Stds | None = None) -> Axes:
    """Model against measured frequencies, with the ±1 % band; bars of 2 `std_hz`."""
    return _only(ring.scatter_chart(validation, std_hz), ax)


def plot_frequency_error(validation: Validation, ax: Axes, std_hz: Stds | None = None) -> Axes:
    """Deviation of the model's frequencies, order by order; bars of 2 `std_hz`."""
    return _only(ring.deviation_chart(validation, std_hz), ax)


def plot_dispersion(
    validation: Validation, orders: ArrayLike, ring_hz: ArrayLike, ax: Axes
) -> Axes:
    """Frequency over order, measured and of the ring, also at orders that were not measured."""
    return _only(ring.dispersion_chart(validation, orders, ring_hz), ax)


def plot_damping(validation: Validation, ax: Axes, std: Stds | None = None) -> Axes:
    """Damping ratio over order, measured and of the ring; bars of 2 `std`."""
    return _only(ring.damping_chart(validation, std), ax)


def _frf(frf: FRF, model: ModalModel, row: int) -> Plot:
    title = place_name(int(frf.node[row]), float(frf.position_deg[row]))
    return modes.frf_plot(frf, model, modes.fitted_curves(frf, model, row), title)


def _only(chart: Chart, ax: Axes) -> Axes:
    return draw(chart.plot.panels[0], ax)
