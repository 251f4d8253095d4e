"""The pages of a review in a real browser: edits by hand and by keys, signing, and their looks."""

from __future__ import annotations

import shutil
from contextlib import contextmanager
from urllib.parse import urlsplit

import pytest
from reviewing import served

from pipelines.results.edits_file import read_edits

Keys = pytest.importorskip("selenium.webdriver.common.keys", reason="selenium is missing").Keys
WIDTHS_PX = (1280, 1000)
HEIGHT_PX = 800
HOSTILE = "<img src=x onerror=alert(1)>"
MOST_SCRIPT_BYTES = 150_000
READY = "return document.documentElement?.dataset.ready !== undefined"
STATE = "return ringmodalBench.state"
FINAL = "return ringmodalBench.state?.stage === 'final'"
SAID = "return document.getElementById('said').textContent"
OVERFLOW = """
const {scrollWidth, scrollHeight} = document.documentElement;
return [scrollWidth - innerWidth, scrollHeight - innerHeight]"""
# Bars whose content is wider than they are.
CUT = """
return [...document.querySelectorAll('.bar, header')]
  .filter(each => each.scrollWidth > each.clientWidth + 1).map(each => each.textContent)"""
TO_MODE = """
const bench = ringmodalBench, [low, high] = bench.range, f = bench.modes[arguments[0]].frequency_hz;
const inner = document.querySelector('#diagram canvas').clientWidth - 64; // without its axes
return [54 + inner * (f - low) / (high - low), 100]"""


def show(browser, width, scheme="light"):
    metrics = {"width": width, "height": HEIGHT_PX, "deviceScaleFactor": 1, "mobile": False}
    browser.cdp("Emulation.setDeviceMetricsOverride", **metrics)
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.cdp("Emulation.setEmulatedMedia", media="", features=features)
    browser.settle()


def bare(browser, width):
    """See to it that axe finds nothing serious, in light and in dark, and nothing is too wide."""
    for scheme in ("dark", "light"):
        show(browser, width, scheme)
        assert browser.js(OVERFLOW)[0] == 0
        assert browser.violations() == []


@contextmanager
def watched(browser, address):
    """See to it that pages complain of nothing and ask no other host for anything."""
    browser.complaints()
    browser.requests()
    yield
    host = urlsplit(address).netloc
    asked = {urlsplit(each).netloc for each in browser.requests() if each.startswith("http")}
    assert asked <= {host}
    assert browser.complaints() == []


@pytest.fixture(scope="module")
def lab(reviewed_once, short_campaign, tmp_path_factory):
    """A folder with two results, one of a hostile name, and a campaign that lacks a run."""
    lab = tmp_path_factory.mktemp("lab")
    for name in ("result", HOSTILE):
        shutil.copytree(reviewed_once, lab / name)
    shutil.copytree(short_campaign, lab / "rig")
    (lab / "rig" / "config_6.uff").unlink()
    return lab


@pytest.fixture(scope="module")
def server(lab, browser):
    with served(lab) as (_, address, file):
        yield address.rstrip("/"), file


@pytest.fixture
def home(browser, server):
    """The landing page, just opened."""
    address, file = server
    show(browser, WIDTHS_PX[0])
    browser.driver.get("about:blank")
    with watched(browser, address):
        browser.driver.get(file.as_uri())
        browser.wait(READY)
        yield browser


@pytest.fixture
def bench(home):
    """The review page, just opened, without edits."""
    home.js("[...document.querySelectorAll('th a')].find(a => a.textContent === 'result').click()")
    opened(home)
    yield home
    home.js("return ringmodalBench.moveTo(0)")
    settled(home, cursor=0)


def opened(browser):
    browser.wait(f"return location.pathname.startsWith('/r/') && ({READY[7:]})")
    browser.wait(FINAL)


def settled(browser, **wanted):
    """The state once it is final and as wanted."""
    for name, value in wanted.items():
        browser.wait(f"return ringmodalBench.state.{name} === arguments[0]", value)
    browser.wait(FINAL)
    return browser.js(STATE)


def press(browser, *keys, control=False):
    hand = browser.pointer()
    if control:
        hand.key_down(Keys.CONTROL)
    hand.send_keys(*keys)
    if control:
        hand.key_up(Keys.CONTROL)
    hand.perform()


def tab_to(browser, focus):
    """Go on with the tab key until the control of a name has the focus."""
    for _ in range(400):
        press(browser, Keys.TAB)
        if browser.js("return document.activeElement.dataset.focus") == focus:
            return
    pytest.fail(f"{focus} is not reached with the tab key")


def listed(state):
    return [mode["name"] for mode in state["modes"] if mode["listed"]]


