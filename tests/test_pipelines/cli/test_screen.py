"""What is printed fits: the width of the screen, a pipe, a console with few characters."""

import io
import json
import re
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from ema.core.finding import Check, Finding, Verdict
from pipelines.cli import streams, terminal
from pipelines.cli.result import show
from pipelines.cli.screen import print_table, screen
from pipelines.results.options import Units

HEAD = ("mode", "frequency in Hz", "status", "purity", "remark")
ROWS = (
    ("1", "78.728 ± 0.005", "pair not resolvable", "1.000", ""),
    ("2", "100.310 ± 0.004", "ok", "0.998", ""),
)
LOOKS = {"texts": ("status", "remark"), "folding": ("status",), "first_to_go": ("purity", "mode")}


@pytest.fixture
def printed(monkeypatch, capsys):
    """Print on a screen of some width; the lines."""

    def lines(columns, print_on):
        if columns is None:
            monkeypatch.delenv("COLUMNS", raising=False)
        else:
            monkeypatch.setenv("COLUMNS", str(columns))
        print_on()
        return [line.rstrip() for line in capsys.readouterr().out.splitlines()]

    return lines


def test_a_wide_screen_shows_all_columns_that_have_content(printed):
    lines = printed(120, lambda: print_table("Modes", HEAD, ROWS, **LOOKS))
    assert lines[0] == "Modes"
    assert lines[2].split() == ["mode", "frequency", "in", "Hz", "status", "purity"]
    assert not any("Not shown" in line for line in lines)


def test_columns_go_in_the_stated_order_and_are_named(printed):
    lines = printed(40, lambda: print_table("", HEAD, ROWS, **LOOKS))
    assert lines[1].split() == ["mode", "frequency", "in", "Hz", "status"]
    assert "Not shown, the screen is too narrow: purity." in " ".join(lines)
    assert "pair not" in " ".join(" ".join(lines).split())


@pytest.mark.parametrize("columns", [20, 30, 60, 80, 120])
def test_nothing_is_cut_off(printed, columns):
    """Where no more columns may go, cells take several lines."""
    lines = printed(columns, lambda: print_table("", HEAD, ROWS, **LOOKS))
    assert max(map(len, lines)) <= columns
    letters = "".join("".join(lines).split())
    assert "…" not in letters
    cells = "".join("".join(cell for row in ROWS for cell in row[1:3]).split())
    assert Counter(cells) <= Counter(letters)


@pytest.mark.parametrize("columns", [60, 80, 120])
def test_a_result_fits_the_screen(printed, sample_result, columns):
    lines = printed(columns, lambda: show(sample_result, Path("r"), as_json=False, report=True))
    assert max(map(len, lines)) <= columns
    letters = "".join(" ".join(lines).split())
    first = f"{sample_result.modal_model.modes[0].frequency_hz:.1f}"
    for value in (first, "±0.0034", "notidentified", "Report:r"):
        assert value in letters or columns == 60
    assert "…" not in letters


def test_a_pipe_has_no_edge(printed, monkeypatch):
    long_text = "word " * 60
    lines = printed(None, lambda: screen().print(long_text))
    assert len(lines) == 1


def test_colours_are_for_terminals_and_those_who_ask(monkeypatch):
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    assert screen().color_system is None
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert screen().is_terminal
    monkeypatch.setenv("NO_COLOR", "1")
    assert screen().no_color


@pytest.mark.parametrize(
    ("text", "cp1252", "plain"),
    [
        ("0.5 ± 0.1 °", b"0.5 \xb1 0.1 \xb0", b"0.5 +/- 0.1  deg"),
        ("−0.5 → 2", b"-0.5 -> 2", b"-0.5 -> 2"),
        ("8 × 10⁶", b"8 \xd7 10^6", b"8 x 10^6"),
        ("10⁻⁴", b"10^-4", b"10^-4"),
        ("轮胎", b"??", b"??"),
    ],
)
def test_characters_that_a_console_lacks_are_written_otherwise(monkeypatch, text, cp1252, plain):
    for encoding, expected in (("cp1252", cp1252), ("ascii", plain), ("utf-8", text.encode())):
        raw = io.BytesIO()
        monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding=encoding))
        streams.tolerant_output()
        terminal.echo(text)
        sys.stdout.flush()
        assert raw.getvalue().rstrip() == expected


def test_which_signs_of_results_a_console_lacks():
    assert streams.lacking("utf-8") == ""
    assert streams.lacking("cp1252") == "→−⁶"


def test_help_appears_on_an_old_console():
    finished = subprocess.run(
        [sys.executable, "-m", "pipelines.cli.main", "process", "--help"],
        env={"PYTHONIOENCODING": "cp1252", "PYTHONPATH": str(Path(terminal.__file__).parents[2])},
        capture_output=True,
        check=False,
    )
    assert finished.returncode == 0
    assert b"Recordings -> FRFs" in finished.stdout


def test_a_warning_names_its_check_once(sample_result, capsys):
    finding = Finding("", "reference", None, Check.REFERENCE, Verdict.WARNING, "the tyre changed")
    result = replace(sample_result, findings=(finding,))
    show(result, Path("r"), as_json=False, report=True)
    assert "Warning: Reference: the tyre changed." in capsys.readouterr().err


def test_a_clean_run_prints_tables_verdict_and_files_and_no_notes(
    sample_result, capsys, monkeypatch
):
    monkeypatch.setenv("COLUMNS", "160")
    show(sample_result, Path("r"), as_json=False, report=True)
    output, errors = capsys.readouterr()
    assert [line.split(":")[0] for line in output.splitlines()[-3:]] == [
        *("Verdict", "Result", "Report")
    ]
    assert "inflation pressure p₀" in output
    assert re.search(r"p₀ +2\.200 ± 0\.022 +bar", output)
    assert "Note" not in errors
    show(sample_result, Path("r"), as_json=False, report=True, units=Units.SI)
    assert re.search(r"p₀ +220\.0 ± 2\.2 +kPa", capsys.readouterr().out)


def test_inspect_names_files_with_their_folder(ringmodal, short_campaign):
    _, output, _ = ringmodal("inspect", short_campaign, "--headers")
    assert output.startswith(str(short_campaign / "config_1.uff"))
    _, output, _ = ringmodal("inspect", short_campaign, "--headers", "--json")
    assert json.loads(output)[0]["path"] == str(short_campaign / "config_1.uff")


def test_init_says_what_to_fill_in_and_what_comes_next(ringmodal, campaign_copy):
    (campaign_copy / "campaign.toml").unlink()
    code, output, _ = ringmodal("init", campaign_copy, "--json")
    assert code == 0
    content = json.loads(output)
    assert content["draft"] == str(campaign_copy / "campaign.toml")
    assert "inflation_pressure_pa" in content["to_fill_in"][0]
    _, output, _ = ringmodal("init", campaign_copy, "--force")
    assert f"ringmodal process {campaign_copy} --out result" in output.splitlines()[-1]
