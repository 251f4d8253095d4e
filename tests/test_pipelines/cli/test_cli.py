"""The command line: results, exit codes, and one message for each kind of bad input."""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

from pipelines.cli import main as cli
from pipelines.cli import start
from pipelines.simulate import campaign as simulated

pytestmark = pytest.mark.usefixtures("modes_once")


@pytest.fixture
def out(tmp_path):
    (tmp_path / "results").mkdir()
    return tmp_path / "results" / "result"


@pytest.fixture
def processed(ringmodal, short_campaign, out):
    """A stored result without report."""
    code, _, _ = ringmodal("process", short_campaign, "--out", out, "--no-report", "--quiet")
    assert code == 0
    return out


def assert_refused(outcome, out, *says):
    """Exit code 2, one message that says where, what, which rule and what to do; nothing left."""
    code, output, errors = outcome
    assert code == 2
    assert output == ""
    assert "Traceback" not in errors
    lines = errors.strip().splitlines()
    assert len(lines) == 1
    assert re.fullmatch(r"Error: .+: .+; .+\. .+[.?]", lines[0])
    for words in says:
        assert words in lines[0]
    assert list(out.parent.iterdir()) == []


def test_process_writes_a_result_and_says_where(ringmodal, short_campaign, out):
    code, output, errors = ringmodal("--verbose", "process", short_campaign, "--out", out)
    assert code == 0
    assert re.search(r"^frf took \d+\.\d\d s$", errors, re.MULTILINE)
    assert f"Result: {out}" in output
    assert f"Report: {out / 'report.html'}" in output
    assert (out / "report.html").is_file()
    assert errors.startswith("Reading")
    assert [path.name for path in out.parent.iterdir()] == ["result"]


def test_no_report_stops_before_the_report_and_quiet_tells_no_progress(processed):
    assert (processed / "modes.csv").is_file()
    assert not (processed / "report.html").exists()


def test_json_is_all_there_is_on_standard_output(ringmodal, short_campaign, out):
    code, output, errors = ringmodal(
        "process", short_campaign, "--out", out, "--no-report", "--json"
    )
    assert code == 0
    content = json.loads(output)
    assert [mode["order"] for mode in content["modes"]][:7] == [1, 2, 3, 4, 5, 6, 7]
    assert content["modes"][0]["frequency_hz"] == pytest.approx(78.73, rel=2e-3)
    assert content["ring"]["radial_stiffness_n_m3"]["value"] > 0
    assert content["result"] == str(out)
    assert "Reading" in errors


def test_options_reach_the_result(ringmodal, short_campaign, out):
    code, _, _ = ringmodal(
        *("process", short_campaign, "--out", out, "--no-report", "--quiet"),
        *("--averages", 4, "--window", "boxcar", "--band-hz", 60, 240, "--estimator", "Hv"),
        *("--max-order", 40, "--pin", "100.3,145.4", "--no-tune"),
    )
    assert code == 0
    options = json.loads((out / "provenance.json").read_text())["options"]
    assert options["processing"]["averages_per_run"] == 4
    assert options["processing"]["window"] == "boxcar"
    assert options["processing"]["band_hz"] == [60, 240]
    assert (options["estimator"], options["max_order"]) == ("Hv", 40)
    assert options["pinned_hz"] == [100.3, 145.4]
    assert not (out / "tyre.toml").exists()


def test_tune_again_with_other_options(ringmodal, processed):
    before = (processed / "modes.csv").read_bytes()
    code, output, _ = ringmodal(
        *("tune", processed, "--given", "mass_per_area_kg_m2=19.69", "--no-report", "--json")
    )
    assert code == 0
    ring = json.loads(output)["ring"]
    assert ring["mass_per_area_kg_m2"]["value"] == 19.69
    assert ring["mass_per_area_kg_m2"]["how"] == "given"
    stored = tomllib.loads((processed / "tyre.toml").read_text())
    assert stored["ring"]["mass_per_area_kg_m2"]["value"] == 19.69
    assert (processed / "modes.csv").read_bytes() == before
    options = json.loads((processed / "provenance.json").read_text())["options"]
    assert options["given"] == {"mass_per_area_kg_m2": 19.69}


