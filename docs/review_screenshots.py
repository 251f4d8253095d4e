"""Screenshots of the review for its guide: ``python docs/review_screenshots.py``.

Needs what the tests in a browser need: Chromium, chromedriver and selenium.
"""

import io
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS.parent / "tests"))

from browser import Browser, chromium  # noqa: E402 - from the tests
from PIL import Image  # noqa: E402
from reviewing import served  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402

from pipelines.process.run import process  # noqa: E402
from pipelines.report.write import save  # noqa: E402
from pipelines.simulate.campaign import simulate_campaign  # noqa: E402

PICTURES = DOCS / "images" / "review"
WIDTH, HEIGHT = 1280, 800
READY = "return document.documentElement?.dataset.ready !== undefined"
FINAL = "return window.ringmodalBench?.state?.stage === 'final' && ringmodalBench.state.cursor === "
SPLIT_PERCENT = 1.5
MEASURED_RUNS = 3  # of the second campaign
N_MODES = 16  # at least: the last one is chosen
COLOURS = 128  # of a picture
# The place of the files is not the reader's.
WITHOUT_PLACE = """
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
while (walker.nextNode()) {
  walker.currentNode.data = walker.currentNode.data.replaceAll(arguments[0], 'measurements');
}"""


def prepare(folder: Path) -> None:
    """Write a campaign with its result, and one that is still being measured."""
    campaign = simulate_campaign(folder / "tyre_7", split_percent=SPLIT_PERCENT)
    save(process(campaign), folder / "tyre_7_result", report=False)
    rig = simulate_campaign(folder / "tyre_8", duration_s=8.0)
    for file in sorted(rig.glob("config_*.uff"))[MEASURED_RUNS:]:
        file.unlink()


def photograph(browser: Browser, place: str, name: str, height: int = HEIGHT) -> None:
    """Store what a browser shows."""
    browser.js(WITHOUT_PLACE, place)
    metrics = {"width": WIDTH, "height": height, "deviceScaleFactor": 1, "mobile": False}
    browser.cdp("Emulation.setDeviceMetricsOverride", **metrics)
    browser.settle()
    shot = Image.open(io.BytesIO(browser.driver.get_screenshot_as_png())).convert("RGB")
    shot.quantize(COLOURS).save(PICTURES / f"{name}.png", optimize=True)


def press(browser: Browser, *keys: str) -> None:
    """Press keys one after another."""
    browser.pointer().send_keys(*keys).perform()


def main() -> None:
    """Write the pictures of the guide."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as place, chromium() as browser:
        folder = Path(place) / "2026-11"
        prepare(folder)
        with served(folder) as (_, _, file):
            browser.driver.get(file.as_uri())
            browser.wait(READY)
            photograph(browser, place, "folder", 330)
            watch = browser.js("return document.querySelector('a[href^=\"/w/\"]').href")
            browser.js("document.querySelector('a[href^=\"/r/\"]').click()")
            browser.wait(FINAL + "0")
            press(browser, *[Keys.ARROW_DOWN] * N_MODES, "t")
            browser.wait("return document.querySelector('.cost')?.textContent.includes('→')")
            photograph(browser, place, "review")
            press(browser, Keys.ENTER)
            browser.wait(FINAL + "1")
            browser.js("ringmodalBench.giveReason(0, 'above the band of the tyre model')")
            browser.wait("return ringmodalBench.state.edits[0].reason !== ''")
            browser.find("#sign-off").click()
            browser.wait("return document.querySelector('dialog #sign')?.disabled === false")
            browser.js("document.querySelector('#signer').value = 'A. Keller'")
            photograph(browser, place, "sign_off")
            browser.driver.get(watch)
            browser.wait(READY)
            browser.wait("return document.querySelector('.advice')?.textContent.includes('run 4')")
            photograph(browser, place, "rig", 430)


if __name__ == "__main__":
    main()
