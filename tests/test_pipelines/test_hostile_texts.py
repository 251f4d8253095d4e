"""Texts of a campaign that act on terminals and spreadsheets: shown everywhere, acting nowhere."""

import csv
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from pipelines.cli import streams
from pipelines.report.page import LIBRARY
from pipelines.simulate.campaign import simulate_campaign

FORMULA = "=cmd|'C calc'!A0"
ACTING = "\\u001b]0;x\\u0007\\u202e\\u009b31m$x"
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def program(*arguments):
    """The command in a process of its own: its streams are bytes, and warnings are seen."""
    paths = os.pathsep.join([str(Path(streams.__file__).parents[2]), *sys.path])
    finished = subprocess.run(
        [sys.executable, "-m", "pipelines.cli.main", *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1", "FORCE_COLOR": ""},
        capture_output=True,
        check=False,
    )
    return finished.returncode, finished.stdout.decode(), finished.stderr.decode()


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hostile") / "campaign"
    simulate_campaign(folder, duration_s=4.0, file_format="csv")
    for path in [*folder.glob("*.csv"), folder / "campaign.toml"]:
        text = path.read_text().replace("A01", FORMULA if path.suffix == ".csv" else "A01")
        path.write_text(text)
    manifest = folder / "campaign.toml"
    text = manifest.read_text().replace("A01 =", f'"{FORMULA}" =')
    text = re.sub(r'designation = "[^"]*"', lambda _: f'designation = "{ACTING}"', text)
    text = text.replace("[tyre]", f'[tyre]\nserial = "{ACTING}"')
    manifest.write_text(text)
    return folder


@pytest.fixture(scope="module")
def result(hostile, tmp_path_factory):
    folder = tmp_path_factory.mktemp("hostile_result") / "result"
    figures = folder.parent / "figures"
    outcome = program("process", hostile, "--out", folder, "--figures", figures)
    return folder, figures, outcome


def assert_inert(path):
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.reader(file):
            for cell in row:
                acts = cell.startswith(("=", "@", "\t", "\r", "+", "-"))
                assert not acts or re.fullmatch(r"[+-]?[0-9.]+(e[+-]?[0-9]+)?", cell), cell


def test_nothing_acts_in_a_result(result):
    folder, figures, (code, output, errors) = result
    assert code == 0
    assert not CONTROL.search(output + errors)
    assert not re.search(r"\w+Warning:", errors)
    assert FORMULA in (folder / "quality.csv").read_text()
    for path in [*folder.glob("*.csv")]:
        assert_inert(path)
    texts = [*folder.glob("*.csv"), *figures.glob("*.svg")]
    assert len(texts) > 8
    for path in texts:
        assert not CONTROL.search(path.read_text(encoding="utf-8")), path.name
    vendored = (Path(streams.__file__).parents[1] / "report" / LIBRARY).read_text(encoding="utf-8")
    report = (folder / "report.html").read_text(encoding="utf-8").replace(vendored, "")
    assert "[U+001B]" in report
    assert not CONTROL.search(report)
    assert not re.search(r"\\u00[01]", report)


@pytest.mark.parametrize(
    "options", [["--format", "uff", "--text"], ["--format", "csv"], ["--format", "json"]]
)
def test_nothing_acts_in_an_export(ringmodal, result, tmp_path, options):
    folder, _, _ = result
    code, output, errors = ringmodal("export", folder, "--out", tmp_path / "out", *options)
    assert code == 0, errors
    assert not CONTROL.search(output + errors)
    for path in tmp_path.rglob("*.csv"):
        assert_inert(path)
    for path in tmp_path.rglob("*.json"):
        assert not CONTROL.search(path.read_text(encoding="utf-8"))


def test_nothing_acts_in_a_library(ringmodal, result, tmp_path):
    folder, _, _ = result
    library = ["--library", tmp_path / "library"]
    author = ["--author", "@SUM(1)", "--note", "\x1b[31m=1"]
    code, _, errors = ringmodal("tyre", "add", folder, "--tyre", "t", *library, *author)
    assert code == 0, errors
    for command in (["list"], ["show", "t"], ["history", "t"]):
        code, shown, errors = ringmodal("tyre", *command, *library)
        assert not CONTROL.search(shown + errors)
    code, _, errors = ringmodal("tyre", "table", *library, "--out", tmp_path / "t.csv")
    assert code == 0, errors
    assert "@SUM(1)" in (tmp_path / "t.csv").read_text()
    assert_inert(tmp_path / "t.csv")


def test_inspect_shows_them(hostile):
    _, output, errors = program("inspect", hostile, "--headers")
    assert FORMULA in output
    assert not CONTROL.search(output + errors)
