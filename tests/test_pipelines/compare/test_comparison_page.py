"""Summary text, rows, records and page of a comparison."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from results import structure_result, tyre_result

from ema.core.campaign import Tyre
from ema.core.display import jsonable
from ema.core.errors import InputError
from pipelines.compare.compare import compare
from pipelines.compare.significance import Difference, Scatter, jointly_tested
from pipelines.compare.summary import (
    COMPARISON_HEAD,
    MODE_HEAD,
    PARAMETER_HEAD,
    comparison_record,
    comparison_rows,
    damping_rows,
    findings,
    frequency_rows,
    movement,
    parameter_rows,
    scatter_text,
)
from pipelines.plots.chart import Chart
from pipelines.report.comparison import (
    comparison_sections,
    render_comparison,
    result_names,
    several_sections,
    write_comparison,
    write_comparisons,
)
from pipelines.results.options import Units

HOSTILE = '<script>alert("x")</script>' + "long" * 2500


def moved(result, percent, **changes):
    """The result with each frequency moved by its own percentage."""
    modes = tuple(
        replace(mode, pole=mode.pole * (1 + each / 100))
        for mode, each in zip(result.modal_model.modes, percent, strict=True)
    )
    model = replace(result.modal_model, modes=modes)
    return replace(result, modal_model=model, provenance={}, **changes)


@pytest.fixture(scope="module")
def rising():
    first = tyre_result(name="2.2 bar", provenance={})
    harder = Tyre("225/55R17", 2.4e5, 0.33, 0.19, {"serial": "none, synthetic"})
    return compare(first, moved(first, np.linspace(2, 3.5, 7), name="2.4 bar", tyre=harder))


@pytest.fixture(scope="module")
def page(rising):
    return render_comparison(rising)


# Sentences


def sentence(*changes, std=0.1):
    named = [(f"n = {n}", Difference(100.0, 100.0 + each, std)) for n, each in enumerate(changes)]
    verdicts = jointly_tested([difference for _, difference in named])
    pairs = [(name, verdict) for (name, _), verdict in zip(named, verdicts, strict=True)]
    return movement("frequency", "frequencies", pairs)[0]


def test_all_frequencies_are_mentioned_only_if_all_change():
    assert sentence(3.1, 4.4, 3.7) == "All 3 frequencies rise significantly, by 3.1 to 4.4 %."
    assert sentence(-3.1, -4.4) == "Both frequencies fall significantly, by 3.1 to 4.4 %."
    assert sentence(3.1, 4.4, 0.05) == (
        "Of 3 frequencies, 2 rise significantly, by 3.1 to 4.4 % (n = 0, n = 1); "
        "1 shows no significant change (n = 2)."
    )
    assert sentence(3.1, -4.4, 0.0, 0.1) == (
        "Of 4 frequencies, 1 rises significantly, by 3.1 % (n = 0); "
        "1 falls significantly, by 4.4 % (n = 1); 2 show no significant change (n = 2, n = 3)."
    )


def test_without_significant_change_the_largest_is_given():
    assert sentence(0.05, -0.12) == (
        "No frequency differs significantly; the largest difference is −0.12 ± 0.10 % (n = 1)."
    )
    assert sentence(1.0, 2.0, std=np.nan) == "No frequency could be tested."


def test_scatter_is_classified_by_its_p_value():
    assert "noise alone explains" in scatter_text(Scatter(8, 7.0, 0.1))
    assert "conservative" in scatter_text(Scatter(8, 1.0, 0.1))
    assert "besides noise" in scatter_text(Scatter(8, 80.0, 0.1))


def test_findings_of_more_pressure(rising):
    text = "\n".join(findings(rising))
    assert "All 7 frequencies rise significantly, by 2.00 to 3.50 %." in text
    assert "No damping ratio differs significantly" in text
    assert "Inflation pressure from 2.2 bar to 2.4 bar" in text
    assert "Same tyre" not in text


def test_a_common_shift_of_the_same_tyre_points_to_one_cause():
    first = tyre_result(provenance={})
    text = "\n".join(findings(compare(first, moved(first, [0.3] * 7))))
    assert "Same tyre and conditions as far as stated." in text
    assert "All frequencies together shift by 0.300 ± 0.011 %" in text


def test_a_result_against_itself_is_no_repeat():
    text = "\n".join(findings(compare(tyre_result(), tyre_result())))
    assert "error bars" not in text


# Rows and records


def test_rows_fit_their_heads(rising):
    for head, rows in (
        (COMPARISON_HEAD, comparison_rows(rising)),
        (MODE_HEAD, frequency_rows(rising)),
        (MODE_HEAD, damping_rows(rising)),
        (PARAMETER_HEAD, parameter_rows(rising)),
    ):
        assert rows
        assert {len(row) for row in rows} == {len(head)}
    assert frequency_rows(rising)[0][4] == "+2.000 ± 0.028"
    assert damping_rows(rising)[0][1] == "4.12 ± 0.04"


@pytest.mark.parametrize(
    ("units", "pressure", "radius"),
    [(Units.LAB, ("2.2 bar", "2.4 bar"), "330"), (Units.SI, ("220 kPa", "240 kPa"), "0.33")],
)
def test_units_are_those_asked_for(rising, units, pressure, radius):
    found = compare(rising.first, rising.second, units)
    stated = {each.name: (each.first, each.second) for each in found.conditions}
    assert stated["Inflation pressure"] == pressure
    rows = {row[0]: row for row in parameter_rows(found)}
    assert rows["mean radius"][1:3] == ("mm" if units is Units.LAB else "m", radius)


def test_the_record_is_json_with_everything_found(rising):
    record = json.loads(json.dumps(jsonable(comparison_record(rising)), allow_nan=False))
    first = record["modes"][0]
    assert first["frequency_hz"]["percent"] == pytest.approx(2.0)
    assert first["frequency_hz"]["status"] == "significant"
    assert first["damping_ratio"]["status"] == "not significant"
    assert len(record["mac"]) == 7
    assert record["agreement"]["frequency"]["freedom"] == 7
    assert record["repeat"] is False
    stated = {each["name"]: each for each in record["conditions"]}
    assert stated["Inflation pressure"] == {
        "name": "Inflation pressure",
        "first": "2.2 bar",
        "second": "2.4 bar",
        "differs": True,
    }


# The page


def test_the_page_has_every_section(page):
    for anchor in (
        "summary",
        "compared",
        "frequencies",
        "damping",
        "shapes",
        "responses",
        "parameters",
        "method",
    ):
        assert f'<section id="{anchor}"' in page


def test_charts_show_the_numbers_and_are_drawn_for_paper(rising):
    charts = {
        block.name: block
        for section in comparison_sections(rising)
        for block in section.blocks
        if isinstance(block, Chart)
    }
    assert charts.keys() == {"frequency-change", "damping-change", "mac-between", "frf-0", "frf-20"}
    (trace,) = charts["frequency-change"].data
    assert trace["error_y"]["array"] == pytest.approx([2 * 0.0283] * 7, abs=2e-3)
    for chart in charts.values():
        assert chart.alternative
        assert chart.caption
        assert "#" not in json.dumps({"data": chart.data, "layout": chart.layout})
    for name in ("frequency-change", "frf-0"):
        figure = charts[name].draw()
        assert any(axis.lines for axis in figure.axes)


def test_modes_of_one_name_keep_their_places():
    first = tyre_result()
    modes = tuple(replace(mode, order=3) for mode in first.modal_model.modes)
    alike = replace(first, modal_model=replace(first.modal_model, modes=modes))
    (section,) = (s for s in comparison_sections(compare(alike, alike)) if s.anchor == "shapes")
    (trace,) = section.blocks[0].data
    assert trace["x"] == ["n = 3", *(f"n = 3 ({k})" for k in range(2, 8))]


def test_hostile_texts_are_texts():
    first = tyre_result(name=HOSTILE, tyre=Tyre(HOSTILE, 2.2e5, 0.33, 0.19, {"rim": HOSTILE}))
    second = tyre_result(name=HOSTILE, tyre=Tyre("225", 2.2e5, 0.33, 0.19, {"boundary": HOSTILE}))
    page = render_comparison(compare(first, second))
    assert "<script>alert" not in page


def test_a_structure_has_a_page_without_ring_and_charts_of_positions():
    page = render_comparison(compare(structure_result(), structure_result(seed=2)))
    assert "there is nothing to compare" in page
    assert 'id="responses"' not in page


def test_results_without_a_common_mode_have_a_page():
    first = tyre_result()
    none = replace(
        first.modal_model, modes=first.modal_model.modes[:0], covariance=np.zeros((0, 0))
    )
    page = render_comparison(compare(first, replace(first, modal_model=none)))
    assert "No mode of one result was found in the other." in page


def test_several_results_are_compared_with_the_first_on_one_page(rising, tmp_path):
    gone = rising.second.modal_model
    gone = replace(gone, modes=gone.modes[:-1], covariance=gone.covariance[:-2, :-2])
    fewer = compare(rising.first, replace(rising.second, name="2.6 bar", modal_model=gone))
    assert result_names([rising, fewer]) == ["2.2 bar", "2.4 bar", "2.6 bar"]
    sections = {each.anchor: each for each in several_sections([rising, fewer])}
    chart, table, _ = sections["frequency"].blocks
    assert [trace["name"] for trace in chart.data] == ["2.4 bar", "2.6 bar"]
    assert len(table.rows) == 7
    assert table.rows[-1][2].endswith("*")
    assert table.rows[-1][3] == "–"
    page = write_comparisons([rising, fewer], tmp_path / "page.html").read_text(encoding="utf-8")
    assert "2.6 bar against 2.2 bar:" in page
    assert "Comparison of 3 results" in page
    with pytest.raises(InputError, match="exists"):
        write_comparisons([rising, fewer], tmp_path / "page.html")


def test_a_page_is_replaced_only_with_force(rising, tmp_path):
    path = write_comparison(rising, tmp_path / "comparison.html")
    before = path.read_text(encoding="utf-8")
    with pytest.raises(InputError, match="exists already"):
        write_comparison(rising, path)
    assert write_comparison(rising, path, force=True).read_text(encoding="utf-8") == before


def test_a_page_in_a_missing_folder_is_refused(rising, tmp_path):
    with pytest.raises(InputError, match="nowhere"):
        write_comparison(rising, tmp_path / "nowhere" / "comparison.html")
