"""A real browser for tests: headless Chromium, its console and what it asks the network for."""

from __future__ import annotations

import base64
import importlib.util
import json
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "chrome")
CHROMEDRIVER = ("chromedriver", "chromium.chromedriver")
AXE = Path(__file__).parent / "node_modules" / "axe-core" / "axe.min.js"
REQUIRED = "RINGMODAL_BROWSER"  # "require": what is missing is a failure, not a reason to skip
LOCAL = {"file", "data", "blob"}
WIDE_PX, HEIGHT_PX = 1200, 900
PATIENCE_S = 60.0  # a busy machine is slow, not wrong
SWITCHES = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--force-device-scale-factor=1",
    "--hide-scrollbars",
    f"--window-size={WIDE_PX},{HEIGHT_PX}",
)

# Opens what is folded and scrolls to each chart until it is drawn.
UNFOLD = """
const done = arguments[0], drawn = () => new Promise(requestAnimationFrame);
(async () => {
  document.querySelectorAll('details').forEach(each => each.open = true);
  for (const plot of document.querySelectorAll('.plot')) {
    plot.scrollIntoView();
    while (!window.ringmodalCharts.includes(plot.id.slice(6))) await drawn();
  }
})().then(done)"""


def demand(thing: object, name: str) -> None:
    """Skip where a tool for these tests is missing, or fail where it was promised."""
    if thing:
        return
    reason = f"{name} is missing; .ci/run installs what the browser tests need"
    if os.environ.get(REQUIRED) == "require":
        pytest.fail(reason)
    pytest.skip(reason)


