"""``ringmodal tyre``: what it prints, for people and programs, and how it refuses."""

import json

import pyarrow.parquet as pq
import pytest
from library import SET, doubted, varied, written

from model.verdict import Reason


@pytest.fixture
def tyre(ringmodal, tmp_path, monkeypatch):
    """Run ``ringmodal tyre`` with a library of two versions, at two pressures."""
    monkeypatch.setenv("RINGMODAL_LIBRARY", str(tmp_path / "library"))
    monkeypatch.setenv("COLUMNS", "200")

    def run(*arguments):
        return ringmodal("tyre", *arguments)

    for parameters in (SET, varied("2", 250000.0, radial_stiffness_n_m3=8.5e6)):
        path = written(tmp_path / "set.toml", parameters)
        assert run("add", path, "--author", "Ada", "--note", "new contour")[0] == 0
    return run


def as_json(outcome):
    code, output, errors = outcome
    assert code == 0, errors
    return json.loads(output)


def assert_refused(outcome, *expected):
    code, output, errors = outcome
    assert code == 2
    assert output == ""
    (line,) = errors.strip().splitlines()
    assert line.startswith("Error: ")
    for words in expected:
        assert words in line


def test_a_result_is_added_and_shown(ringmodal, sample_folder, tmp_path):
    library = ("--library", tmp_path / "library")
    code, output, _ = ringmodal(
        *("tyre", "add", sample_folder, *library, "--condition", "temperature_c=21.5")
    )
    assert (code, output.strip()) == (0, "Added: 225-55R17@1")
    code, output, _ = ringmodal("tyre", "show", "225/55R17", *library)
    assert code == 0
    assert "Standing: the newest; no version is approved" in output
    assert "Condition: temperature_c = 21.5" in output
    assert "tyre_225_55R17" in output
    assert "radial stiffness k_r" in output


def test_list_and_history(tyre):
    tyre("approve", "225-55R17@1", "--note", "checked")
    _, output, _ = tyre("list")
    assert "225-55R17" in output
    assert "2.20, 2.50" in output
    _, output, _ = tyre("history", "225/55R17")
    assert "new contour" in output
    assert "radial_stiffness_n_m3 +6.2 % (z = +3.5)" in output
    (listed,) = as_json(tyre("list", "--json"))
    assert (listed["versions"], listed["approved"]) == (2, 1)
    record = as_json(tyre("history", "225-55R17", "--json"))
    assert [line["approval"] for line in record["history"]] == ["approved", ""]


def test_approve_show_and_rollback(tyre):
    for number in (1, 2):
        assert as_json(tyre("approve", f"225-55R17@{number}", "--json"))["version"] == number
    assert as_json(tyre("show", "225-55R17", "--json"))["version"] == 2
    assert tyre("rollback", "225-55R17", "--note", "not released")[1] == (
        "Rolled back to: 225-55R17@1\n"
    )
    shown = as_json(tyre("show", "225-55R17", "--json"))
    assert (shown["version"], shown["entry"]["note"]) == (1, "new contour")
    assert "not released; 1 newer not approved" in shown["standing"]


def test_a_verdict_that_is_not_good_is_shown_and_must_be_accepted(tyre, tmp_path):
    path = written(tmp_path / "bad.toml", doubted())
    code, output, errors = tyre("add", path)
    assert (code, output) == (2, "") and "--accept-warnings" in errors
    assert tyre("add", written(tmp_path / "doubt.toml", doubted(Reason.UNTESTED)))[0] == 0
    code, _, errors = tyre("add", path, "--accept-warnings")
    assert code == 0 and "Verdict: bad: two modes of order 1" in errors
    code, output, errors = tyre("approve", "225-55R17@4")
    assert (code, output) == (2, "") and "--accept-warnings" in errors
    assert "no version is approved" in tyre("show", "225-55R17@4")[1]
    assert tyre("approve", "225-55R17@4", "--accept-warnings")[0] == 0
    _, output, errors = tyre("show", "225-55R17")
    assert "accepted as bad: two modes" in output and "Verdict: bad" in output
    assert "Warning: hum" in errors
    record = as_json(tyre("show", "225-55R17", "--json"))
    assert (record["verdict"]["state"], record["model"]["pressure_load"]) == ("bad", "dead")
    lines = as_json(tyre("history", "225-55R17", "--json"))["history"]
    assert [line["verdict"] for line in lines] == [None, None, "doubtful", "bad"]
    assert {row["verdict"] for row in as_json(tyre("table", "--json"))} == {"", "doubtful", "bad"}
    assert "Verdict: bad" in tyre("export", "225-55R17", "--out", tmp_path / "x.toml")[2]
    both = "225-55R17@1", "225-55R17"
    assert "B: 225-55R17@4 (verdict bad: two modes" in tyre("diff", *both)[1]
    assert as_json(tyre("diff", *both, "--json"))["second_verdict"] == "bad"


def test_a_series_of_sets_in_doubt_is_drawn_where_that_is_accepted(tyre, tmp_path):
    later = varied("3", 280000.0, radial_stiffness_n_m3=8.7e6)
    tyre("add", written(tmp_path / "bad.toml", doubted(parameters=later)), "--accept-warnings")
    drawn = "series", "225-55R17", "--out", tmp_path / "series.png"
    code, _, errors = tyre(*drawn)
    assert code == 2 and "Version 3: verdict bad" in errors and "--accept-warnings" in errors
    assert not drawn[-1].exists()
    assert tyre(*drawn, "--accept-warnings")[0] == 0 and drawn[-1].exists()
    assert any("bad" in note for note in as_json(tyre(*drawn[:2], "--json"))["notes"])


