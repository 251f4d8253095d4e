"""The section on decisions: what was decided, what it did, and what got worse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from report_page import Page
from results import tyre_result

from ema.checks.corrections import Correction, DecidedBy
from ema.core.drift import Drift
from ema.core.edits import ChannelName, Edit, EditKind, PoleName
from ema.core.finding import Check, Finding, Verdict
from ema.core.modes import Chosen
from pipelines.report.by_hand import changed_by_hand
from pipelines.report.write import render_report
from pipelines.results.result import automatic_modes

WHO = {"by": "C. Engineer", "at": "2026-11-27T14:02:11+00:00"}
EDITS = (
    Edit(EditKind.SET_ASIDE, PoleName(121.4), reason="no <partner> at 2.0 bar", **WHO),
    Edit(EditKind.FLIP, channel=ChannelName("A05", "config_2.uff"), **WHO),
    Edit(EditKind.SETTINGS, settings={"band_hz": [40.0, 250.0]}),
)


def edited():
    """A synthetic result without its third mode, of which another one moved and one was kept."""
    plain = tyre_result()
    model = plain.modal_model
    modes = list(model.modes)
    modes[0] = replace(modes[0], pole=1.001 * modes[0].pole)
    modes[1] = replace(modes[1], chosen=Chosen.KEPT)
    row = Correction(7, "config_2.uff", "A05", 35.0, Check.BY_HAND, -1.0, 7, False)
    return replace(
        plain,
        modal_model=replace(model, modes=(*modes[:2], *modes[3:]), misfit=2.6),
        corrections=(replace(row, decided=DecidedBy.BY_HAND),),
        edits=EDITS,
        automatic=automatic_modes(model),
        automatic_misfit=1.3,
        provenance={**plain.provenance, "options_before_edits": {"band_hz": [20.0, 260.0]}},
    )


def test_automatic_results_have_no_section():
    assert changed_by_hand(tyre_result()) == ()


def test_each_decision_has_its_effect_reason_and_author():
    page = Page(render_report(edited()))
    for text in (
        "3 decisions by C. Engineer",
        "set aside 121.4 Hz",
        "n = 3, 121.40 Hz is fitted, but not listed",
        "no <partner> at 2.0 bar",
        "C. Engineer, 2026-11-27 14:02 UTC",
        "1 FRF at 35°",
        "instead of band_hz = 20.00 to 260.0",
    ):
        assert text in page.text


def test_what_got_worse_is_told_beside_the_automatic_modes():
    section = changed_by_hand(edited())[0]
    worse = next(block.items for block in section.blocks if getattr(block, "tone", "") == "warning")
    assert "The fit leaves 2.60 times the variance of the noise, the automatic one 1.30." in worse
    assert any(text.startswith("n = 1, 78.81 Hz moved by +5.0 σ") for text in worse)
    assert "n = 3, 121.40 Hz was ok automatically and is not listed." in worse
    table = next(block for block in section.blocks if "Automatic" in getattr(block, "caption", ""))
    assert [row[-1] for row in table.rows] == [
        *("automatic", "kept", "not listed"),
        *["automatic"] * 4,
    ]


def test_a_decision_against_one_force_names_it_and_counts_its_frfs():
    plain = edited()
    row = Finding("config_8.uff", "A03", 40.0, Check.BY_HAND, Verdict.EXCLUDED, "left out")
    out = Edit(EditKind.CHANNEL_OUT, channel=ChannelName("A03", None, 2))
    further = (plain.measured,)
    both = replace(plain, edits=(out,), findings=(*plain.findings, row), further=further)
    table = changed_by_hand(both)[0].blocks[1]
    assert table.rows[0][1:3] == ("leave out A03 against force 2", "1 FRF at 40°")


def test_modes_of_another_run_than_the_first_are_said_to_be_so():
    plain = edited()
    measured, model = plain.measured, plain.modal_model
    first = measured.run_names[0]
    nothing = np.zeros(2)
    drift = Drift(("later", "last"), *[nothing] * 6)
    moved = replace(plain, modal_model=replace(model, drift=drift))
    blocks = changed_by_hand(moved)[0].blocks
    told = [item for block in blocks for item in getattr(block, "items", ())]
    assert any("later" in item and first in item for item in told)
