"""Figures: what is drawn where, in every state the data can be in, and the same look everywhere."""

from __future__ import annotations

from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from results import structure_result, tyre_result, without_poles
from systems import common_drift

from pipelines.plots import figures
from pipelines.plots.draw import STYLE
from pipelines.results.tables import apart, literal, short, sparse_labels, spread


@pytest.fixture(scope="module")
def tyre():
    return tyre_result()


@pytest.fixture(scope="module")
def structure():
    return structure_result()


def drawn(plot, *data, **options):
    """The axis that `plot` returns, after it went through the renderer."""
    with figures.styled_figure(10, 8) as (figure, ax):
        assert plot(*data, ax, **options) is ax
    assert figures.png(figure).startswith(b"\x89PNG")
    return ax


def texts(ax):
    return [text.get_text() for text in ax.texts]


def test_a_picture_has_the_size_asked_for():
    with figures.styled_figure(12.7, 7.62) as (figure, _):
        pass
    width, height = np.frombuffer(figures.png(figure)[16:24], dtype=">u4")
    assert (width, height) == (750, 450)


def test_margins_are_kept_in_centimetres():
    margins = figures.Margins(2, 1, 1.5, 0.5, between_columns=1, between_rows=0.8)
    with figures.styled_figure(20, 10, 2, 3, margins) as (_, axes):
        pass
    first, last = axes[0, 0].get_position(), axes[-1, -1].get_position()
    beside, below = axes[0, 1].get_position(), axes[1, 0].get_position()
    assert 20 * first.x0 == pytest.approx(2)
    assert 20 * (1 - last.x1) == pytest.approx(1)
    assert 10 * last.y0 == pytest.approx(1.5)
    assert 10 * (1 - first.y1) == pytest.approx(0.5)
    assert 20 * (beside.x0 - first.x1) == pytest.approx(1)
    assert 10 * (first.y0 - below.y1) == pytest.approx(0.8)


def test_the_style_leaves_nothing_behind():
    before = {name: mpl.rcParams[name] for name in STYLE}
    with figures.styled_figure(10, 8):
        assert {name: mpl.rcParams[name] for name in STYLE} != before
    assert {name: mpl.rcParams[name] for name in STYLE} == before


def test_setup_shows_every_position_on_the_circle(tyre):
    ax = drawn(figures.plot_setup, tyre.frf, excitation_deg=0.0, reference_deg=2.5)
    markers = [line for line in ax.lines if line.get_label().startswith("config")]
    assert sum(line.get_xdata().size for line in markers) == 72
    radius = np.concatenate([np.hypot(line.get_xdata(), line.get_ydata()) for line in markers])
    np.testing.assert_allclose(radius, 1)
    assert "F" in texts(ax)


@pytest.mark.parametrize("angle", [0, 90, 180, 225])
def test_the_force_stays_inside_the_sketch(tyre, angle):
    ax = drawn(figures.plot_setup, tyre.frf, excitation_deg=float(angle))
    force = next(text for text in ax.texts if text.get_text() == "F")
    x, y = force.get_position()
    assert ax.get_xlim()[0] < x < ax.get_xlim()[1]
    assert ax.get_ylim()[0] < y < ax.get_ylim()[1]
    assert np.rad2deg(np.arctan2(y, x)) % 360 == pytest.approx(angle)


def test_coherence_map_has_a_row_per_position_and_keeps_the_mean(tyre):
    ax = drawn(figures.plot_coherence, tyre.frf, band_hz=(40, 250))
    picture = ax.images[0].get_array()
    inside = (tyre.frf.frequency_hz >= 40) & (tyre.frf.frequency_hz <= 250)
    assert picture.shape[0] == 72
    np.testing.assert_allclose(picture.mean(), tyre.frf.coherence[:, inside].mean(), rtol=2e-3)


def test_coherence_map_says_where_nothing_is_known(structure, tyre):
    assert "coherence unknown" in texts(drawn(figures.plot_coherence, structure.frf))
    coherence = np.array(tyre.frf.coherence)
    coherence[3] = np.nan
    picture = drawn(figures.plot_coherence, replace(tyre.frf, coherence=coherence)).images[0]
    assert picture.get_array().mask[3].all()
    assert not picture.get_array().mask[4].any()


def test_reference_shows_one_curve_a_run(tyre):
    ax = drawn(figures.plot_reference, tyre.reference, band_hz=(40, 250))
    assert [line.get_label() for line in ax.lines] == list(tyre.reference.run)


def test_names_from_files_start_no_formula(tyre):
    runs = tuple("$\\frac{" for _ in tyre.reference.run)
    ax = drawn(figures.plot_reference, replace(tyre.reference, run=runs))
    assert ax.get_legend() is not None


def test_stability_diagram_names_the_kept_clusters_apart(tyre):
    ax = drawn(figures.plot_stability, tyre.diagram)
    assert texts(ax) == [f"{mode.frequency_hz:.1f}" for mode in tyre.modal_model.modes]
    shown = sum(line.get_xdata().size for line in ax.lines if line.get_linestyle() == "None")
    assert shown == tyre.diagram.poles.size


def test_stability_diagram_without_any_pole():
    assert texts(drawn(figures.plot_stability, without_poles(tyre_result().diagram))) == []


def test_fitted_frf_is_the_models(tyre):
    ax = drawn(figures.plot_frf_magnitude, tyre.frf, tyre.modal_model, 20)
    fitted = next(line for line in ax.lines if line.get_label() == "fitted")
    exact = np.abs(tyre.modal_model.synthesise(fitted.get_xdata())[20])
    np.testing.assert_allclose(fitted.get_ydata(), exact)
    assert ax.get_title(loc="left") == "node 20, 100°"