def test_report_again_keeps_everything_else(ringmodal, processed):
    before = {path.name: path.read_bytes() for path in processed.glob("*.csv")}
    tyre = (processed / "tyre.toml").read_bytes()
    code, output, _ = ringmodal("report", processed)
    assert code == 0
    assert f"Report: {processed / 'report.html'}" in output
    assert {path.name: path.read_bytes() for path in processed.glob("*.csv")} == before
    assert (processed / "tyre.toml").read_bytes() == tyre


def test_commands_say_for_programs_what_they_wrote(ringmodal, short_campaign, processed, tmp_path):
    again = json.loads(ringmodal("report", processed, "--json")[1])
    assert again["report"] == str(processed / "report.html")
    assert again["modes"][0]["order"] == 1
    arguments = ("simulate", "campaign", tmp_path / "virtual", "--duration-s", 1, "--json")
    assert json.loads(ringmodal(*arguments)[1]) == {"campaign": str(tmp_path / "virtual")}


def test_figures_stand_beside_the_result(ringmodal, processed, tmp_path, monkeypatch):
    """Drawing them takes its time and is tested by itself."""
    pictures = tmp_path / "pictures"

    def draw(result, folder, formats, *, force):
        folder.mkdir(exist_ok=True)
        (folder / "stability.png").write_text(f"{result.name}, {' '.join(formats)}, force {force}")

    monkeypatch.setattr("pipelines.cli.result.write_figures", draw)
    assert ringmodal("report", processed, "--figures", pictures)[0] == 0
    assert (pictures / "stability.png").read_text() == "campaign, png svg, force False"
    code, _, errors = ringmodal("report", processed, "--figures", pictures)
    assert code == 2
    assert "--force" in errors
    assert ringmodal("report", processed, "--figures", pictures, "--gif", "--force")[0] == 0
    assert (pictures / "stability.png").read_text() == "campaign, png svg gif, force True"
    code, _, errors = ringmodal("report", processed, "--gif")
    assert code == 2
    assert "Add --figures" in errors


@pytest.mark.parametrize("place", ["", "pictures"])
def test_figures_are_kept_out_of_the_result(ringmodal, short_campaign, out, place):
    arguments = ("--figures", out / place, "--quiet")
    outcome = ringmodal("process", short_campaign, "--out", out, *arguments)
    assert_refused(outcome, out, "inside the result's folder", "beside it")


def test_a_pdf_that_cannot_be_made_is_refused_before_the_processing(
    ringmodal, short_campaign, out, monkeypatch
):
    monkeypatch.setitem(sys.modules, "weasyprint", None)  # as if it were not installed
    outcome = ringmodal("process", short_campaign, "--out", out, "--pdf", "--quiet")
    assert_refused(outcome, out, "--pdf", "weasyprint", 'pip install "weasyprint>=68"')


def test_a_pdf_is_part_of_the_result_and_stays_so(ringmodal, processed, monkeypatch):
    """Printing it takes its time and is tested by itself."""
    monkeypatch.setitem(sys.modules, "weasyprint", ModuleType("weasyprint"))
    monkeypatch.setattr(
        "pipelines.report.write.write_pdf", lambda result, path, template: path.write_bytes(b"%PDF")
    )
    code, output, _ = ringmodal("report", processed, "--pdf")
    assert code == 0
    assert f"PDF: {processed / 'report.pdf'}" in output
    files = json.loads((processed / "provenance.json").read_text())["files"]
    assert "report.pdf" in files
    code, output, _ = ringmodal("tune", processed, "--json")
    assert json.loads(output)["pdf"] == str(processed / "report.pdf")
    assert (processed / "report.pdf").is_file()


def test_two_results_are_compared(ringmodal, processed, tmp_path):
    page = tmp_path / "comparison.html"
    code, output, _ = ringmodal("compare", processed, processed, "--out", page)
    assert code == 0
    assert "No frequency differs significantly" in output
    assert output.strip().splitlines()[-1] == f"Report: {page}"
    assert page.is_file()
    assert ringmodal("compare", processed, processed, "--out", page)[0] == 2
    code, _, errors = ringmodal("compare", processed, processed, "--out", page.with_suffix(""))
    assert (code, "(no ending)" in errors) == (2, True)
    arguments = ("compare", processed, processed, "--out", page, "--force", "--json")
    content = json.loads(ringmodal(*arguments)[1])
    assert content["modes"][0]["frequency_hz"]["difference"] == 0
    several = ("compare", processed, processed, processed, "--out", page, "--force", "--json")
    assert len(json.loads(ringmodal(*several)[1])["comparisons"]) == 2