def test_diff_of_versions_and_files(tyre, tmp_path):
    _, output, _ = tyre("diff", "225-55R17@1", "225-55R17@2")
    assert "Condition: inflation_pressure_pa: 220000 in A, 250000 in B" in output
    assert "significant" in output
    assert "not tested (given)" in output
    record = as_json(tyre("diff", "225-55R17@1", tmp_path / "set.toml", "--json"))
    (radial,) = (p for p in record["parameters"] if p["parameter"] == "radial_stiffness_n_m3")
    assert radial["z"] == pytest.approx(3.5355, rel=1e-4)
    assert radial["verdict"] == "significant"


def test_export_table_and_series(tyre, tmp_path):
    assert as_json(tyre("export", "225-55R17@2", "--out", tmp_path / "x.json", "--json")) == {
        "file": str(tmp_path / "x.json"),
        "set": "225-55R17@2",
        "format": "json",
    }
    assert tyre("table", "--out", tmp_path / "t.parquet", "--wide")[0] == 0
    assert pq.read_table(tmp_path / "t.parquet")["version"].to_pylist() == [1, 2]
    assert len(as_json(tyre("table", "225-55R17", "--json"))) == 20
    code, output, _ = tyre("table", "--wide")
    assert (code, output.count("225-55R17@2")) == (0, 10)
    code, output, errors = tyre("series", "225-55R17", "--out", tmp_path / "s.svg")
    assert (code, "slope per bar" in output) == (0, True)
    assert "Not identified at two pressures" in errors
    assert (tmp_path / "s.svg").is_file()
    record = as_json(tyre("series", "225-55R17", "--parameter", "loss_factor", "--json"))
    assert record["trends"][0]["pressure_pa"] == [220000.0, 250000.0]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("show", "225/65R17"), "Did you mean '225-55R17'"),
        (("show", "225-55R17@7"), "The newest is 225-55R17@2"),
        (("show", "225-55R17@x"), "Write e.g. 225-55R17@1"),
        (("approve", "225-55R17"), "tyre approve 225-55R17@1"),
        (("rollback", "225-55R17"), "no earlier approval"),
        (("diff", "225-55R17@1", "nowhere"), "225-55R17"),
        (("series", "225-55R17", "--parameter", "los_factor"), "Did you mean 'loss_factor'"),
        (("series", "225-55R17", "--out", "s.pdf"), "it must be one of .png, .svg, .html"),
        (("table", "--out", "t.xlsx"), "it must be one of .csv, .parquet"),
        (("export", "225-55R17", "--out", "x.toml", "--format", "jsn"), "Did you mean 'json'"),
        (("add", "nowhere.toml"), "nowhere.toml"),
        (("list", "--library", "nowhere"), "`ringmodal tyre add`"),
    ],
)
def test_bad_input_names_what_to_do(tyre, arguments, expected):
    assert_refused(tyre(*arguments), expected)


def test_an_unknown_unit_is_a_usage_error_that_lists_the_units(tyre):
    code, output, errors = tyre("series", "225-55R17", "--pressure-unit", "mbar")
    assert (code, output) == (2, "")
    assert "kPa" in errors


def test_a_missing_library_is_refused(ringmodal, monkeypatch):
    monkeypatch.delenv("RINGMODAL_LIBRARY", raising=False)
    assert_refused(ringmodal("tyre", "list"), "--library DIR", "RINGMODAL_LIBRARY")


def test_damage_is_reported_after_what_can_be_read(tyre, tmp_path):
    path = tmp_path / "library" / "225-55R17" / "0001.toml"
    path.write_text(path.read_text().replace("0.33", "0.34"))
    for command in (("list",), ("history", "225-55R17")):
        code, output, errors = tyre(*command)
        assert code == 2
        assert "225-55R17" in output
        assert "0001.toml: a checksum that does not fit its content" in errors
    assert tyre("show", "225-55R17")[0] == 0
    assert_refused(tyre("series", "225-55R17"), "0001.toml", "Restore")


def test_nothing_is_written_over_a_version(tyre, tmp_path):
    path = tmp_path / "library" / "225-55R17" / "0001.toml"
    content = path.read_bytes()
    for command in ("export", "modal-targets"):
        assert_refused(tyre(command, "225-55R17", "--out", path), "0001.toml", "never changes")
    assert path.read_bytes() == content
    for _ in range(2):  # what was exported may be replaced
        assert tyre("export", "225-55R17", "--out", tmp_path / "a.toml", "--format", "TOML")[0] == 0
    path.write_bytes(content.replace(b"\n", b"\r\n"))
    assert tyre("export", "225-55R17", "--out", path)[0] == 2


def test_every_command_shows_an_example(ringmodal):
    _, output, _ = ringmodal("tyre", "--help")
    commands = ("add", "list", "show", "history", "diff", "approve", "rollback", "export")
    for command in (*commands, "table", "series"):
        assert f"  {command} " in output
        assert f"ringmodal tyre {command} " in ringmodal("tyre", command, "--help")[1]
