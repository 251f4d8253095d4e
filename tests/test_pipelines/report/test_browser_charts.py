"""Charts as a browser shows them: drawn in time, zoomed, read off, in the colours of the page."""

from __future__ import annotations

import numpy as np
import pytest
from browser import contrast, luminance

from pipelines.plots.chart import Chart
from pipelines.plots.plot import FITTED, MEASURED, Axis, Curve, Map, Panel, Plot
from pipelines.report.page import Paragraph, Section
from pipelines.report.write import render_page

DRAWN = """
return [...document.querySelectorAll('.plot')].filter(plot =>
  plot.querySelector('svg.main-svg') && plot.querySelector('.trace, .hm, .contour, .bars')
).map(plot => plot.id.replace('chart-', ''))"""
STROKE = "#chart-curve .scatterlayer .trace .js-line"
RANGE = "return document.getElementById('chart-curve').layout.xaxis.range"


def chart(name, *series):
    panel = Panel(series, Axis("frequency / Hz"), Axis("m"))
    return Chart(name, Plot((panel,)), f"The {name}.", "Look here.", wide=True)


@pytest.fixture(scope="session")
def charts_file(tmp_path_factory):
    """A page of a curve and a map, and of a chart far below that nobody has scrolled to."""
    x, y = np.array([20.0, 100.0, 180.0]), np.array([1.0, 7.25, 3.0])
    line = Curve(x, y, MEASURED, width=2)
    marks = Curve(x, y, FITTED, marker="circle", size=9, hover="%{x:.1f} Hz: %{y:.2f} m")
    grid = Map(np.array([[0.0, 1.0], [2.0, 3.0]]), 0, 3, "share", "")
    curve = (line, marks)
    blocks = (
        chart("curve", *curve),
        chart("map", grid),
        *(Paragraph("Far below.") for _ in range(200)),
        chart("far", *curve),
    )
    page = render_page("Charts", "Charts", (Section("charts", "Charts", blocks),))
    path = tmp_path_factory.mktemp("charts") / "charts.html"
    path.write_text(page, encoding="utf-8")
    return path


@pytest.fixture
def charts(browser, charts_file):
    with browser.watched():
        browser.show()
        browser.open(charts_file)
        yield browser


def stroke(browser):
    return browser.style(STROKE, "stroke")


def test_charts_are_drawn_when_they_come_near(charts):
    assert set(charts.js(DRAWN)) == {"curve", "map"}
    assert set(charts.js("return window.ringmodalCharts")) == {"curve", "map"}
    charts.js("document.getElementById('chart-far').scrollIntoView()")
    charts.wait("return window.ringmodalCharts.includes('far')")
    assert set(charts.js(DRAWN)) == {"curve", "map", "far"}


def test_every_chart_of_the_report_is_drawn(page):
    names = [each.removeprefix("chart-") for each in page.ids(".plot")]
    assert "stability" in names
    page.unfold()
    assert sorted(page.js(DRAWN)) == sorted(names)


def test_dragging_zooms_and_a_double_click_returns(charts):
    low, high = charts.js(RANGE)
    area = charts.find("#chart-curve .nsewdrag")
    charts.pointer().move_to_element_with_offset(area, -200, -50).click_and_hold().move_by_offset(
        200, 100
    ).release().perform()
    charts.wait(
        f"const [low, high] = (() => {{{RANGE}}})(); return high - low < {0.5 * (high - low)}"
    )
    charts.pointer().move_to_element(area).double_click().perform()
    charts.wait(
        f"const [low, high] = (() => {{{RANGE}}})(); return high - low > {0.9 * (high - low)}"
    )


def test_pointing_at_a_chart_shows_its_value(charts):
    second_point = charts.find_all("#chart-curve .point")[1]
    charts.pointer().move_to_element(second_point).perform()
    shown = charts.wait("return document.querySelector('#chart-curve .hoverlayer')?.textContent")
    assert "100.0 Hz: 7.25 m" in shown


def test_charts_follow_light_and_dark(charts):
    light = stroke(charts)
    charts.show(scheme="dark")
    dark = stroke(charts)
    assert light != dark
    assert contrast(dark, charts.style("body", "backgroundColor")) >= 3.0
    charts.show(scheme="light")
    assert stroke(charts) == light
    assert contrast(light, charts.style("body", "backgroundColor")) >= 3.0


def test_charts_print_in_light_colours_whatever_the_screen(charts):
    light = stroke(charts)
    charts.show(scheme="dark")
    dark = stroke(charts)
    charts.show(scheme="dark", media="print")
    assert stroke(charts) == light
    assert luminance(charts.style("#chart-curve .xtitle", "fill")) < 0.1
    charts.show(scheme="dark")
    assert stroke(charts) == dark


def test_charts_nobody_has_scrolled_to_are_printed_too(charts):
    charts.js(
        "addEventListener('beforeprint', () => { window.printed = [...document.querySelectorAll("
        "'svg.main-svg')].map(each => each.getBoundingClientRect().width); });"
    )
    before = charts.js("return document.querySelector('#chart-curve svg').clientWidth")
    charts.pdf()
    assert set(charts.js(DRAWN)) == {"curve", "map", "far"}
    assert 0 < max(charts.js("return window.printed")) <= 681
    charts.settle()
    assert charts.js("return document.querySelector('#chart-curve svg').clientWidth") == before


def test_charts_fit_a_narrow_page_again(charts):
    charts.show(width=400)
    charts.wait("return document.querySelector('#chart-curve svg').clientWidth <= 400")
    assert charts.js("return document.scrollingElement.scrollWidth") <= 400
