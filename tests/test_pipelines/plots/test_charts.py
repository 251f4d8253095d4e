"""Charts as data: the numbers of the result, units, findings in words, the page's colours alone."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from base64 import b64decode
from dataclasses import replace

import numpy as np
import pytest
from results import structure_result, tyre_result, without_poles

from ema.core.finding import Check, Finding, Verdict
from model.ring import natural_frequencies_hz
from pipelines.batch import run as charts_batch
from pipelines.batch.state import DONE, FAILED, Fingerprint, Record
from pipelines.plots import measurement, modes, ring
from pipelines.plots.chart import Chart
from pipelines.report.page import Beside, Paragraph, Table
from pipelines.report.write import report_sections
from pipelines.results.tables import MODES

SECTIONS = ("quality", "stability", "validation", "parameters")


@pytest.fixture(scope="module")
def tyre():
    return tyre_result()


@pytest.fixture(scope="module")
def charts(tyre):
    return {chart.name: chart for chart in charts_of(tyre)}


def charts_of(result):
    blocks = [
        block
        for section in report_sections(result)
        if section.anchor in SECTIONS
        for block in section.blocks
    ]
    inside = [
        one for block in blocks for one in (block.blocks if isinstance(block, Beside) else (block,))
    ]
    return [block for block in inside if isinstance(block, Chart)]


def unpacked(packed):
    """Numbers of a packed array, as Plotly reads them; whole numbers are listed."""
    if isinstance(packed, list):
        return np.array(packed)
    assert packed["dtype"] == "f4"
    values = np.frombuffer(b64decode(packed["bdata"]), dtype="<f4")
    shape = packed.get("shape")
    return values.reshape(tuple(map(int, shape.split(",")))) if shape else values


def test_every_chart_of_the_sections_is_there(charts):
    assert set(charts) == {
        "coherence",
        "reference",
        "drive-point",
        "stability",
        "frequency-scatter",
        "mac",
        "dispersion",
        "frequency-deviation",
        "damping",
        "sensitivity",
        "parameter-correlation",
    }


def test_specifications_are_json_without_a_colour_of_their_own(charts):
    for chart in charts.values():
        text = json.dumps({"data": chart.data, "layout": chart.layout}, allow_nan=False)
        without_numbers = re.sub(r'"bdata": "[^"]*"', "", text)
        assert not re.search(r"#[0-9a-fA-F]{3,8}\b", without_numbers)


def test_charts_say_what_they_show_and_what_to_look_for(charts):
    for chart in charts.values():
        assert re.fullmatch(r"[a-z-]+", chart.name)
        assert chart.alternative.endswith(".")
        assert len(chart.caption) > 40


def test_every_axis_has_a_title_and_every_hover_its_own_text(charts):
    for chart in charts.values():
        for name, axis in chart.layout.items():
            if name.startswith(("xaxis", "yaxis")):
                assert axis["title"]["text"]
        for trace in chart.data:
            assert "hovertemplate" in trace or trace["hoverinfo"] == "skip"


def test_charts_load_nothing_that_draws():
    modules = ", ".join(f"pipelines.plots.{name}" for name in ("comparison", "modes", "ring"))
    program = f"import sys, {modules}; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_stability_holds_every_pole_of_the_band_once(tyre, charts):
    chart, diagram = charts["stability"], tyre.diagram
    poles = [trace for trace in chart.data if trace["mode"] == "markers"]
    frequency_hz = np.concatenate([unpacked(trace["x"]) for trace in poles])
    order = np.concatenate([unpacked(trace["y"]) for trace in poles])
    damping = np.concatenate([unpacked(trace["customdata"]) for trace in poles])
    low, high = diagram.band_hz
    inside = (diagram.frequency_hz >= low) & (diagram.frequency_hz <= high)
    expected = np.sort(diagram.frequency_hz[inside])
    np.testing.assert_allclose(np.sort(frequency_hz), expected, rtol=1e-6)
    assert order.sum() == diagram.model_order[inside].sum()
    np.testing.assert_allclose(
        np.sort(damping), np.sort(100 * diagram.damping_ratio[inside]), rtol=1e-5
    )


def test_stability_names_kept_clusters_and_reasons(tyre, charts):
    chart = charts["stability"]
    labels = [note["text"] for note in chart.layout["annotations"]]
    assert labels == [f"{mode.frequency_hz:.1f}" for mode in tyre.modal_model.modes]
    said = {text for trace in chart.data if "text" in trace for text in trace["text"]}
    assert said == {"present in every model order", "shape not repeatable", "in no cluster"}
    for trace in chart.data:
        if "text" in trace:
            assert len(trace["text"]) == unpacked(trace["x"]).size


def test_stability_without_poles_has_its_indicator(tyre):
    chart = modes.stability_chart(without_poles(tyre.diagram))
    assert "0 columns" in chart.alternative
    assert unpacked(chart.data[0]["y"]).size > 100


def test_stability_of_any_model_order_has_few_ticks(tyre):
    orders = 300 * tyre.diagram.model_order
    chart = modes.stability_chart(replace(tyre.diagram, model_order=orders))
    assert len(chart.plot.panels[0].y.ticks) < 30


def test_coherence_map_is_sorted_by_position_and_holds_the_values(tyre):
    shuffled = tyre.frf.rows(np.random.default_rng(3).permutation(72))
    trace = measurement.coherence_chart(shuffled, (40.0, 250.0)).data[0]
    lines = (tyre.frf.frequency_hz >= 40) & (tyre.frf.frequency_hz <= 250)
    np.testing.assert_allclose(unpacked(trace["z"]), tyre.frf.coherence[:, lines], rtol=1e-6)
    np.testing.assert_allclose(unpacked(trace["x"]), tyre.frf.frequency_hz[lines])
    assert trace["y"][:3] == ["0°", "5°", "10°"]


def test_a_large_coherence_map_is_averaged_and_says_so(tyre, monkeypatch):
    monkeypatch.setattr(measurement, "MOST_CELLS", 72 * 100)
    chart = measurement.coherence_chart(tyre.frf, (40.0, 250.0))
    values = unpacked(chart.data[0]["z"])
    lines = (tyre.frf.frequency_hz >= 40) & (tyre.frf.frequency_hz <= 250)
    assert values.size <= 72 * 100
    assert "Each cell is the mean of 9 lines." in chart.caption
    first = tyre.frf.coherence[:, lines][:, :9].mean(axis=1)
    np.testing.assert_allclose(values[:, 0], first, rtol=1e-6)


def test_coherence_names_the_worst_position(tyre):
    coherence = np.array(tyre.frf.coherence)
    coherence[7] = 0.25
    coherence[8] = np.nan
    chart = measurement.coherence_chart(replace(tyre.frf, coherence=coherence), (40.0, 250.0))
    assert "0.250 at 35°" in chart.alternative


def test_positions_of_one_name_keep_a_row_each(tyre):
    twice = replace(tyre.frf, position_deg=np.repeat(np.arange(36.0), 2))
    names = measurement.coherence_chart(twice, (40.0, 250.0)).data[0]["y"]
    assert len(set(names)) == 72


def test_reference_has_a_curve_for_each_run(tyre, charts):
    check = tyre.reference
    for trace, run, values in zip(charts["reference"].data, check.run, check.values, strict=True):
        assert trace["name"] == run
        np.testing.assert_allclose(unpacked(trace["y"]), np.abs(values), rtol=1e-6)
        last = trace["x0"] + trace["dx"] * (values.size - 1)
        assert last == pytest.approx(check.frequency_hz[-1])


def test_names_from_files_are_no_markup(tyre):
    runs = tuple('<a href="">&' for _ in tyre.reference.run)
    chart = measurement.reference_chart(replace(tyre.reference, run=runs))
    assert {trace["name"] for trace in chart.data} == {'&lt;a href=""&gt;&amp;'}


@pytest.mark.parametrize(
    ("ratio", "consistent", "words"),
    [(1.02, True, "same tyre"), (9.0, False, "the runs differ"), (np.nan, True, "is unknown")],
)
def test_the_verdict_on_the_reference_stands_in_the_alternative(tyre, ratio, consistent, words):
    check = replace(tyre.reference, ratio=ratio, consistent=consistent)
    assert words in measurement.reference_chart(check).alternative


def test_drive_point_is_the_row_at_the_force(tyre):
    assert measurement.drive_point_row(tyre.frf, 0.0) == 0
    assert measurement.drive_point_row(tyre.frf, 359.0) == 0
    assert measurement.drive_point_row(tyre.frf, None) is None
    away = tyre.frf.rows(np.arange(10, 30))
    assert measurement.drive_point_row(away, 0.0) is None
    assert measurement.drive_point_row(structure_result().frf, 0.0) is None


def test_a_drive_point_of_the_wrong_sign_shows(tyre):
    band_hz = (70.0, 230.0)  # well above the noise
    right = measurement.share_taken_out(tyre.frf, 0, band_hz)
    turned = replace(tyre.frf, values=-tyre.frf.values)
    wrong = measurement.share_taken_out(turned, 0, band_hz)
    assert right < 0.05
    assert wrong > 0.9
    finding = Finding("", "force", 0.0, Check.DRIVE_POINT, Verdict.WARNING, "wrong sign")
    chart = measurement.drive_point_chart(turned, 0, band_hz, finding)
    assert "Verdict: warning, wrong sign." in chart.caption
    lines = (turned.frequency_hz >= 70) & (turned.frequency_hz <= 230)
    np.testing.assert_allclose(
        unpacked(chart.data[0]["y"]), np.abs(turned.values[0, lines]), rtol=1e-5
    )


def test_scatter_and_deviation_have_bars_of_two_standard_deviations(tyre, charts):
    found = tyre.validation
    points = charts["frequency-scatter"].data[-1]
    np.testing.assert_allclose(unpacked(points["x"]), found.measured_hz, rtol=1e-6)
    np.testing.assert_allclose(unpacked(points["y"]), found.model_hz, rtol=1e-6)
    np.testing.assert_allclose(points["error_x"]["array"], 0.0004 * found.measured_hz)
    bars = charts["frequency-deviation"].data[-1]
    np.testing.assert_allclose(unpacked(bars["y"]), found.error_percent, rtol=1e-5)
    np.testing.assert_allclose(bars["error_y"]["array"], 0.04)


def test_an_unknown_uncertainty_has_no_bar(tyre):
    unknown = np.full(7, np.nan)
    for chart in (
        ring.scatter_chart(tyre.validation, unknown),
        ring.deviation_chart(tyre.validation, unknown),
        ring.damping_chart(tyre.validation, unknown),
    ):
        json.dumps({"data": chart.data, "layout": chart.layout}, allow_nan=False)
        chart.draw()


def test_dispersion_shows_the_ring_beyond_the_measured_orders(tyre, charts):
    ring, measured = charts["dispersion"].data
    assert ring["x"] == list(range(1, 10))
    expected = natural_frequencies_hz(tyre.tuning.ring, np.arange(1, 10))
    np.testing.assert_allclose(unpacked(ring["y"]), expected, rtol=1e-6)
    np.testing.assert_allclose(unpacked(measured["y"]), tyre.validation.measured_hz, rtol=1e-6)


def test_damping_is_in_percent_and_names_the_largest_difference(tyre, charts):
    chart, found = charts["damping"], tyre.validation
    np.testing.assert_allclose(
        unpacked(chart.data[1]["y"]), 100 * found.measured_damping, rtol=1e-6
    )
    worst = int(np.argmax(np.abs(found.model_damping / found.measured_damping - 1)))
    assert f"at n = {found.order[worst]}" in chart.alternative


def test_mac_keeps_rows_and_columns_apart():
    chart = modes.matrix_chart(
        [[1.0, 0.25, 0.0], [0.5, 0.98, 0.1]],
        ["<1>", "2"],
        ["a", "b", "c"],
        name="some",
        titles=("measured", "model"),
        alternative="Some.",
        caption="Look.",
    )
    trace = chart.data[0]
    np.testing.assert_allclose(unpacked(trace["z"]), [[1, 0.25, 0], [0.5, 0.98, 0.1]], rtol=1e-6)
    assert trace["y"] == ["&lt;1&gt;", "2"]
    assert trace["text"][0] == ["1.00", "0.25", "0.00"]
    assert chart.layout["xaxis"]["title"]["text"] == "model"


def test_sensitivity_names_the_parameters_that_move_nothing(tyre, charts):
    found = tyre.tuning.sensitivity
    trace = charts["sensitivity"].data[0]
    np.testing.assert_allclose(unpacked(trace["z"]), found.values, rtol=1e-5, atol=1e-9)
    assert trace["zmin"] == -trace["zmax"]
    largest = np.abs(found.values).max(axis=0)
    weak = [name for name, size in zip(found.parameters, largest, strict=True) if size < 0.02]
    assert ("hardly move" in charts["sensitivity"].alternative) == bool(weak)


def test_correlation_names_the_strongest_pair(tyre):
    found = replace(
        tyre.tuning.correlation,
        parameters=("a", "b", "c"),
        values=np.array([[1, 0.2, -0.9], [0.2, 1, 0.1], [-0.9, 0.1, 1]]),
    )
    chart = ring.correlation_chart(found, {"a": "A", "b": "B", "c": "C"})
    assert "the strongest is A with C, −0.90" in chart.alternative
    assert chart.data[0]["text"][0] == ["+1.00", "+0.20", "−0.90"]


def test_exclusions_stand_apart_with_their_reasons(tyre):
    findings = (
        Finding("run_1", "A01", 0.0, Check.LEVEL, Verdict.EXCLUDED, "no signal"),
        Finding("run_2", "A02", 5.0, Check.HUM, Verdict.WARNING, "50 Hz line"),
        Finding("run_2", "A03", 10.0, Check.LEVEL, Verdict.OK, "as expected"),
    )
    section = next(
        each
        for each in report_sections(replace(tyre, findings=findings))
        if each.anchor == "quality"
    )
    tables = {block.caption: block.rows for block in section.blocks if isinstance(block, Table)}
    assert tables["Channels and runs excluded, and why (1)"][0][-1] == "no signal"
    assert tables["Warnings on the data (1)"][0][-1] == "50 Hz line"
    assert tables["Checks passed (1)"][0][-1] == "as expected"


def test_the_report_says_what_is_not_identified(tyre):
    how = dict.fromkeys(tyre.tuning.how, "identified")

    def words(changed):
        section = next(
            each
            for each in report_sections(replace(tyre, tuning=replace(tyre.tuning, how=changed)))
            if each.anchor == "parameters"
        )
        return [block.text for block in section.blocks if isinstance(block, Paragraph)]

    assert "Every parameter to be identified is identified." in words(how)
    missing = how | {"bending_stiffness_n_m": "not identified", "mass_per_area_kg_m2": "at bound"}
    found = next(text for text in words(missing) if text.startswith("Not identified: b"))
    assert "bending stiffness" in found
    assert "At bound: mass per area" in found


def test_a_structure_gets_what_can_be_shown():
    assert [chart.name for chart in charts_of(structure_result())] == ["stability"]


def batch_of(n_tyres):
    """One campaign of three modes a tyre, and one that failed."""
    row = dict.fromkeys(MODES)
    modes = [tuple((row | {"order": n, "frequency_hz": 80.0 + 20 * n}).values()) for n in (1, 2)]
    modes.append(tuple((row | {"frequency_hz": 230.0}).values()))
    mark = Fingerprint("0", ())
    done = [
        Record(f"run <{k}>", DONE, mark, designation=f"tyre {k:02d}", modes=tuple(modes))
        for k in range(n_tyres)
    ]
    return [*done, Record("broken", FAILED, mark)]


def test_a_batch_shows_every_mode_with_an_order_and_its_campaign():
    chart = charts_batch.frequencies_chart(batch_of(3))
    assert [trace["name"] for trace in chart.data] == ["tyre 00", "tyre 01", "tyre 02"]
    for k, trace in enumerate(chart.data):
        np.testing.assert_allclose(unpacked(trace["y"]), [100.0, 120.0])
        np.testing.assert_array_equal(np.round(unpacked(trace["x"])), trace["customdata"])
        assert trace["text"] == [f"run &lt;{k}&gt;, tyre {k:02d}"] * 2
    assert "6 modes" in chart.alternative
    assert chart.draw().axes


def test_more_tyres_than_colours_share_the_last_and_one_entry_of_the_legend():
    data = charts_batch.frequencies_chart(batch_of(12)).data
    listed = [trace["name"] for trace in data if trace["showlegend"]]
    assert listed == [*(f"tyre {k:02d}" for k in range(6)), "others"]
    said = {text.rpartition(", ")[2] for trace in data for text in trace["text"]}
    assert said == {f"tyre {k:02d}" for k in range(12)}
