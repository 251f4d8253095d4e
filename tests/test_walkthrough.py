"""The page on adding things is true: its changes are made to a copy of the packages, and work."""

import csv
import json
import os
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from docs_pages import ROOT, blocks_of, name_of

from ema.io.formats import read_file

PAGE = ROOT / "docs" / "dev" / "adding.md"
PACKAGES = ("ema", "model", "pipelines", "ringmodal")
DEV_PAGES = sorted((ROOT / "docs" / "dev").glob("*.md"))
NAMED = re.compile(r"`((?:ema|model|pipelines|ringmodal)/[\w/]+\.pyi?)`,\s+`(\w+)`")


def edited(folder, diff):
    """Apply a diff whose hunks need no line numbers: what they show must be there once."""
    old, new, *lines = diff.splitlines()
    assert old.startswith("--- ")
    path = folder / new.removeprefix("+++ b/")
    if old == "--- /dev/null":
        assert not path.exists()
        path.write_text("\n".join(line[1:] for line in lines) + "\n", encoding="utf-8")
        return
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / new.removeprefix("+++ b/"), path)
    text = path.read_text(encoding="utf-8")
    for hunk in "\n".join(lines).split("\n@@\n"):
        marked = [(line[:1], line[1:]) for line in hunk.splitlines()]
        before = "".join(f"{line}\n" for mark, line in marked if mark != "+")
        after = "".join(f"{line}\n" for mark, line in marked if mark != "-")
        assert text.count(before) == 1, f"{path.name} does not hold this once:\n{before}"
        text = text.replace(before, after)
    path.write_text(text, encoding="utf-8")


@pytest.fixture(scope="module")
def changed(tmp_path_factory):
    """The packages with every change of the page."""
    folder = tmp_path_factory.mktemp("walk")
    for package in PACKAGES:
        shutil.copytree(
            ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    for block in blocks_of(PAGE):
        if block.language == "diff":
            edited(folder, block.text)
    return folder


@pytest.fixture(scope="module")
def outcome(changed, short_campaign):
    """A campaign whose first run is in the new format, through the changed program."""
    campaign = changed / "campaign"
    shutil.copytree(short_campaign, campaign)
    recorded = next(iter(sorted(campaign.glob("config_1.*"))))
    recording = read_file(recorded).recording
    channels = [
        {"name": each.name, "unit": each.unit, "samples": each.samples.tolist()}
        for each in recording.channels
    ]
    stored = {"rate_hz": recording.sampling_rate_hz, "channels": channels}
    (campaign / "config_1.logjson").write_text(json.dumps(stored), encoding="utf-8")
    recorded.unlink()
    manifest = campaign / "campaign.toml"
    text = manifest.read_text(encoding="utf-8").replace(recorded.name, "config_1.logjson")
    manifest.write_text(text, encoding="utf-8")
    command(changed, "process", "campaign", "--out", "result", "--no-report")
    command(changed, "export", "result", "--out", "modes.md")
    return changed


def command(folder, *words):
    environment = {**os.environ, "PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1"}
    ran = subprocess.run(
        [sys.executable, "-m", "pipelines.cli.main", *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr


def rows(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_the_new_format_is_read(outcome):
    record = json.loads((outcome / "result" / "provenance.json").read_text(encoding="utf-8"))
    assert "config_1.logjson" in {entry["file"] for entry in record["inputs"]}
    assert len(rows(outcome / "result" / "modes.csv")) >= 7


def test_the_new_check_is_in_the_quality_table(outcome):
    found = [row for row in rows(outcome / "result" / "quality.csv") if row["check"] == "frf noise"]
    assert len(found) == 72
    assert {row["verdict"] for row in found} == {"ok"}


def test_the_new_column_is_in_the_mode_table(outcome):
    for row in rows(outcome / "result" / "modes.csv"):
        bandwidth = 2 * float(row["damping_ratio"]) * float(row["frequency_hz"])
        assert np.isclose(float(row["bandwidth_hz"]), bandwidth, rtol=1e-12)


def test_the_new_exporter_writes_its_file(outcome):
    lines = (outcome / "modes.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 2 + len(rows(outcome / "result" / "modes.csv"))


def test_a_change_that_does_not_fit_is_noticed(tmp_path):
    (tmp_path / "a.py").write_text("one = 1\n", encoding="utf-8")
    with pytest.raises(AssertionError, match="does not hold"):
        edited(tmp_path, "--- a/a.py\n+++ b/a.py\n-two = 2\n+two = 3\n")


@pytest.mark.parametrize("page", DEV_PAGES, ids=name_of)
def test_functions_named_on_a_page_are_in_the_file_named(page):
    for path, name in NAMED.findall(page.read_text(encoding="utf-8")):
        text = (ROOT / path).read_text(encoding="utf-8")
        defined = rf"^\s*(?:def|class) {name}\b|^{name}\b.*="
        assert re.search(defined, text, re.MULTILINE), f"{page.name}: {name} is not in {path}"