def test_fitted_frf_is_drawn_in_the_state_of_its_run(tyre):
    drift = common_drift(("config_3.uff",), [-0.5], [0.01])
    drifted = replace(tyre.modal_model, drift=drift)
    assert tyre.frf.run[20] == "config_3.uff"
    ax = drawn(figures.plot_frf_magnitude, tyre.frf, drifted, 20)
    fitted = next(line for line in ax.lines if line.get_label() == "fitted")
    exact = np.abs(drifted.synthesise(fitted.get_xdata(), tyre.frf.run)[20])
    np.testing.assert_allclose(fitted.get_ydata(), exact)
    assert not np.allclose(exact, np.abs(drifted.synthesise(fitted.get_xdata())[20]), rtol=1e-3)


def test_phase_has_no_line_across_the_picture(tyre):
    ax = drawn(figures.plot_frf_phase, tyre.frf, tyre.modal_model, 20)
    for line in ax.lines:
        steps = np.abs(np.diff(line.get_ydata()))
        assert np.nanmax(steps) <= 180


def test_shape_of_order_n_crosses_the_circle_2n_times(tyre):
    for mode in tyre.modal_model.modes:
        ax = drawn(figures.plot_shape_on_circle, mode, tyre.modal_model.position_deg)
        deformed = next(line for line in ax.lines if line.get_linestyle() == "-" and line.zorder)
        x, y = ax.lines[2].get_data()
        outside = np.hypot(x, y)[:-1] > 1 + 1e-12
        crossings = np.sum(outside != np.roll(outside, 1))
        assert deformed is not None
        assert crossings == 2 * mode.order
        assert np.hypot(x, y).max() <= 1.3 + 1e-12


def test_shape_by_node_is_scaled_to_one(structure):
    names = [str(node) for node in structure.modal_model.node]
    ax = drawn(figures.plot_shape_by_node, structure.modal_model.modes[2], names)
    heights = [bar.get_height() for bar in ax.patches]
    assert max(map(abs, heights)) == pytest.approx(1)


def test_mac_shows_its_values():
    ax = drawn(figures.plot_mac, [[1, 0.25], [0.5, 0.98]], ["1", "2"], ["1", "2"])
    assert texts(ax) == ["1.00", "0.25", "0.50", "0.98"]


def test_large_mac_keeps_small_values_silent():
    names = [str(n) for n in range(12)]
    ax = drawn(figures.plot_mac, np.eye(12), names, names)
    assert texts(ax) == ["1.00"] * 12


def test_frac_over_angle_or_node(tyre, structure):
    assert drawn(figures.plot_frac, tyre.modal_model).get_xlabel() == "position / °"
    assert drawn(figures.plot_frac, structure.modal_model).get_xlabel() == "node"


def test_scatter_and_error_label_every_order(tyre):
    ax = drawn(figures.plot_frequency_scatter, tyre.validation)
    assert texts(ax) == [str(order) for order in tyre.validation.order]
    assert ax.get_xlim() == ax.get_ylim()
    error = drawn(figures.plot_frequency_error, tyre.validation)
    assert error.get_ylim()[1] > np.abs(tyre.validation.error_percent).max()


def test_a_single_order_can_be_drawn(tyre):
    found = tyre.validation
    one = replace(
        found,
        order=found.order[:1],
        measured_hz=found.measured_hz[:1],
        model_hz=found.model_hz[:1],
        mac=found.mac[:1, :1],
    )
    drawn(figures.plot_frequency_scatter, one)
    drawn(figures.plot_frequency_error, one)


def test_dispersion_and_damping_show_measured_and_ring(tyre):
    ax = drawn(figures.plot_dispersion, tyre.validation, [1, 2, 3], [70.0, 100.0, 120.0])
    assert [line.get_label() for line in ax.lines] == ["ring model", "measured"]
    assert len(drawn(figures.plot_damping, tyre.validation).lines) == 2


@given(st.lists(st.floats(0, 100, allow_nan=False), max_size=12).map(sorted), st.floats(0.1, 20))
def test_spread_labels_keep_their_gap_order_and_centre(positions, gap):
    placed = spread(positions, gap)
    assert np.all(np.diff(placed) >= gap * (1 - 1e-9) - 1e-9)
    if positions:
        assert np.mean(placed) == pytest.approx(np.mean(positions), abs=1e-6)


def test_labels_far_apart_stay_where_they_are():
    np.testing.assert_allclose(spread([1.0, 5.0, 20.0], 2.0), [1.0, 5.0, 20.0])


@given(st.text(max_size=60), st.integers(5, 40))
def test_short_texts_stay_and_long_ones_fit(text, length):
    result = short(text, length)
    assert len(result) <= max(length, 0)
    assert result == text or len(text) > length


def test_long_names_lose_what_they_share():
    runs = [f"measurement_2024-05-17_tyre_17_run_{k}.uff" for k in (1, 2, 10)]
    assert apart(runs) == ["…1.uff", "…2.uff", "…10.uff"]
    assert apart(["config_1.uff", "config_2.uff"]) == ["config_1.uff", "config_2.uff"]
    assert apart(["a" * 40]) == [short("a" * 40, 16)]
    assert apart([]) == []


@given(st.lists(st.text(max_size=60), max_size=6))
def test_names_for_a_legend_are_short(names):
    shown = apart(names)
    assert len(shown) == len(names)
    assert all(len(name) <= 16 for name in shown)


def test_literal_dollars():
    assert literal("a$b") == r"a\$b"


@given(st.integers(1, 3000))
def test_sparse_labels_fit(count):
    indices, labels = sparse_labels([str(k) for k in range(count)])
    assert len(indices) <= 13
    assert indices[0] == 0
    assert labels == [str(index) for index in indices]
