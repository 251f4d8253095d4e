"""The report as a browser shows it: widths, colours, print, texts from files, accessibility."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from itertools import pairwise

import pytest
from browser import contrast, demand, hosts, luminance
from results import tyre_result

from ema.core.campaign import Tyre
from ema.core.finding import Check, Finding, Verdict
from pipelines.report.write import write_report

LARGEST_BYTES = 6_000_000
WIDTHS_PX = (360, 400, 1000, 1300)
SCHEMES = ("light", "dark")
TURNING = "\u202e"  # what follows it would be read from right to left, numbers too
HOSTILE = (
    "</script><script>alert(1)</script><img src=x onerror=alert(2)>\"'`&amp;{{ 7 }} "
    f"\u05d0\u05d1\u05d2 {TURNING}1.25"
)
SHOWN = HOSTILE.replace(TURNING, "[U+202E]")
ENDLESS = "W" * 10_000
LEAST_CONTRAST = 4.5  # WCAG 2, AA
PRINTED_WIDTH_PX, PRINTED_HEIGHT_PX = 680, 1001  # A4 within its margins: 180 by 265 mm at 96 dpi
A4_HEIGHT_PT = 842
LEAST_FILLED = 0.6  # of a printed page, from above
NAMED_ROLES = {"link", "button", "combobox", "slider", "checkbox", "image", "region"}
FIGURE_EDGES = """
return [...document.querySelectorAll('figure, main svg, img, table')].map(each => {
  const box = each.getBoundingClientRect();
  return [each.tagName + ' ' + (each.id || each.textContent.trim().slice(0, 60)), box.right,
          each.tagName === 'TABLE' ? 0 : box.height];
})"""
# Every text one sees, with its colour and that of the nearest painted ancestor.
INKS = """
const clear = 'rgba(0, 0, 0, 0)', found = [];
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
while (walker.nextNode()) {
  const text = walker.currentNode.textContent.trim(), home = walker.currentNode.parentElement;
  const seen = home.checkVisibility({opacityProperty: true, visibilityProperty: true});
  if (!text || !seen || home.closest('.heatmap-label')) continue;
  const drawn = home.closest('svg') !== null, style = getComputedStyle(home);
  let behind = home;
  const bare = element => element && getComputedStyle(element).backgroundColor === clear;
  while (bare(behind)) behind = behind.parentElement;
  found.push([text.slice(0, 40), drawn ? style.fill : style.color,
              behind ? getComputedStyle(behind).backgroundColor : 'rgb(255, 255, 255)']);
}
return found"""
# The same of values in the cells of matrices, which are painted as one image behind them.
CELL_INKS = """
const done = arguments[0];
async function cells(matrix) {
  const image = matrix.querySelector('image'), box = image.getBoundingClientRect();
  const painted = new Image(), canvas = document.createElement('canvas');
  painted.src = image.getAttribute('href') ?? image.getAttribute('xlink:href');
  await painted.decode();
  [canvas.width, canvas.height] = [painted.width, painted.height];
  const pen = canvas.getContext('2d');
  pen.drawImage(painted, 0, 0);
  const {data} = pen.getImageData(0, 0, painted.width, painted.height);
  return [...matrix.querySelectorAll('.heatmap-label text')].map(text => {
    const {left, right, top, bottom} = text.getBoundingClientRect();
    const x = Math.floor(((left + right) / 2 - box.left) / box.width * painted.width);
    const y = Math.floor(((top + bottom) / 2 - box.top) / box.height * painted.height);
    const at = 4 * (y * painted.width + x);
    return [text.textContent, getComputedStyle(text).fill, `rgb(${data.slice(at, at + 3)})`];
  });
}
Promise.all([...document.querySelectorAll('.hm')].map(cells)).then(found => done(found.flat()))"""


# Pairs of texts, controls, legends and toolbars of which one lies on the other.
OVERLAPS = """
const what = 'h1,h2,p,li,caption,th,td,dt,dd,label,button,select,figcaption,summary,'
  + '.legend,.modebar,.infolayer text,.stage canvas,.stage svg';
const boxes = [...document.querySelectorAll(what)]
  .filter(e => e.checkVisibility({visibilityProperty: true}) && !e.closest('.said, .skip, .traces'))
  .map(e => [e, e.getBoundingClientRect()]).filter(([, box]) => box.width > 2 && box.height > 2)
  .sort(([, a], [, b]) => a.top - b.top);
