"""Screenshots of sections of the report for the tutorial: ``python docs/screenshots.py [BROWSER]``.

Needs Chromium or Chrome. Each section is shown alone, in a window of its height.
"""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from pipelines.process.run import process
from pipelines.report.write import render_report

DOCS = Path(__file__).parent
SAMPLE = DOCS.parent / "sample_data" / "tyre_225_55R17"
PICTURES = DOCS / "images" / "tutorial"
WIDTH = 1200
# Section of the report → height of its picture in pixels; below it the section may go on.
HEIGHTS = {
    "summary": 580,
    "setup": 610,
    "quality": 1080,
    "stability": 632,
    "modes": 445,
    "frf": 680,
    "shapes": 720,
    "validation": 520,
    "parameters": 470,
}
LOADED_MS = 5000


def photograph(page: Path, picture: Path, height: int, browser: str) -> None:
    """Store what a browser shows of a page."""
    command = [
        browser,
        "--headless",
        "--no-sandbox",
        "--hide-scrollbars",
        f"--window-size={WIDTH},{height}",
        f"--virtual-time-budget={LOADED_MS}",
        f"--screenshot={picture}",
        page.as_uri(),
    ]
    subprocess.run(command, check=True, capture_output=True)


def alone(report: str, section: str) -> str:
    """The report with one section to be seen."""
    style = (
        "body > header, body > nav, footer, section { display: none } "
        "body, main { padding-block: 0 !important; margin-block: 0 !important } "
        f"section#{section} {{ display: block; margin-block: 0; border: 0; padding-block: 0 }}"
    )
    return report.replace("</head>", f"<style>{style}</style></head>")


def main(browser: str = "chromium") -> None:
    """Write the pictures of the tutorial."""
    report = render_report(process(SAMPLE))
    PICTURES.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as folder:
        page = Path(folder) / "report.html"
        for section, height in HEIGHTS.items():
            page.write_text(alone(report, section), encoding="utf-8")
            photograph(page, PICTURES / f"{section}.png", height, browser)


if __name__ == "__main__":
    main(*sys.argv[1:])
