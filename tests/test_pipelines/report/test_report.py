"""The report: hostile texts as text, every state a result can be in, and the page around it."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
from datetime import date
from math import nan
from pathlib import Path

import numpy as np
import pytest
from browser import contrast
from hypothesis import given
from hypothesis import strategies as st
from markupsafe import escape
from report_page import Page
from results import structure_result, tyre_result
from systems import common_drift

from ema.core.campaign import Tyre
from ema.core.display import value_with_std
from ema.core.drift import NO_DRIFT
from ema.core.errors import visible
from ema.core.finding import Check, Finding, Verdict
from ema.core.modes import ModalModel, ResidualTerms
from ema.io.campaign.manifest import TyreSection
from pipelines.plots.chart import Chart
from pipelines.plots.measurement import setup_chart
from pipelines.plots.plot import Curve
from pipelines.report import measurement
from pipelines.report import write as report
from pipelines.report.measurement import identity, not_stated
from pipelines.report.page import (
    Facts,
    Paragraph,
    Section,
    Table,
    Template,
    as_json,
    breakable,
    drawings,
    render_page,
)
from pipelines.report.responses import shown_rows
from pipelines.report.write import render_report, report_sections, write_report
from pipelines.results.tables import named

HOSTILE = "<script>alert('x')</script>\"&{{ 7 * 7 }}"


@pytest.fixture(scope="module")
def tyre():
    return tyre_result()


@pytest.fixture(scope="module")
def sections(tyre):
    return report_sections(tyre)


@pytest.fixture(scope="module")
def page(tyre):
    return Page(render_report(tyre))


@pytest.fixture(scope="module")
def structure_page():
    return Page(render_report(structure_result()))


def test_the_report_is_one_well_formed_file(page):
    assert not page.open
    assert page.tags.count("h1") == 1
    assert {"link", "iframe"}.isdisjoint(page.tags)
    for _, attributes in page.attributes:
        for name in ("src", "href"):
            assert attributes.get(name, "#").startswith(("#", "data:image/png;base64,"))


def test_every_link_inside_has_its_target(page):
    anchors = {attributes["id"] for _, attributes in page.attributes if "id" in attributes}
    for _, attributes in page.attributes:
        target = attributes.get("href") or "#" + attributes.get("aria-labelledby", "summary")
        assert target.removeprefix("#") in anchors


def test_every_figure_says_what_it_shows_and_what_to_look_for(sections):
    figures = drawings(sections)
    assert len(figures) >= 12
    assert len({figure.name for figure in figures}) == len(figures)
    for figure in figures:
        assert figure.alternative.endswith(".")
        assert len(figure.caption) > 40


def test_tables_have_a_cell_for_every_title(sections):
    for section in sections:
        for block in section.blocks:
            if isinstance(block, Table):
                assert all(len(row) == len(block.head) for row in block.rows)


def test_the_numbers_are_there(page, tyre):
    for mode in tyre.modal_model.modes:
        assert value_with_std(mode.frequency_hz, mode.frequency_std_hz) in page.text
    assert "2.2 bar" in page.text
    assert "0123456789abcdef" * 4 in page.text
    assert "50 Hz line 12 dB above its sides" in page.text
    for note in (*tyre.notes, *tyre.tuning.notes, *tyre.damping.notes):
        assert note in page.text


def test_a_structure_gets_its_report_and_the_reason_for_what_is_missing(structure_page):
    assert "The ring steps were left out." in structure_page.text
    assert "There is no grid and no tyre" in structure_page.text
    assert "The coherence is unknown" in structure_page.text
    assert "node 1" in structure_page.text
    assert "nan" not in re.sub(r"[a-z]+nan|nan[a-z]+", "", structure_page.text.lower())


def test_texts_from_files_stay_texts(tyre, page):
    hostile = replace(
        tyre,
        name=HOSTILE,
        tyre=Tyre(HOSTILE, 2.2e5, 0.33, details={HOSTILE: HOSTILE}),
        frf=replace(tyre.frf, run=(HOSTILE,) * 72),
        notes=(HOSTILE,),
        findings=(Finding(HOSTILE, HOSTILE * 100, None, Check.LEVEL, Verdict.EXCLUDED, HOSTILE),),
        provenance={"inputs": [{"file": HOSTILE, "bytes": 1, "sha256": "0"}]},
    )
    found = Page(render_report(hostile))
    assert found.tags.count("script") == page.tags.count("script")
    assert HOSTILE in found.text
    assert not found.open


def test_a_result_without_modes_says_so(tyre):
    model = tyre.modal_model
    nothing = ModalModel(
        (),
        (),
        model.residual_terms,
        model.band_hz,
        model.fit_band_hz,
        np.zeros((0, 0)),
        model.frac,
        model.misfit,
        model.node,
        model.position_deg,
    )
    bare = replace(
        tyre,
        modal_model=nothing,
        tuning=None,
        damping=None,
        validation=None,
        diagram=replace(tyre.diagram, clusters=()),
        reference=None,
    )
    page = Page(render_report(bare))
    assert "No mode was found in the band." in page.text
    assert "No reference sensor stayed in place" in page.text


@pytest.mark.parametrize(
    ("ratio", "consistent", "words"),
    [
        (1.0, True, "they show the same tyre"),
        (9.0, False, "the tyre or the set-up changed between runs"),
        (nan, True, "drift between runs was not assessed"),
    ],
)
def test_the_verdict_on_the_reference_is_in_words(tyre, ratio, consistent, words):
    check = replace(tyre.reference, ratio=ratio, consistent=consistent)
    blocks = measurement.quality(replace(tyre, reference=check)).blocks
    assert any(words in block.text for block in blocks if isinstance(block, Paragraph))


@pytest.mark.parametrize(
    ("drift", "words"),
    [(False, "drift between runs was not checked"), (True, "assessed by the modes alone")],
)
def test_without_a_reference_sensor_it_is_said_what_judges_the_runs(tyre, drift, words):
    seen = common_drift(tyre.reference.run, [0.0] * 6, [0.0] * 6) if drift else NO_DRIFT
    model = replace(tyre.modal_model, drift=seen)
    section = measurement.quality(replace(tyre, reference=None, modal_model=model))
    said = [block.text for block in section.blocks if isinstance(block, Paragraph)]
    assert any(words in text for text in said)


def test_the_coherence_of_a_single_average_is_not_shown(tyre):
    once = replace(tyre, frf=replace(tyre.frf, n_effective=1.0))
    charts = [block.name for block in measurement.quality(once).blocks if isinstance(block, Chart)]
    assert "coherence" not in charts
    assert "carries no information" in Page(render_report(once)).text


def test_a_long_list_of_runs_leaves_out_its_middle(tyre):
    runs = tuple(f"run_{row}.uff" for row in range(72))
    section = measurement.setup(replace(tyre, frf=replace(tyre.frf, run=runs)))
    facts = next(b for b in section.blocks[0].blocks if isinstance(b, Facts))
    text = dict(facts.rows)["Runs"]
    assert text.startswith("72: run_0.uff, run_1.uff, ")
    assert text.endswith("run_10.uff, …, run_71.uff")


def test_drift_is_listed_by_run(tyre):
    drift = common_drift(tyre.reference.run, [0, -0.1, -0.2, -0.3, -0.2, -0.1], [0, *[0.011] * 5])
    drifted = replace(tyre, modal_model=replace(tyre.modal_model, drift=drift))
    tables = [block for block in measurement.quality(drifted).blocks if isinstance(block, Table)]
    rows = next(
        table.rows for table in tables if table.head[0] == "run" and "damping / %" in table.head
    )
    assert rows[3][0] == "config_4.uff"
    assert "−0.300 ± 0.011" in rows[3]


def test_shown_frfs_are_the_drive_point_100_degrees_and_the_worst(tyre):
    assert shown_rows(tyre)[:2] == (0, 20)
    assert shown_rows(tyre)[2] == int(np.argmin(tyre.modal_model.frac))
    turned = replace(tyre, excitation_deg=355.0)
    assert shown_rows(turned)[:2] == (71, 19)


def test_written_file_is_what_was_rendered(tyre, tmp_path):
    target = write_report(tyre, tmp_path / "report.html")
    assert target.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert target.stat().st_size < 6e6


def test_a_result_with_its_page_is_written_without_libraries_that_only_others_need(tmp_path):
    program = (
        "import sys; sys.path.insert(0, 'tests'); from results import tyre_result;"
        f"from pipelines.report.write import save; save(tyre_result(), {str(tmp_path / 'r')!r});"
        "print({'matplotlib', 'pandas'} & set(sys.modules))"
    )
    command = [sys.executable, "-c", program]
    assert subprocess.run(command, capture_output=True, check=True).stdout.strip() == b"set()"


HOSTILE_JSON = st.text(st.characters(exclude_categories=["Cs"])) | st.sampled_from(
    ["</script>", "<!--<script>", "]]>", "\u2028", "&lt;"]
)


@given(HOSTILE_JSON)
def test_data_in_the_page_cannot_end_its_script(text):
    written = str(as_json({"text": text}))
    assert not set("<>&\u2028\u2029") & set(written)
    assert json.loads(written) == {"text": visible(text)}


def test_numbers_that_json_cannot_hold_are_a_fault():
    with pytest.raises(ValueError, match="not JSON compliant"):
        as_json({"value": nan})


def test_a_page_without_charts_needs_no_script():
    text = render_page("Kind", "Subject", (Section("one", "One", (Paragraph("Text."),)),))
    assert "<script" not in text
    assert "<noscript" not in text


def test_on_paper_every_chart_is_a_picture(tyre):
    sections = tuple(map(report._for_paper, report_sections(tyre)))
    page = Page(render_page("Report", report.subject_of(tyre), sections, Template()))
    assert "script" not in page.tags
    pictures = [attributes for tag, attributes in page.attributes if tag == "img"]
    assert len(pictures) >= 12
    assert all(picture["src"].startswith("data:image/") for picture in pictures)


def test_every_colour_of_a_line_or_text_stands_out_from_the_paper():
    style = (Path(report.__file__).parent / "colours.css").read_text(encoding="utf-8")
    light, dark = (
        dict(re.findall(r"--([a-z0-9-]+): (#[0-9a-f]{6})", part))
        for part in style.split("* { box-sizing")[0].split("@media screen")
    )
    for shown in (light, light | dark):
        palette = {name: computed(colour) for name, colour in shown.items()}
        for name, colour in palette.items():
            if name.startswith("cell"):
                assert contrast(palette["ink"], colour) >= 4.5, name
            if name in {"paper", "card", "line"} or name.startswith("cell"):
                continue
            text = name in {"ink", "soft", "accent", "good", "warning", "bad"}
            for ground in ("paper", "card") if text else ("paper",):
                assert contrast(colour, palette[ground]) >= (4.5 if text else 3), (name, ground)


def computed(colour):
    """A colour of the style sheet as a browser states it."""
    return f"rgb({', '.join(str(int(colour[k : k + 2], 16)) for k in (1, 3, 5))})"


@given(st.text(st.characters(exclude_categories=["Cs"]), max_size=120))
def test_long_words_may_break_and_are_copied_whole(text):
    html = str(breakable(text))
    assert html.replace("<wbr>", "") == str(escape(visible(text)))
    assert all(len(piece) <= 32 * 6 for piece in re.split(r"<wbr>|\s", html))


def test_a_single_position_has_no_shape_and_no_shape_numbers():
    result = structure_result()
    model = result.modal_model
    one = ModalModel(
        tuple(replace(m, residues=m.residues[:1], residues_std=[0.0]) for m in model.modes),
        (),
        ResidualTerms(model.residual_terms.lower[:1], model.residual_terms.upper[:1]),
        model.band_hz,
        model.fit_band_hz,
        model.covariance,
        model.frac[:1],
        model.misfit,
        model.node[:1],
        model.position_deg[:1],
    )
    page = Page(render_report(replace(result, modal_model=one, frf=result.frf.rows([0]))))
    assert "A single position has no shape." in page.text
    assert "MPD / °" not in page.text


@pytest.mark.parametrize(
    ("key", "text", "row"),
    [
        ("load_n", "4000.0", ("Load", "4000 N")),
        ("temperature_c", "21.5", ("Temperature", "21.5 °C")),
        ("serial", "DOT 4523", ("Serial number", "DOT 4523")),
        ("boundary", "rim clamped", ("Boundary condition", "rim clamped")),
        ("camber_deg", "1.5", ("Camber", "1.5°")),
        ("drum_speed_km_h", "80.0", ("Drum speed", "80 km/h")),
        ("rubber_hardness", "65.0", ("Rubber hardness", "65.0")),
    ],
)
def test_what_a_lab_writes_down_has_a_name_and_a_unit(key, text, row):
    assert named(key, text) == row


def test_the_manifest_takes_what_a_lab_writes_down_and_the_report_shows_it(tyre):
    section = TyreSection(
        designation="225/55R17",
        date=date(2025, 5, 3),
        operator="A. Miller",
        rim="7J x 17",
        load_n=0.0,
        temperature_c=21,
    )
    named = section.tyre()
    rows = dict(identity(replace(tyre, tyre=named), Template()).blocks[0].rows)
    assert rows["Date of test"] == "2025-05-03"
    assert rows["Load"] == "0 N"
    assert rows["Temperature"] == "21 °C"
    assert dict(not_stated(named))["Not stated"].startswith("serial number, boundary condition (")


def test_the_sketch_has_a_mark_for_every_position_and_names_every_run(tyre):
    chart = setup_chart(tyre.frf, tyre.excitation_deg, tyre.reference_deg)
    runs = [curve for curve in curves_of(chart) if curve.name.endswith(".uff")]
    assert len(runs) == 6
    assert sum(curve.x.size for curve in runs) == 72
    listed = [trace["name"] for trace in chart.data if trace["showlegend"]]
    assert listed[-2:] == ["force", "reference"]
    assert (runs[0].x[0], runs[0].y[0]) == pytest.approx((1.0, 0.0))


def test_angles_run_counter_clockwise(tyre):
    quarter = setup_chart(tyre.frf, 90.0)
    arrow = next(curve for curve in curves_of(quarter) if curve.name == "force")
    assert np.all(np.abs(arrow.x) < 0.1)
    assert np.all(arrow.y > 1)


def curves_of(chart):
    return [each for each in chart.plot.panels[0].series if isinstance(each, Curve)]