def test_a_click_sets_aside_and_undo_brings_back(bench):
    """Hovering names the mode, a click takes it out, the buttons undo and redo."""
    before = bench.js(STATE)
    canvas, (x, y) = bench.find("#diagram canvas"), bench.js(TO_MODE, 1)
    offset = int(x - canvas.size["width"] / 2), int(y - canvas.size["height"] / 2)
    bench.pointer().move_to_element_with_offset(canvas, *offset).perform()
    name = before["modes"][1]["name"]
    bench.wait(
        "return document.querySelector('#diagram .tip').textContent.startsWith(arguments[0])",
        f"{name}, ",
    )
    bench.pointer().click().perform()
    after = settled(bench, cursor=1)
    assert name not in listed(after)
    assert len(listed(after)) == len(listed(before)) - 1
    said = bench.js(SAID)
    assert said.startswith(f"Set aside {name}")
    assert "χ²" in said
    assert said.endswith("final")
    bench.click("#undo")
    assert listed(settled(bench, cursor=0)) == listed(before)
    bench.click("#redo")
    assert listed(settled(bench, cursor=1)) == listed(after)


def test_dragging_and_the_wheel_zoom_and_edit_nothing(bench):
    """Both zoom about the place of the hand; the curves follow."""
    canvas, (x, _) = bench.find("#diagram canvas"), bench.js(TO_MODE, 1)
    hand = bench.pointer().move_to_element_with_offset(canvas, int(x - canvas.size["width"] / 2), 0)
    hand.click_and_hold().move_by_offset(40, 0).release().perform()
    frequency_hz = bench.js("return ringmodalBench.modes[1].frequency_hz")
    low, high = bench.js("return ringmodalBench.view.zoom")
    assert low == pytest.approx(frequency_hz, rel=0.01)
    bench.js(
        "arguments[0].dispatchEvent(new WheelEvent('wheel', {deltaY: 1, cancelable: true,"
        " clientX: arguments[0].getBoundingClientRect().left + 200}))",
        canvas,
    )
    wider = bench.js("return ringmodalBench.view.zoom")
    assert wider[1] - wider[0] == pytest.approx(1.25 * (high - low))
    press(bench, Keys.ESCAPE)
    assert bench.js("return [ringmodalBench.view.zoom, ringmodalBench.state.cursor]") == [None, 0]


def test_a_session_of_keys_alone(bench):
    """Modes, positions, tabs, a pole picked at another order, a channel left out, a reason."""
    press(bench, Keys.ARROW_DOWN, Keys.ARROW_RIGHT, "z", "3")
    assert bench.js("return ringmodalBench.mode.key === ringmodalBench.modes[1].key")
    assert bench.js("return [ringmodalBench.view.tab, ringmodalBench.view.zoom.length]") == [
        "nyquist",
        2,
    ]
    press(bench, "p", Keys.ARROW_DOWN, "[")
    pole = bench.js("return ringmodalBench.view.pick.pole")
    press(bench, Keys.ENTER)
    edit = settled(bench, cursor=1)["edits"][0]
    assert edit["kind"] == "pick"
    assert edit["edit"]["pole"]["order"] == bench.js(
        "return ringmodalBench.data.diagram.model_order[arguments[0]]", pole
    )
    press(bench, "z", control=True)
    settled(bench, cursor=0)
    press(bench, "x")
    out = bench.js("return ringmodalBench.view.row")
    assert not settled(bench, cursor=1)["channels"][out]["used"]
    tab_to(bench, "reason 0")
    press(bench, Keys.ENTER, "loose cable", Keys.ENTER)
    bench.wait("return ringmodalBench.state.edits[0].reason === 'loose cable'")
    press(bench, "x")
    assert settled(bench, cursor=2)["channels"][out]["used"]
    press(bench, "?")
    assert bench.texts("dialog h2") == ["Keys"]
    press(bench, Keys.ESCAPE)


def test_lists_are_one_stop_of_the_tab_key(bench):
    """Only the chosen line of a list is reached with it; arrows take the focus to the next one."""
    first, second = [mode["name"] for mode in bench.js(STATE)["modes"][:2]]
    tab_to(bench, f"mode {first}")
    press(bench, Keys.ARROW_DOWN)
    assert bench.js("return document.activeElement.dataset.focus") == f"mode {second}"
    stops = bench.js(
        "return [...document.querySelectorAll('button, select, input, a, [tabindex]')]"
        ".filter(each => each.tabIndex >= 0 && !each.disabled && each.checkVisibility()).length"
    )
    assert stops < 60