def test_what_the_data_do_not_tell_is_a_warning(ringmodal, short_campaign, out):
    arguments = (
        "process",
        short_campaign,
        "--out",
        out,
        "--averages",
        1,
        "--no-report",
        "--no-tune",
    )
    code, _output, errors = ringmodal(*arguments)
    assert code == 0
    assert "Warning: Averages: a single average" in errors
    outcome = ringmodal(*arguments, "--force", "--quiet")
    assert outcome == (0, "", "")


def test_an_existing_result_asks_for_force(ringmodal, short_campaign, processed):
    before = (processed / "provenance.json").read_bytes()
    arguments = ("process", short_campaign, "--out", processed, "--no-report", "--quiet")
    code, _, errors = ringmodal(*arguments)
    assert code == 2
    assert "--force" in errors
    assert (processed / "provenance.json").read_bytes() == before
    assert ringmodal(*arguments, "--no-tune", "--force")[0] == 0
    assert not (processed / "tyre.toml").exists()


def test_inspect_lists_the_channels(ringmodal, short_campaign):
    code, output, _ = ringmodal("inspect", short_campaign / "config_1.uff", "--json")
    assert code == 0
    channels = {channel["channel"]: channel for channel in json.loads(output)}
    assert len(channels) == 14
    assert channels["force"]["mean"] == pytest.approx(50, abs=1)  # the preload
    assert channels["force"]["quantity"] == "force"
    assert channels["A01"]["sampling_rate_hz"] == 2000


def test_demo_ends_by_naming_the_report(ringmodal, short_campaign, tmp_path, monkeypatch):
    monkeypatch.setattr(start, "sample_campaign", lambda out: short_campaign)
    code, output, _ = ringmodal("demo", "--out", tmp_path / "demo")
    report = tmp_path / "demo" / "result" / "report.html"
    assert code == 0
    assert output.strip().splitlines()[-1] == f"Report: {report}"
    assert report.is_file()


def test_the_demo_takes_the_sample_campaign(sample_campaign, tmp_path):
    assert simulated.sample_campaign(tmp_path).resolve() == sample_campaign.resolve()


def test_help_names_every_command(ringmodal):
    code, output, _ = ringmodal("--help")
    assert code == 0
    for command in ("demo", "inspect", "process", "tune", "report", "simulate"):
        assert command in output


@pytest.mark.parametrize("name", ["nowhere", "nowhere.uff", "nowhere.toml"])
def test_a_missing_campaign(ringmodal, tmp_path, out, name):
    assert_refused(ringmodal("process", tmp_path / name, "--out", out, "--quiet"), out, name)


def test_a_missing_recording(ringmodal, campaign_copy, out):
    (campaign_copy / "config_3.uff").unlink()
    outcome = ringmodal("process", campaign_copy, "--out", out, "--quiet")
    assert_refused(outcome, out, "campaign.toml, runs.3.file", "'config_3.uff'", "does not exist")


def test_an_empty_recording(ringmodal, campaign_copy, out):
    (campaign_copy / "config_3.uff").write_bytes(b"")
    outcome = ringmodal("process", campaign_copy, "--out", out, "--quiet")
    assert_refused(outcome, out, "config_3.uff", "empty")


