"""What the report holds for its charts: every FRF, the fit, the ring and the shapes."""

from dataclasses import replace

import numpy as np
import pytest
from report_page import Page, decoded
from results import ring_modes, structure_result, tyre_result

from ema.core.frf import FRF
from ema.core.modes import synthesise
from model import ForcedRing, inertance
from pipelines.report.responses import kept_lines, kept_positions, ring_data
from pipelines.report.write import render_report


@pytest.fixture(scope="module")
def tyre():
    return tyre_result()


@pytest.fixture(scope="module")
def page(tyre):
    return Page(render_report(tyre))


def test_the_page_holds_the_frfs_of_every_position(tyre, page):
    content = page.content("frf-content")
    frequency_hz = decoded(content["frequency_hz"])
    assert content["rows"] == list(range(72))
    lines = np.searchsorted(tyre.frf.frequency_hz, frequency_hz)
    expected = tyre.frf.values[:, lines]
    level = decoded(content["measured"]["level_db"], "<i2").reshape(72, -1) / 100
    phase = decoded(content["measured"]["phase_deg"], "<i2").reshape(72, -1) / 100
    known = expected != 0
    found = 10 ** (level / 20) * np.exp(1j * np.deg2rad(phase))
    np.testing.assert_allclose(found[known], expected[known], rtol=1e-3)


def test_the_fitted_curves_follow_from_what_the_page_holds(tyre, page):
    content = page.content("frf-content")
    fit, frequency_hz = content["fitted"], decoded(content["frequency_hz"]).astype(float)
    assert fit["run"] == [tyre.frf.run_names.index(name) for name in tyre.frf.run]
    state = fit["states"][0]
    poles = np.array(state["real"]) + 1j * np.array(state["imag"])
    real, imag = (decoded(fit["residues"][part]).reshape(72, -1) for part in ("real", "imag"))
    found = synthesise(
        frequency_hz, poles, real + 1j * imag, decoded(fit["lower"]), decoded(fit["upper"])
    )
    np.testing.assert_allclose(found, tyre.modal_model.synthesise(frequency_hz), rtol=1e-3)


def test_the_ring_s_curves_follow_from_what_the_page_holds(tyre):
    wide = replace(
        tyre, tuning=replace(tyre.tuning, ring=replace(tyre.tuning.ring, belt_width_m=0.19))
    )
    ring, omega = ring_data(wide, np.array([20])), 2 * np.pi * np.array([50.0, 100.3, 220.0])
    m11, m22, coupling = (
        np.array(ring[name]["real"]) + 1j * np.array(ring[name]["imag"])
        for name in ("m11", "m22", "coupling")
    )
    inertia = ring["mass_per_area_kg_m2"] * omega[:, None] ** 2
    m11 = m11 + 1j * omega[:, None] * ring["radial_n_s_m3"] - inertia
    m22 = m22 + 1j * omega[:, None] * ring["circumferential_n_s_m3"] - inertia
    weights = np.where(np.arange(m11.shape[1]) == 0, 1, 2) * np.cos(
        np.arange(m11.shape[1]) * ring["angle_rad"][0]
    )
    found = -(omega**2) / ring["area_m2"] * ((m22 / (m11 * m22 - coupling**2)) @ weights)
    forced = ForcedRing(wide.tuning.ring, wide.damping.damping)
    expected = inertance(forced, omega / (2 * np.pi), np.deg2rad(100.0))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_a_ring_without_width_has_no_curve_and_the_page_says_why(tyre, page):
    assert tyre.tuning.ring.belt_width_m is None
    assert page.content("frf-content")["ring"] is None
    assert "Add belt_width_m to [tyre] in the manifest." in page.text


def test_lines_are_thinned_where_no_mode_is():
    frequency_hz = np.arange(0.0, 400.0, 0.1)
    poles = np.array([2 * np.pi * 100 * (1j - 0.01)])
    kept = frequency_hz[kept_lines(frequency_hz, poles, 940)]
    assert kept.size <= 940
    assert np.max(np.diff(kept)) < 2.0
    assert np.max(np.diff(kept[(kept > 99) & (kept < 101)])) < 0.15


def test_a_large_campaign_fits_into_the_page_and_the_page_says_what_it_leaves_out(tyre):
    model = ring_modes(np.linspace(0, 360, 500, endpoint=False))
    frequency_hz = np.linspace(0.5, 300.0, 4000)
    values = model.synthesise(frequency_hz)
    known = np.ones(values.shape)
    frf = FRF(
        frequency_hz, values, known, 0.01 * known, model.node, model.position_deg, ("a.uff",) * 500
    )
    html = render_report(replace(tyre, frf=frf, modal_model=model))
    assert len(html.encode()) < 6e6
    assert "The page has 900 of 3071 lines, closest around the modes" in html


def test_of_very_many_positions_those_worth_showing_stay():
    rows = kept_positions(5000, (0, 17, 4999))
    assert rows.size <= 600
    assert {0, 17, 4999} <= set(rows)


def test_the_page_holds_the_shapes_as_they_are(tyre, page):
    content = page.content("shapes-animation")
    np.testing.assert_allclose(decoded(content["angle_deg"]), tyre.frf.position_deg)
    for mode, held in zip(tyre.modal_model.modes, content["modes"], strict=True):
        found = decoded(held["real"]) + 1j * decoded(held["imag"])
        np.testing.assert_allclose(found, mode.shape, atol=1e-6)
        assert f"{mode.frequency_hz:.1f} Hz" in held["said"]


def test_shapes_without_angles_are_drawn_over_their_nodes():
    content = Page(render_report(structure_result())).content("shapes-animation")
    assert content["angle_deg"] is None
    assert len(content["names"]) == len(decoded(content["modes"][0]["real"])) == 10