def test_every_edit_is_in_the_lists_too(bench):
    """A mode by its button, a pole by the list of poles, a flip by the list of channels."""
    first = bench.js(STATE)["modes"][0]["name"]
    bench.click(f"[data-focus='toggle {first}']")
    assert first not in listed(settled(bench, cursor=1))
    bench.click("[data-focus='flip 3']")
    channel = settled(bench, cursor=2)["channels"][3]
    assert (channel["sign"], channel["by_hand"]) == (-1, True)
    bench.click("[data-focus='poles']")
    bench.click("#table tbody tr td:last-child button")
    assert settled(bench, cursor=3)["edits"][2]["kind"] in ("pick", "keep")


def test_gain_start_and_note_are_asked_for(bench):
    """Each has a dialog whose fields are the edit."""
    press(bench, "g")
    press(bench, "2", Keys.ENTER)
    row = bench.js("return ringmodalBench.view.row")
    assert settled(bench, cursor=1)["channels"][row]["gain"] == pytest.approx(2)
    bench.click("[data-focus='why start']")
    press(bench, Keys.ENTER)
    start = settled(bench, cursor=2)["edits"][1]
    assert (start["kind"], start["mode"]) == ("start", bench.js(STATE)["modes"][0]["name"])
    bench.click("[data-focus='note']")
    press(bench, "warm tyre")
    bench.click("#ok")
    note = settled(bench, cursor=3)["edits"][2]
    assert (note["kind"], note["reason"]) == ("note", "warm tyre")


def test_another_band(bench):
    """The band is typed in; the diagram and the modes follow."""
    upper = bench.find("[data-focus='Band to, Hz']")
    upper.clear()
    upper.send_keys("130", Keys.TAB)
    state = settled(bench, cursor=1)
    assert state["band_hz"][1] == 130
    assert max(mode["frequency_hz"] for mode in state["modes"] if mode["listed"]) < 130
    shown = "return document.querySelector('[data-focus=\"Band to, Hz\"]').value === '130'"
    bench.wait(shown)


def test_what_an_edit_would_cost(bench):
    """The cost is shown, and nothing is edited."""
    press(bench, "t")
    bench.wait("return document.querySelector('.cost')?.textContent.includes('→')")
    assert bench.js(STATE)["cursor"] == 0


def test_an_edit_on_an_old_state_is_refused(bench, server):
    """The second tab learns of what the first one did, and nothing is overwritten."""
    driver, first = bench.driver, bench.driver.current_window_handle
    path = bench.js("return location.pathname")
    driver.switch_to.new_window("tab")
    try:
        show(bench, WIDTHS_PX[0])
        driver.get(server[1].as_uri())
        bench.wait(READY)
        driver.get(server[0] + path)
        opened(bench)
        bench.js("ringmodalBench.hear = () => null")  # as if its stream were late
        second = driver.current_window_handle
        driver.switch_to.window(first)
        press(bench, Keys.ENTER)
        revision = settled(bench, cursor=1)["revision"]
        driver.switch_to.window(second)
        press(bench, Keys.ARROW_DOWN, Keys.ENTER)
        bench.wait(
            "return document.getElementById('trouble').textContent.includes('another window')"
        )
        assert bench.js("return ringmodalBench.state.revision") == revision
        bench.complaints()  # Chromium logs the refused request
    finally:
        driver.close()
        driver.switch_to.window(first)
    assert len(bench.js(STATE)["edits"]) == 1


def test_sign_off_writes_a_new_folder(bench, lab):
    """The dialog shows the edits and asks for a name; the record is in the new folder."""
    mode = bench.js(STATE)["modes"][0]["name"]
    press(bench, Keys.ENTER)
    settled(bench, cursor=1)
    press(bench, "s", control=True)
    bench.wait("return document.querySelector('dialog #sign')?.disabled === false")
    assert bench.texts("dialog tbody tr:first-child td:first-child")[0].startswith(
        f"Set aside {mode}"
    )
    bare(bench, WIDTHS_PX[0])
    for selector, text in (("#signer", "A. Keller"), ("#note", "fixture"), ("#folder", "signed")):
        bench.find(selector).clear()
        bench.find(selector).send_keys(text)
    bench.click("#sign")
    bench.wait("return document.querySelector('dialog .good') !== null")
    assert "--edits" in bench.texts("dialog code")[0]
    record = read_edits(lab / "signed" / "edits.toml")
    assert [edit.kind for edit in record.edits] == ["set_aside"]
    assert (lab / "result" / "identification.json").is_file()
    press(bench, Keys.ESCAPE)
    settled(bench, cursor=0)  # what is signed is no draft any more


