"""What one can work in the report: positions to choose, shapes that move; by mouse and by keys."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from results import ring_modes, tyre_result

from model import ForcedRing, inertance
from pipelines.report import identification
from pipelines.report.write import render_page

SELECT, SAID = "#frf .chooser select", "#frf .chooser .said"
PREVIOUS, NEXT = "#frf [data-step='-1']", "#frf [data-step='1']"
STAGE, PLAY = "#shapes .stage", "#shapes .controls button"
MODE, PHASE, AMPLITUDE = "#shapes select", "#shapes [name=phase]", "#shapes [name=amplitude]"
# Numbers of JSON: a gap in a curve is null.
TRACES = """
const data = document.getElementById('chart-frf').data;
return Object.fromEntries(data.map(trace =>
  [trace.name + (trace.yaxis === 'y2' ? ' phase' : ''), [[...trace.x], [...trace.y]]]))"""
WATCH_FOCUS = """
window.focused = new Set();
addEventListener('focusin', event => window.focused.add(event.target));"""
NEVER_FOCUSED = """
const controls = document.querySelectorAll(
  'a[href], button, select, input, textarea, summary, [tabindex="0"]');
return [...controls].filter(each => each.checkVisibility() && !window.focused.has(each))
  .map(each => each.outerHTML.slice(0, 100))"""


@pytest.fixture
def frf_page(new_page):
    new_page.js("document.getElementById('frf').scrollIntoView()")
    new_page.wait("return window.ringmodalCharts.includes('frf')")
    return new_page


@pytest.fixture
def shapes_page(new_page):
    new_page.js("document.getElementById('shapes').scrollIntoView()")
    new_page.wait(f"return document.querySelector('{STAGE} .deformed') !== null")
    return new_page


def chosen(page):
    return page.js(f'return document.querySelector("{SELECT}").selectedIndex')


def curve(page, name):
    """Frequencies and values of a curve as they are drawn, without its gaps."""
    x, y = page.js(TRACES)[name]
    kept = [(f, value) for f, value in zip(x, y, strict=True) if value is not None]
    return np.array(kept).T


def choose(page, index):
    page.js(
        "const select = document.querySelector(arguments[0]); select.selectedIndex = arguments[1];"
        "select.dispatchEvent(new Event('change', {bubbles: true}))",
        SELECT,
        index,
    )


# --- FRFs of any position


def test_choosing_a_position_shows_and_says_it(frf_page):
    options = frf_page.texts(f"{SELECT} option")
    assert len(options) == 72
    before = curve(frf_page, "measured")
    frf_page.find_all(f"{SELECT} option")[30].click()
    assert options[30].startswith("150°")
    assert options[30] in frf_page.texts(SAID)[0]
    assert options[30] in frf_page.attribute("#chart-frf", "aria-label")
    assert not np.array_equal(curve(frf_page, "measured"), before)


@pytest.mark.parametrize("row", [0, 20, 61])
def test_curves_are_those_of_the_result(frf_page, sample_result, row):
    choose(frf_page, row)
    frf, model = sample_result.frf, sample_result.modal_model

    frequency_hz, level = curve(frf_page, "measured")
    lines = np.searchsorted(frf.frequency_hz, frequency_hz)
    np.testing.assert_allclose(level, np.abs(frf.values[row, lines]), rtol=1e-3)
    frequency_hz, phase_deg = curve(frf_page, "measured phase")
    lines = np.searchsorted(frf.frequency_hz, frequency_hz)
    np.testing.assert_allclose(phase_deg, np.angle(frf.values[row, lines], deg=True), atol=0.01)

    frequency_hz, level = curve(frf_page, "fitted")
    expected = np.abs(model.synthesise(frequency_hz, frf.run)[row])
    np.testing.assert_allclose(level, expected, rtol=1e-3, atol=1e-5 * expected.max())
    assert frequency_hz.size > 500

    ring = ForcedRing(sample_result.tuning.ring, sample_result.damping.damping)
    frequency_hz, level = curve(frf_page, "ring")
    angle = np.deg2rad(frf.position_deg[row] - sample_result.excitation_deg)
    expected = np.abs(inertance(ring, frequency_hz, angle)).ravel()
    np.testing.assert_allclose(level, expected, rtol=1e-3)


def test_the_nyquist_plot_follows_the_position(frf_page, sample_result):
    frf_page.js("document.getElementById('chart-nyquist').scrollIntoView()")
    frf_page.wait("return window.ringmodalCharts.includes('nyquist')")
    choose(frf_page, 30)
    data = "document.getElementById('chart-nyquist').data"
    name, x, y = frf_page.js(f"const [, t] = {data}; return [t.name, [...t.x], [...t.y]]")
    frf, (low, high) = sample_result.frf, sample_result.modal_model.band_hz
    inside = (frf.frequency_hz >= low) & (frf.frequency_hz <= high)
    values = frf.values[30, inside]
    assert name == "measured"
    np.testing.assert_allclose(
        np.array(x) + 1j * np.array(y), values, atol=2e-3 * abs(values).max()
    )
    assert "150°" in frf_page.attribute("#chart-nyquist", "aria-label")


def test_previous_and_next_stop_at_the_ends(frf_page):
    choose(frf_page, 1)
    for button, index in ((PREVIOUS, 0), (PREVIOUS, 0), (NEXT, 1), (NEXT, 2)):
        frf_page.click(button)
        assert chosen(frf_page) == index
        assert frf_page.texts(f"{SELECT} option")[index] in frf_page.texts(SAID)[0]
    choose(frf_page, 71)
    frf_page.click(NEXT)
    assert chosen(frf_page) == 71


def test_a_click_on_a_frac_shows_its_position(frf_page):
    frf_page.js("document.getElementById('chart-frac').scrollIntoView({block: 'center'})")
    frf_page.wait("return document.querySelectorAll('#chart-frac .point').length >= 72")
    frf_page.settle()
    frf_page.pointer().move_to_element(
        frf_page.find_all("#chart-frac .point")[40]
    ).click().perform()
    frf_page.wait(f"return document.querySelector('{SAID}').textContent.includes('200°')")
    assert chosen(frf_page) == 40


# --- shapes that move


def outline(page):
    """The deformed shape as it is drawn: one complex number for each point."""
    path = page.js(f"return document.querySelector('{STAGE} .deformed').getAttribute('d')")
    parts = np.array(re.findall(r"-?[\d.]+", path), dtype=float).reshape(-1, 2)
    return parts[:, 0] - 1j * parts[:, 1]


def deflection(page):
    return np.abs(outline(page)) - 1


def set_slider(page, selector, value):
    page.js(
        "const slider = document.querySelector(arguments[0]); slider.value = arguments[1];"
        "slider.dispatchEvent(new Event('input', {bubbles: true}))",
        selector,
        value,
    )


def frames(page, count=4):
    """Outlines after some frames each."""
    found = []
    for _ in range(count):
        page.settle()
        found.append(outline(page))
    return found


def moves(shapes):
    return any(not np.array_equal(shapes[0], later) for later in shapes[1:])


def test_shapes_rest_until_played_and_when_paused(shapes_page):
    assert not moves(frames(shapes_page))
    shapes_page.click(PLAY)
    assert shapes_page.texts(PLAY) == ["Pause"]
    assert moves(frames(shapes_page))
    shapes_page.click(PLAY)
    assert shapes_page.texts(PLAY) == ["Play"]
    assert not moves(frames(shapes_page))


def test_phase_and_amplitude_set_the_shape(shapes_page):
    set_slider(shapes_page, AMPLITUDE, 20)
    small = deflection(shapes_page)
    assert small.max() == pytest.approx(0.2, rel=0.02)
    set_slider(shapes_page, AMPLITUDE, 40)
    np.testing.assert_allclose(deflection(shapes_page), 2 * small, atol=3e-4)
    set_slider(shapes_page, PHASE, 180)
    np.testing.assert_allclose(deflection(shapes_page), -2 * small, atol=3e-4)
    set_slider(shapes_page, PHASE, 90)
    assert np.abs(deflection(shapes_page)).max() < 0.1
    assert shapes_page.texts("#shapes .phase-said") == ["90°"]
    assert shapes_page.texts("#shapes .amplitude-said") == ["40 %"]


def test_mode_of_order_n_shows_n_waves(shapes_page, sample_result):
    for index, mode in enumerate(sample_result.modal_model.modes[:4]):
        shapes_page.find_all(f"{MODE} option")[index].click()
        sign = np.sign(deflection(shapes_page))
        sign = sign[sign != 0]
        assert np.count_nonzero(sign != np.roll(sign, 1)) == 2 * mode.order
        assert f"{mode.frequency_hz:.1f}" in shapes_page.texts("#shapes .mode-said")[0]


def test_travelling_wave_turns_and_keeps_its_height(browser, tmp_path):
    """Re(e^{-2jθ} e^{jωt}) has its crests at 2θ = ωt: they go counter-clockwise."""
    model = ring_modes(np.arange(72) * 5.0)
    waves = np.exp(-2j * np.deg2rad(model.position_deg))
    travelling = replace(model, modes=(replace(model.modes[1], residues=waves),))
    section = identification.shapes(tyre_result(modal_model=travelling))
    path = tmp_path / "travelling.html"
    path.write_text(render_page("Shapes", "A travelling wave", (section,)), encoding="utf-8")
    browser.open(path)
    crests_deg = []
    for phase_deg in (0, 90):
        set_slider(browser, PHASE, phase_deg)
        points = outline(browser)
        assert np.abs(points).max() == pytest.approx(1.3, abs=0.01)
        crests_deg.append(np.angle(points[np.argmax(np.abs(points))], deg=True))
    assert (crests_deg[1] - crests_deg[0]) % 180 == pytest.approx(45, abs=3)


# --- by keys alone


def test_tab_reaches_every_control(new_page):
    from selenium.webdriver import Keys

    new_page.unfold()
    new_page.js(WATCH_FOCUS)
    for _ in range(20):
        new_page.pointer().send_keys(Keys.TAB * 25).perform()
        if new_page.js("return document.activeElement === document.body"):
            break
    assert new_page.js("return window.focused.size") > 20
    assert new_page.js(NEVER_FOCUSED) == []


def test_keys_work_the_controls(frf_page):
    from selenium.webdriver import Keys

    before = chosen(frf_page)
    frf_page.find(SELECT).send_keys(Keys.ARROW_DOWN)
    assert chosen(frf_page) == before + 1
    frf_page.find(NEXT).send_keys(Keys.SPACE)
    frf_page.find(NEXT).send_keys(Keys.ENTER)
    assert chosen(frf_page) == before + 3
    at_rest = outline(frf_page)
    frf_page.find(AMPLITUDE).send_keys(Keys.ARROW_RIGHT)
    larger = outline(frf_page)
    frf_page.find(PHASE).send_keys(Keys.ARROW_RIGHT)
    assert moves([at_rest, larger])
    assert moves([larger, outline(frf_page)])
    frf_page.find(PLAY).send_keys(Keys.SPACE)
    assert moves(frames(frf_page))


def test_controls_are_not_printed(page):
    page.show(media="print")
    shown = page.js(
        "return [...document.querySelectorAll('button, select, input')]"
        ".filter(each => each.checkVisibility()).map(each => each.outerHTML.slice(0, 80))"
    )
    assert shown == []


def test_the_tyre_moves_with_the_shape_and_the_ring_is_beside_it(shapes_page):
    picture = "return document.querySelector('#shapes canvas').toDataURL()"
    before = shapes_page.js(picture)
    shapes_page.js(
        "const phase = document.querySelector(arguments[0]); phase.value = 180;"
        "phase.dispatchEvent(new Event('input'))",
        PHASE,
    )
    assert shapes_page.js(picture) != before
    measured, ring = (
        shapes_page.attribute(f"{STAGE}{which} .deformed", "d") for which in ("", ".of-ring")
    )
    assert ring.count("L") == measured.count("L")
    numbers = [np.array(re.findall(r"-?[\d.]+", path), dtype=float) for path in (measured, ring)]
    np.testing.assert_allclose(*numbers, atol=0.02)  # at this mode the ring's shape is the measured


def test_the_force_points_inward(shapes_page):
    tail, tip = np.reshape(
        re.findall(r"-?[\d.]+", shapes_page.attribute(f"{STAGE} .force", "d")), (-1, 2)
    ).astype(float)[:2]
    assert np.hypot(*tail) > np.hypot(*tip) > 1