def on_path(names: tuple[str, ...]) -> str | None:
    return next(filter(None, map(shutil.which, names)), None)


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start a browser, and end it afterwards."""
    program, chromedriver = on_path(CHROMIUM), on_path(CHROMEDRIVER)
    demand(importlib.util.find_spec("selenium"), "selenium")
    demand(program, "Chromium")
    demand(chromedriver, "chromedriver")
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = str(program)
    for switch in SWITCHES:
        options.add_argument(switch)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options, webdriver.ChromeService(chromedriver))
    try:
        driver.set_script_timeout(PATIENCE_S)
        yield Browser(driver)
    finally:
        driver.quit()


@dataclass(frozen=True)
class Browser:
    """What tests do with a page."""

    driver: Any

    def open(self, path: Path) -> None:
        """Open a page of its own and wait until it can be used."""
        self.driver.get(path.as_uri())
        self.wait("return document.readyState === 'complete'")
        if self.js("return document.querySelector('.plot') !== null"):
            self.wait("return document.documentElement.dataset.ready !== undefined")

    def keep_open(self, path: Path) -> None:
        """Open a page unless it is there already: for tests that look and change nothing."""
        if self.driver.current_url != path.as_uri():
            self.open(path)

    @contextmanager
    def watched(self) -> Iterator[None]:
        """See to it that pages complain of nothing and ask no other machine for anything."""
        self.complaints()
        self.requests()
        yield
        complaints = self.complaints()
        assert not complaints, complaints
        assert hosts(self.requests()) == []

    def unfold(self) -> None:
        """Open what is folded, and have every chart drawn as by a reader who scrolls past it."""
        self.js_later(UNFOLD)
        self.settle()

    def js(self, script: str, *arguments: Any) -> Any:
        """Run a script in the page; its `return` is the answer."""
        return self.driver.execute_script(script, *arguments)

    def js_later(self, script: str) -> Any:
        """Run a script that hands its answer to its last argument, when it has it."""
        return self.driver.execute_async_script(script)

    def cdp(self, command: str, **parameters: Any) -> Any:
        """Give a command of the Chrome DevTools Protocol."""
        return self.driver.execute_cdp_cmd(command, parameters)

    def wait(self, script: str, *arguments: Any) -> Any:
        """Wait until a script answers with something true, and return that."""
        from selenium.webdriver.support.ui import WebDriverWait

        waiting = WebDriverWait(self.driver, PATIENCE_S, poll_frequency=0.05)
        return waiting.until(lambda _: self.js(script, *arguments), f"in vain: {script}")

    def show(self, *, width: int = WIDE_PX, scheme: str = "light", media: str = "") -> None:
        """Set width in pixels, colour scheme and medium; wait until the page has drawn both."""
        self.cdp(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=HEIGHT_PX,
            deviceScaleFactor=1,
            mobile=False,
        )
        features = [
            {"name": "prefers-color-scheme", "value": scheme},
            {"name": "prefers-reduced-motion", "value": "no-preference"},
        ]
        self.cdp("Emulation.setEmulatedMedia", media=media, features=features)
        self.settle()

    def settle(self) -> None:
        """Let the page draw two frames and what they set off."""
        self.js_later(
            "const done = arguments[0];"
            "requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 50)));"
        )

    def find(self, selector: str) -> Any:
        """The first element that fits, as something to point at."""
        return self.driver.find_element("css selector", selector)

    def click(self, selector: str) -> None:
        """Click on the first element that fits; again if the page was just drawn anew."""
        from selenium.common.exceptions import StaleElementReferenceException

        for _ in range(5):
            with suppress(StaleElementReferenceException):
                self.find(selector).click()
                return
        self.find(selector).click()

    def find_all(self, selector: str) -> list[Any]:
        """All elements that fit, as things to point at."""
        return list(self.driver.find_elements("css selector", selector))

    def pointer(self) -> Any:
        """What a hand does with mouse and keys, step by step until ``perform()``."""
        from selenium.webdriver import ActionChains

        return ActionChains(self.driver, duration=50)

    def ids(self, selector: str) -> list[str]:
        """The ids of all elements that fit."""
        script = "return [...document.querySelectorAll(arguments[0])].map(each => each.id)"
        return list(self.js(script, selector))

    def texts(self, selector: str) -> list[str]:
        """The texts of all elements that fit."""
        script = "return [...document.querySelectorAll(arguments[0])].map(e => e.textContent)"
        return list(self.js(script, selector))

    def attribute(self, selector: str, name: str) -> str:
        """An attribute of the first element that fits."""
        script = "return document.querySelector(arguments[0]).getAttribute(arguments[1])"
        return str(self.js(script, selector, name))

    def style(self, selector: str, name: str) -> str:
        """A computed style of the first element that fits."""
        script = "return getComputedStyle(document.querySelector(arguments[0]))[arguments[1]]"
        return str(self.js(script, selector, name))

    def complaints(self) -> list[str]:
        """Warnings and errors on the console since the last call."""
        entries = self.driver.get_log("browser")
        return [each["message"] for each in entries if each["level"] in ("WARNING", "SEVERE")]

    def requests(self) -> list[str]:
        """Addresses the page asked for since the last call."""
        entries = [
            json.loads(each["message"])["message"] for each in self.driver.get_log("performance")
        ]
        return [
            each["params"]["request"]["url"]
            for each in entries
            if each["method"] == "Network.requestWillBeSent"
        ] + [each["params"]["url"] for each in entries if each["method"].endswith("socketCreated")]

    def pdf(self) -> bytes:
        """The page as it prints on A4."""
        printed = self.cdp("Page.printToPDF", preferCSSPageSize=True, printBackground=True)
        return base64.b64decode(printed["data"])

    def violations(self, *rules: str) -> list[str]:
        """Serious and critical findings of axe-core, with the places; of some rules, or of all."""
        demand(AXE.is_file(), "axe-core")
        if not self.js("return window.axe !== undefined"):
            self.js(AXE.read_text(encoding="utf-8"))
        options = {"resultTypes": ["violations"]} | ({"runOnly": rules} if rules else {})
        found = self.js_later(
            "const done = arguments[0];"
            f"axe.run(document, {json.dumps(options)}).then(found => done(found.violations))"
        )
        return [
            f"{each['id']}: {', '.join(str(node['target']) for node in each['nodes'][:5])}"
            for each in found
            if each["impact"] in ("serious", "critical")
        ]


def luminance(colour: str) -> float:
    """Relative luminance of a computed colour, by WCAG 2."""
    parts = [float(part) / 255 for part in re.findall(r"[\d.]+", colour)[:3]]
    linear = [
        each / 12.92 if each <= 0.04045 else ((each + 0.055) / 1.055) ** 2.4 for each in parts
    ]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    """Ratio of contrast of two computed colours, by WCAG 2: from 1 to 21."""
    darker, lighter = sorted([luminance(one), luminance(other)])
    return (lighter + 0.05) / (darker + 0.05)


def hosts(addresses: list[str]) -> list[str]:
    """Those of the addresses that leave the machine."""
    return [address for address in addresses if urlsplit(address).scheme not in LOCAL]