def test_nothing_is_lost_when_the_server_is_killed(browser, reviewed_once, tmp_path):
    """The page says so, and after a new start the edit is there."""
    folder = shutil.copytree(reviewed_once, tmp_path / "result")
    show(browser, WIDTHS_PX[0])
    with served(folder) as (process, _, file):
        browser.driver.get(file.as_uri())
        browser.wait(f"return location.protocol === 'http:' && ({READY[7:]})")
        press(browser, Keys.ENTER)  # before the first fit is done
        browser.wait("return ringmodalBench.state.cursor === 1")
        process.kill()
        process.wait()
        browser.wait(
            "return document.getElementById('trouble').textContent.includes('Nothing is lost')"
        )
    with served(folder) as (_, address, file), watched(browser, address):
        browser.driver.get("about:blank")
        browser.complaints()
        browser.driver.get(file.as_uri())
        opened(browser)
        assert settled(browser, cursor=1)["edits"][0]["kind"] == "set_aside"
        assert "token" not in browser.driver.current_url
        browser.driver.get("about:blank")


def test_pages_fit_and_are_accessible(bench, server):
    """Light, dark, wide and narrow: no scroll bar, nothing cut off, axe finds nothing serious."""
    for width in WIDTHS_PX:
        for scheme in ("light", "dark"):
            show(bench, width, scheme)
            assert bench.js(OVERFLOW) == [0, 0]
            assert bench.js(CUT) == []
            assert bench.violations() == []
    show(bench, 700)
    assert bench.js(OVERFLOW)[0] == 0


def test_landing_comparison_and_watch(home, server):
    """Names from files are text; two results are compared; the missing run is asked for."""
    assert HOSTILE in home.texts("th a")
    bare(home, WIDTHS_PX[0])
    for box in home.find_all("td [type=checkbox]")[:2]:
        box.click()
    home.click("#compare")
    home.wait(
        "return location.pathname === '/compare' && document.querySelector('.names') !== null"
    )
    home.driver.back()
    home.wait(READY)
    results = [
        link.split("/")[-1]
        for link in home.js("return [...document.querySelectorAll('th a')].map(a => a.href)")
    ]
    watch = home.js("return document.querySelector('a[href^=\"/w/\"]').href")
    home.driver.get(f"{server[0]}/compare?ids={','.join(results[:2])}")
    home.wait(READY)
    home.wait("return document.querySelector('.names').childElementCount === 2")
    assert len(home.find_all("section[aria-label=Modes] tbody tr")) >= 4
    bare(home, WIDTHS_PX[0])
    home.driver.get(watch)
    home.wait(READY)
    home.wait("return document.querySelector('.advice').textContent.includes('config_6')")
    assert "missing" in home.texts("tbody .chip")
    bare(home, WIDTHS_PX[1])


def test_what_other_programs_write_appears(home, lab):
    """A result of a batch that runs beside the page is listed without a reload."""
    shutil.copytree(lab / "result", lab / "night")
    try:
        home.wait(
            "return [...document.querySelectorAll('th a')].some(a => a.textContent === 'night')"
        )
    finally:
        shutil.rmtree(lab / "night")


def test_scripts_are_small(bench):
    """What the review page loads, own and foreign, is at most 150 kB."""
    loaded = bench.js(
        "return performance.getEntriesByType('resource')"
        ".filter(each => each.name.endsWith('.js')).map(each => each.decodedBodySize)"
    )
    assert 0 < sum(loaded) <= MOST_SCRIPT_BYTES


def test_the_frfs_of_another_force_are_shown_and_left_out(reviewed_of_two, browser, tmp_path):
    """The list beside the tabs changes the force; the place stays, and so does the fit."""
    shutil.copytree(reviewed_of_two, tmp_path / "result")
    show(browser, WIDTHS_PX[0])
    with served(tmp_path / "result") as (_, address, file), watched(browser, address):
        browser.driver.get(file.as_uri())
        opened(browser)
        before = browser.js("return ringmodalBench.channel")
        browser.js(
            "const list = document.getElementById('against'); list.value = '2';"
            " list.dispatchEvent(new Event('change'))"
        )
        browser.wait("return ringmodalBench.data.frf.row === ringmodalBench.view.row")
        browser.wait("return ringmodalBench.data.fit.row === ringmodalBench.view.row")
        after = browser.js("return ringmodalBench.channel")
        assert (after["position_deg"], after["force"]) == (before["position_deg"], 2)
        assert browser.js("return ringmodalBench.around.length") == 72
        assert browser.js("return ringmodalBench.data.fit.frequency_hz.length > 0")
        for width in reversed(WIDTHS_PX):
            show(browser, width)
            assert (browser.js(OVERFLOW), browser.js(CUT)) == ([0, 0], [])
        press(browser, "x")
        edit = settled(browser, cursor=1)["edits"][0]["edit"]
        assert edit["reference"] == 2