def test_a_truncated_recording(ringmodal, campaign_copy, out):
    recording = campaign_copy / "config_3.uff"
    recording.write_bytes(recording.read_bytes()[:200_000])
    outcome = ringmodal("process", campaign_copy, "--out", out, "--quiet")
    assert_refused(
        outcome, out, "config_3.uff, dataset 7", "388 of 8000 values", "truncated", "again"
    )


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('channel = "force"', 'channel = "Force1"', ("'Force1'", "Did you mean 'force'")),
        ("A01 = 0.0", "B01 = 0.0", ("positions_deg", "'B01'", "Did you mean 'A01'")),
        ('reference = "REF"', 'reference = "REV"', ("'REV'", "Did you mean 'REF'")),
        ("rate_hz = 2000.0", "rate_hz = 2048.0", ("sampling_rate_hz", "2048 Hz", "2000 Hz")),
        ("inflation_pressure_pa = 220000.0\n", "", ("[tyre]", "no inflation_pressure_pa")),
        ("mean_radius_m = 0.33\n", "", ("[tyre]", "no mean_radius_m")),
        ("schema = 1", "schema = ", ("campaign.toml", "TOML")),
        ("positions = 72", "positions = 72\nspacing = 5", ("'spacing'", "not known")),
        ("A04 = ", "A13 = ", ("'A13'", "A04.")),  # all others have their places
        ('"config_2.uff"', '"runs\\config_2.uff"', ("written with /",)),
        ('"config_2.uff"', '"runs\\new.uff"', ("runs.2.file", "backslash", "written with /")),
        ("positions_deg = {", "positions_deg = <deg> {", ("angle brackets",)),
        ("sampling_rate_hz = 2000.0", "sampling_rate_hz = 2000,5", ("not a comma",)),
    ],
)
def test_a_manifest_with_a_fault(ringmodal, edit_manifest, out, old, new, says):
    campaign = edit_manifest(old, new)
    assert_refused(ringmodal("process", campaign, "--out", out, "--quiet"), out, *says)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--window", "hahn"], ("window", "'hahn'")),
        (["--estimator", "H3"], ("'H3'", "H1, H2, Hv")),
        (["--averages", 3, "--block-seconds", 1], ("averages 3", "block_seconds 1")),
        (["--block-seconds", 60], ("60 s", "4 s")),
        (["--band-hz", 200, 50], ("band_hz", "200 to 50 Hz")),
        (["--pin", "78;100"], ("--pin", "'78;100'", "commas")),
        (["--given", "mass=heavy"], ("--given", "'mass=heavy'")),
        (["--given", "mass_per_area=19"], ("'mass_per_area'",)),
        (["--objective", "papers"], ("'papers'", "paper")),
    ],
)
def test_options_that_make_no_sense(ringmodal, short_campaign, out, arguments, says):
    outcome = ringmodal("process", short_campaign, "--out", out, "--quiet", *arguments)
    assert_refused(outcome, out, *says)


@pytest.mark.parametrize("arguments", [["--pin", 30], ["--band-hz", 100, 103]])
def test_an_identification_that_cannot_be_done(ringmodal, short_campaign, out, arguments):
    code, _, errors = ringmodal("process", short_campaign, "--out", out, "--quiet", *arguments)
    assert code == 2
    assert errors.startswith("Error: ")
    assert list(out.parent.iterdir()) == []


def test_a_place_that_cannot_be_written(ringmodal, short_campaign, tmp_path):
    (tmp_path / "file").write_text("")
    arguments = ("--out", tmp_path / "file" / "result", "--no-report", "--quiet")
    code, _, errors = ringmodal("process", short_campaign, *arguments)
    assert code == 2
    assert "could not be written" in errors
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_tune_and_report_ask_for_a_result(ringmodal, tmp_path):
    for command in ("tune", "report"):
        code, _, errors = ringmodal(command, tmp_path)
        assert code == 2
        assert "Run `ringmodal process`" in errors


def test_a_fault_of_the_program_is_not_dressed_as_bad_input(monkeypatch, short_campaign, out):
    """It ends with a traceback and, outside of tests, exit code 1."""

    def fail(*_, **__):
        raise RuntimeError("a fault")

    monkeypatch.setattr("pipelines.cli.result.run", fail)
    monkeypatch.setattr(
        sys, "argv", ["ringmodal", "process", str(short_campaign), "--out", str(out)]
    )
    with pytest.raises(RuntimeError, match="a fault"):
        cli.main()
    assert list(out.parent.iterdir()) == []


def test_the_program_itself_ends_with_code_2_and_a_message(tmp_path):
    finished = subprocess.run(
        [sys.executable, "-m", "pipelines.cli.main", "process", "nowhere", "--out", "result"],
        cwd=tmp_path,
        env={"PYTHONPATH": str(Path(cli.__file__).parents[2]), "PATH": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 2
    assert finished.stdout == ""
    assert finished.stderr.splitlines()[-1].startswith("Error: ")
    assert "nowhere" in finished.stderr
    assert list(tmp_path.iterdir()) == []
