"""The first screen, what it withholds, and the template of a laboratory."""

from dataclasses import replace

import pytest
from report_page import Page
from results import tyre_result

from ema.core.campaign import Tyre
from ema.core.errors import InputError
from ema.core.finding import Check, Finding, Verdict
from pipelines.report.page import Beside, Lamp, Listing, Table, Template, read_template
from pipelines.report.summary import summary
from pipelines.report.write import render_report
from pipelines.results.options import Units

ANGLES = Finding("", "", None, Check.POSITIONS, Verdict.WARNING, "mirrored")


def tables(result, units=Units.LAB):
    beside = next(b for b in summary(result, units).blocks if isinstance(b, Beside))
    return [each for each in beside.blocks if isinstance(each, Table)]


def test_the_first_screen_has_verdict_remarks_modes_and_parameters():
    result = tyre_result()
    lamp, remarks, *_ = summary(result).blocks
    assert isinstance(lamp, Lamp)
    assert lamp.sign == "!"
    assert isinstance(remarks, Listing)
    assert len(remarks.items) <= 3
    modes, ring = tables(result)
    assert [row[0] for row in modes.rows] == list("1234567")
    cells = {name: (value, unit) for name, value, unit in ring.rows}
    assert cells["axial stiffness K"] == ("not identified", "")
    assert cells["inflation pressure p₀, given"][1] == "bar"
    assert cells["mean radius a, given"][1] == "mm"
    cells = {name: (value, unit) for name, value, unit in tables(result, Units.SI)[1].rows}
    assert cells["inflation pressure p₀, given"][1] == "kPa"
    assert cells["mean radius a, given"][1] == "m"


def test_what_cannot_be_trusted_is_withheld():
    result = tyre_result(findings=(ANGLES,))
    (modes,) = tables(result)
    assert "order" not in modes.head
    assert summary(result).blocks[0].state == "bad"
    page = Page(render_report(result))
    assert "Ring parameters are withheld" in page.text
    assert "Orders one by one" not in page.text
    assert "values found, not to be used" in page.text
    assert not any(each.get("id") == "chart-dispersion" for _, each in page.attributes)


def test_many_modes_leave_room_for_the_rest():
    result = tyre_result()
    model = result.modal_model
    many = replace(result, modal_model=replace(model, modes=model.modes * 3))
    modes, _ = tables(many)
    assert len(modes.rows) == 14
    assert "14 of 21" in modes.caption


TEMPLATE = """
title = "Schwingungsprüfung"
client = "Example Tyres <Ltd>"
report_number = "2026-017"
logo = "logo.svg"
introduction = "As ordered."
closing = "Results hold for the tyre tested."
signatures = ["Tested by", "Approved by"]
units = "si"
fields = { "Order" = "4711" }
"""


@pytest.fixture
def template(tmp_path):
    (tmp_path / "logo.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    (tmp_path / "lab.toml").write_text(TEMPLATE, encoding="utf-8")
    return tmp_path / "lab.toml"


def test_a_template_gives_head_texts_units_and_signatures(template):
    page = Page(render_report(tyre_result(), read_template(template)))
    for text in ("Schwingungsprüfung", "Example Tyres <Ltd>", "2026-017", "As ordered.", "4711"):
        assert text in page.text
    for text in ("Tested by", "Approved by", "Results hold for the tyre tested.", "220 kPa"):
        assert text in page.text
    logos = [each for tag, each in page.attributes if tag == "img" and "logo" in each["class"]]
    assert logos[0]["src"].startswith("data:image/svg+xml;base64,")
    assert read_template(template, Units.LAB).units == Units.LAB


def test_the_manifest_may_name_client_and_number():
    details = {"client": "Another", "report_number": "9"}
    result = tyre_result(tyre=Tyre("225/55R17", 2.2e5, 0.33, 0.19, details))
    page = Page(render_report(result, Template(client="Usual")))
    assert "Client: Another" in page.text
    assert "Report number: 9" in page.text


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ('tittle = "x"', "'title'"),
        ("client = 5", "must be text"),
        ("fields = { a = 1 }", "table of texts"),
        ('signatures = "one"', "a list of texts"),
        ('units = "imperial"', "lab, si"),
        ('logo = "missing.png"', "logo"),
        ('logo = "lab.toml"', "ending"),
        ("client = ", "TOML"),
    ],
)
def test_faults_of_a_template_are_named(tmp_path, line, says):
    (tmp_path / "lab.toml").write_text(line)
    with pytest.raises(InputError, match=r"lab\.toml") as caught:
        read_template(tmp_path / "lab.toml")
    assert says in str(caught.value)


def test_a_template_that_is_missing_or_a_large_logo_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"no\.toml"):
        read_template(tmp_path / "no.toml")
    (tmp_path / "logo.png").write_bytes(bytes(600_000))
    (tmp_path / "lab.toml").write_text('logo = "logo.png"')
    with pytest.raises(InputError, match="600000 bytes"):
        read_template(tmp_path / "lab.toml")
