"""Results in a notebook: what they show of themselves, and the notebook that walks the sample."""

from __future__ import annotations

import re
from copy import deepcopy
from dataclasses import replace
from html.parser import HTMLParser
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from results import structure_result, tyre_result

import ema
import ema.core.display
import model.display
from ema.core.campaign import Campaign, Tyre
from ema.core.finding import Finding
from pipelines.report.write import render_report

NUMBER = re.compile(r"\d+(?:\.\d+)?")
ROOT = Path(__file__).parents[3]
SAMPLE = ROOT / "sample_data" / "tyre_225_55R17"
TAGS = {
    "table",
    "caption",
    "thead",
    "tbody",
    "tr",
    "th",
    "td",
    "figure",
    "figcaption",
    "svg",
    "path",
}
DRAWING = re.compile("<figure.*?</figure>", re.DOTALL)
HOSTILE = "<script>alert('x')</script>"


class Cells(HTMLParser):
    """Texts of all cells and captions, and whether every tag that opens also closes."""

    def __init__(self, html):
        super().__init__()
        self.open, self.texts = [], []
        self.feed(html)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        assert tag in TAGS
        self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


def shown(thing):
    return Cells(thing._repr_html_()).texts


@pytest.fixture(scope="module")
def result():
    return tyre_result()


@given(
    st.floats(-1e12, 1e12) | st.sampled_from([nan, inf]),
    st.floats(1e-9, 1e9) | st.sampled_from([nan, 0.0]),
)
def test_numbers_are_rounded_as_in_the_report(value, std):
    written = {show.value_with_std(value, std) for show in (ema.core.display, model.display)}
    assert written == {ema.core.display.value_with_std(value, std)}


def test_a_result_shows_modes_ring_and_warnings(result):
    texts = shown(result)
    assert "identified" in texts
    assert "k_θ" in texts
    assert "N/m³" in texts
    mode = result.modal_model.modes[0]
    assert ema.core.display.value_with_std(mode.frequency_hz, mode.frequency_std_hz) in texts
    assert next(f.detail for f in result.findings if f.verdict != "ok") in texts
    assert result.notes[0] in texts


def test_a_structure_without_ring_shows_its_modes():
    texts = shown(structure_result())
    assert "frequency / Hz" in texts
    assert "N/m³" not in texts


def test_every_stage_shows_itself_in_one_line_and_as_tables(result):
    parts = (result, result.frf, result.diagram, result.modal_model, result.tuning)
    for part in (*parts, result.modal_model.modes[0]):
        line = repr(part)
        assert "\n" not in line
        assert "array" not in line
        assert type(part).__name__ in line
    for part in (*parts, result.tuning.ring):
        assert shown(part)


def test_units_stand_beside_numbers(result):
    assert "frequency / Hz" in shown(result.modal_model)
    assert "damping / %" in shown(result.diagram)
    assert "FRFs: inertance in (m/s²)/N" in shown(result.frf)
    assert "Pa" in shown(result.tuning.ring)


def test_a_cluster_beyond_the_band_is_no_mode(result):
    narrow = replace(result.diagram, band_hz=(90.0, 250.0))
    below = sum(cluster.frequency_hz < 90 for cluster in narrow.clusters)
    assert below
    assert shown(narrow).count("beyond the band") == below


def test_a_campaign_shows_its_runs():
    campaign = ema.read_campaign(SAMPLE)
    texts = shown(campaign)
    assert texts.count("2000") == len(campaign.runs) == 6
    assert "220000 Pa" in texts
    assert repr(campaign) == ("<Campaign tyre_225_55R17: 6 runs with 72 responses, tyre 225/55R17>")


def test_texts_of_files_stay_texts(result):
    finding = Finding(HOSTILE, HOSTILE, nan, "level", "warning", HOSTILE)
    campaign = Campaign(HOSTILE, tyre=Tyre(HOSTILE), findings=(finding,))
    hostile = replace(result, name=HOSTILE, findings=(finding,), notes=(HOSTILE,))
    for thing in (campaign, hostile):
        assert HOSTILE in shown(thing)  # refuses any tag but those of a table
        assert "<script" not in thing._repr_html_()


def test_what_is_unknown_is_no_number(result):
    frf = replace(result.frf, coherence=np.full_like(result.frf.coherence, nan), n_effective=nan)
    assert shown(frf).count("unknown") == 2


def texts_of(notebook):
    """What the cells show as text, a cell at a time; pictures, ids and styles left out."""
    shown = []
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            assert output.output_type == "execute_result"
            data = output.data
            shown.append(data["text/plain"] if "image/png" not in data else "picture")
            if "text/html" in data:
                shown.append(DRAWING.sub("picture", data["text/html"]))
    return shown


def test_the_notebook_holds_what_a_fresh_run_gives():
    nbformat = pytest.importorskip("nbformat", reason="the notebook needs pip install nbformat")
    nbclient = pytest.importorskip("nbclient", reason="the notebook needs pip install nbclient")
    pytest.importorskip("ipykernel", reason="the notebook needs pip install ipykernel")
    path = ROOT / "docs" / "notebooks" / "first_steps.ipynb"
    stored = nbformat.read(path, as_version=4)
    fresh = deepcopy(stored)
    folder = {"metadata": {"path": str(path.parent)}}
    nbclient.NotebookClient(fresh, timeout=120, resources=folder).execute()
    before, after = texts_of(stored), texts_of(fresh)
    assert before.count("picture") >= 7
    for old, new in zip(before, after, strict=True):
        assert NUMBER.sub("#", old) == NUMBER.sub("#", new)
        wanted, found = ([float(n) for n in NUMBER.findall(text)] for text in (old, new))
        np.testing.assert_allclose(found, wanted, rtol=0.01, atol=0.02)


def test_the_gallery_draws_every_picture_that_it_shows(modes_once, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    import pictures

    gallery = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    drawn = pictures.draw_gallery()
    assert set(drawn) == set(re.findall(r"\]\((images/[^)]+)\)", gallery))
    for name, picture in drawn.items():
        assert picture.startswith(b"\x89PNG")
        assert (ROOT / "docs" / name).read_bytes().startswith(b"\x89PNG")


def test_messages_are_explained_in_the_words_that_the_program_uses():
    page = (ROOT / "docs" / "howto" / "troubleshooting.md").read_text(encoding="utf-8")
    quoted = re.findall(r'^### "([^"]+)"$', page, re.MULTILINE)
    assert len(quoted) >= 20
    sources = [
        path for package in ("ema", "model", "pipelines") for path in (ROOT / package).rglob("*.py")
    ]
    said = "".join(path.read_text(encoding="utf-8") for path in sources)
    assert [words for words in quoted if words not in said] == []


def test_the_sections_that_the_tutorial_photographs_are_in_the_report(result, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    import screenshots

    report = render_report(result)
    tutorial = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    shown = re.findall(r"\(images/tutorial/(\w+)\.png\)", tutorial)
    assert shown == list(screenshots.HEIGHTS)
    for section in shown:
        assert f'<section id="{section}"' in report
        assert f"section#{section} {{ display: block" in screenshots.alone(report, section)