const found = [], named = e => `${e.tagName} ${e.textContent.trim().slice(0, 40)}`;
boxes.forEach(([a, p], i) => {
  for (const [b, q] of boxes.slice(i + 1)) {
    if (q.top >= p.bottom) break;
    const across = Math.min(p.right, q.right) - Math.max(p.left, q.left);
    const up = Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top);
    // What scrolls by itself may reach under its neighbours; there it is hidden.
    const same = a.closest('.scroll') === b.closest('.scroll');
    if (across > 2 && up > 2 && same && !a.contains(b) && !b.contains(a))
      found.push([named(a), named(b)]);
  }
});
return found"""
SCROLLING = """
return [...document.querySelectorAll('.scroll')]
  .filter(e => e.checkVisibility() && e.scrollWidth > e.clientWidth + 1)
  .map(e => e.getAttribute('aria-label'))"""


@pytest.fixture(scope="session")
def hostile_report(tmp_path_factory):
    """A report whose tyre, details, channels, files and notes hold hostile texts."""
    tyre = Tyre(HOSTILE, 2.2e5, 0.33, 0.19, {"serial": HOSTILE, HOSTILE: "x", "note": ENDLESS})
    findings = (
        Finding(HOSTILE, HOSTILE, 0.0, Check.COHERENCE, Verdict.WARNING, HOSTILE),
        Finding(ENDLESS, ENDLESS, 5.0, Check.HUM, Verdict.WARNING, ENDLESS),
    )
    result = tyre_result(name=HOSTILE, tyre=tyre, findings=findings, notes=(HOSTILE, ENDLESS))
    names = (HOSTILE, ENDLESS, *result.frf.run[2:])
    result = replace(result, frf=replace(result.frf, run=names, channel=names))
    return write_report(result, tmp_path_factory.mktemp("hostile") / "report.html")


# --- the page as a whole


@pytest.fixture(scope="session")
def sample_report(sample_folder):
    return sample_folder / "report.html"


def test_page_is_one_small_file(sample_report):
    assert sample_report.stat().st_size <= LARGEST_BYTES


def test_page_asks_no_host_and_complains_of_nothing(browser, sample_report):
    browser.show()
    browser.requests()
    browser.open(sample_report)
    asked = browser.requests()
    assert sample_report.as_uri() in asked
    assert hosts(asked) == []
    assert browser.complaints() == []


def test_log_sees_requests_and_complaints(browser, tmp_path):
    bad = tmp_path / "bad.html"
    bad.write_text("<img src='http://127.0.0.1:9/x.png'><script>missing()</script>")
    browser.open(bad)
    assert hosts(browser.requests()) == ["http://127.0.0.1:9/x.png"]
    assert any("missing is not defined" in each for each in browser.complaints())


@pytest.mark.parametrize("scheme", SCHEMES)
def test_nothing_reaches_beyond_the_sides(page, scheme):
    for width in WIDTHS_PX:
        page.show(width=width, scheme=scheme)
        assert page.js("return document.scrollingElement.scrollWidth") <= width


@pytest.mark.parametrize("width", WIDTHS_PX)
def test_nothing_overlaps_and_tables_fit(page, width):
    page.show(width=width)
    page.unfold()
    assert page.js(OVERLAPS) == []
    if width >= 1000:
        assert page.js(SCROLLING) == []


def test_first_screen_shows_verdict_findings_modes_and_parameters(page):
    page.show(width=1300)
    page.js("window.scrollTo(0, 0)")
    parts = "#summary .lamp, #summary .findings li, #summary table"
    boxes = page.js(
        "return [...document.querySelectorAll(arguments[0])]"
        ".map(e => [e.tagName, e.getBoundingClientRect().bottom])",
        parts,
    )
    assert [name for name, _ in boxes].count("TABLE") == 2
    assert {name for name, _ in boxes} == {"P", "LI", "TABLE"}
    assert max(bottom for _, bottom in boxes) <= 900


def test_headings_come_in_order(page):
    levels = page.js(
        "return [...document.querySelectorAll('h1,h2,h3,h4,h5,h6')].map(h => +h.tagName[1])"
    )
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))


def test_contents_lead_to_every_section(page):
    targets = page.js("return [...document.querySelectorAll('nav a')].map(a => a.hash)")
    assert targets == [f"#{each}" for each in page.ids("main section")]


def test_dark_scheme_turns_the_page_dark(page):
    light = page.style("body", "backgroundColor"), page.style("body", "color")
    page.show(scheme="dark")
    dark = page.style("body", "backgroundColor"), page.style("body", "color")
    assert luminance(light[0]) > 0.8 > 0.2 > luminance(dark[0])
    assert luminance(light[1]) < 0.2 < 0.6 < luminance(dark[1])


# --- in print


def test_print_view_is_light_and_without_navigation(page):
    page.show(scheme="dark", media="print")
    assert page.style("nav", "display") == "none"
    assert luminance(page.style("body", "color")) < 0.05
    assert luminance(page.style("body", "backgroundColor")) > 0.9


def test_print_view_cuts_no_figure(page):
    page.show(width=PRINTED_WIDTH_PX, media="print")
    page.unfold()
    for name, right, height in page.js(FIGURE_EDGES):
        assert right <= PRINTED_WIDTH_PX + 1, name
        assert height <= PRINTED_HEIGHT_PX, name


def test_pages_print_on_a4(page):
    printed = page.pdf()
    boxes = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", printed)
    assert len(boxes) > 2
    assert {(round(float(width)), round(float(height))) for width, height in boxes} == {(595, 842)}


def test_no_printed_page_but_the_last_is_half_empty(new_page, tmp_path):
    demand(shutil.which("pdftotext"), "pdftotext of poppler")
    printed = tmp_path / "printed.pdf"
    printed.write_bytes(new_page.pdf())
    command = ["pdftotext", "-bbox", printed, "-"]
    found = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    pages = found.split("<page ")[1:]
    lowest = [max(map(float, re.findall(r'yMax="([\d.]+)', each))) for each in pages]
    assert len(lowest) > 2
    assert min(lowest[:-1]) > LEAST_FILLED * A4_HEIGHT_PT


# --- for everybody


@pytest.mark.parametrize("width", [400, 1200])
def test_axe_finds_nothing_serious(page, width):
    page.show(width=width)
    page.unfold()
    assert page.violations() == []
    if width == 1200:  # colours do not depend on the width
        page.show(width=width, scheme="dark")
        assert page.violations("color-contrast") == []


@pytest.mark.parametrize("scheme", SCHEMES)
def test_texts_stand_out_from_what_is_behind_them(page, scheme):
    page.show(scheme=scheme)
    page.unfold()
    inks, in_cells = page.js(INKS), page.js_later(CELL_INKS)
    assert len(inks) > 100
    assert len(in_cells) > 10
    faint = [each for each in inks + in_cells if contrast(each[1], each[2]) < LEAST_CONTRAST]
    assert faint == []


def test_everything_that_can_be_worked_or_seen_has_a_name(page):
    page.unfold()
    nodes = [
        node for node in page.cdp("Accessibility.getFullAXTree")["nodes"] if not node["ignored"]
    ]
    named = [(node["role"]["value"], node.get("name", {}).get("value", "")) for node in nodes]
    watched = [(role, name) for role, name in named if role in NAMED_ROLES]
    assert {role for role, _ in watched} >= {"link", "image"}
    assert [role for role, name in watched if not name.strip()] == []


# --- texts from files


def test_hostile_texts_appear_as_text(browser, hostile_report):
    with browser.watched():
        browser.show()
        browser.open(hostile_report)
        browser.unfold()
        assert browser.texts("h1") == [SHOWN]
        assert browser.texts("dd").count(SHOWN) >= 2
        assert {SHOWN, ENDLESS} <= set(browser.texts("td"))
        assert {SHOWN, ENDLESS} <= set(browser.texts("#notes li"))
        assert ENDLESS in browser.texts("dd")
        assert "</script>" in browser.texts("#frf option")[0]
        assert not any(TURNING in text for text in browser.texts("body, title"))
        assert browser.js("return document.querySelector('[onerror]')") is None
        assert not any(text.startswith("alert") for text in browser.texts("script"))
        for width in WIDTHS_PX:
            browser.show(width=width)
            assert browser.js("return document.scrollingElement.scrollWidth") <= width
