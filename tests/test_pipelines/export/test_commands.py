"""``ringmodal tyre update-tir``, ``from-tir`` and ``modal-targets``."""

import json
import sys
from dataclasses import replace
from datetime import UTC, datetime
from io import StringIO

import pytest
from library import SET, doubted, written
from tyre_property_files import content

from pipelines.export.tir_file import read_tir
from pipelines.results.parameter_set import Parameter, read_parameter_set
from pipelines.results.verdict import Basis


@pytest.fixture
def tir(tmp_path):
    path = tmp_path / "tyre.tir"
    path.write_bytes(content(in_mm=True))
    return path


@pytest.fixture
def toml(tmp_path):
    return written(tmp_path / "tyre.toml")


@pytest.fixture
def tyre(ringmodal, monkeypatch):
    monkeypatch.setenv("COLUMNS", "150")
    return lambda *arguments: ringmodal("tyre", *arguments)


def assert_refused(outcome, *expected):
    code, output, errors = outcome
    assert (code, output) == (2, "")
    for words in expected:
        assert words in errors


def test_there_and_back(tyre, tir, sample_folder, tmp_path):
    code, output, _ = tyre("update-tir", tir, "--from", sample_folder, "--yes")
    assert code == 0
    assert "BELT_IYY       25  720000" in output
    assert "kg mm²" in output
    assert "Left alone: BELT_IXX, FREQ_YAW, DAMP_YAW: " in output
    assert f"Written: {tir}" in output
    out = tmp_path / "back.toml"
    code, output, errors = tyre("from-tir", tir, "--belt-width-m", "0.19", "--out", out)
    assert code == 0
    assert "--like SET" in errors
    measured, back = read_parameter_set(sample_folder / "tyre.toml"), read_parameter_set(out)
    mass = measured.ring["mass_per_area_kg_m2"].value
    # K comes from a typical growth, not from that of the tuning.
    assert back.ring["mass_per_area_kg_m2"].value == pytest.approx(mass, rel=1e-2)
    (order_1,) = (each for each in measured.basis.measured if each.order == 1)
    written = read_tir(tir).number("FREQ_LONG")
    assert written == pytest.approx(order_1.frequency_hz, abs=order_1.frequency_std_hz)


def test_what_stood_there_is_kept(tyre, tir, toml):
    first = tir.read_bytes()
    assert tyre("update-tir", tir, "--from", toml, "--yes")[0] == 0
    second = tir.read_bytes()
    assert tyre("update-tir", tir, "--from", toml, "--belt-width-m", "0.2", "--yes")[0] == 0
    assert tir.with_name("tyre.tir.bak").read_bytes() == first
    assert tir.with_name("tyre.tir.bak2").read_bytes() == second
    assert tir.read_bytes() not in (first, second)
    _, output, _ = tyre("update-tir", tir, "--from", toml, "--belt-width-m", "0.2", "--yes")
    assert "Nothing was written." in output
    assert not tir.with_name("tyre.tir.bak3").exists()


def test_only_a_look(tyre, tir, toml):
    _, output, _ = tyre("update-tir", tir, "--from", toml, "--dry-run")
    assert output.endswith("Nothing was written.\n")
    assert tir.read_bytes() == content(in_mm=True)
    assert list(tir.parent.glob("*.bak")) == []


def test_another_file(tyre, tir, toml):
    out = tir.with_name("new.tir")
    code, output, _ = tyre("update-tir", tir, "--from", toml, "--out", out, "--json")
    record = json.loads(output)
    assert (code, record["file"], record["written"], record["backup"]) == (0, str(out), True, None)
    changes = {change["key"]: change for change in record["changes"]}
    assert changes["INFLPRES"]["new"] == pytest.approx(0.22)
    assert changes["INFLPRES"]["unit"] == "N/mm²"
    assert "MASS" in record["left_alone"]
    assert tir.read_bytes() == content(in_mm=True)
    assert out.read_bytes() != tir.read_bytes()


def person(monkeypatch, *answers):
    says = StringIO("".join(f"{answer}\n" for answer in answers))
    says.isatty = lambda: True
    monkeypatch.setattr(sys, "stdin", says)


@pytest.mark.parametrize(("answer", "end"), [("y", "Written"), ("n", "Nothing was written.")])
def test_confirmation_is_requested(tyre, tir, toml, monkeypatch, answer, end):
    person(monkeypatch, answer)
    code, output, _ = tyre("update-tir", tir, "--from", toml)
    assert code == 0
    assert end in output.splitlines()[-1]
    assert (tir.read_bytes() == content(in_mm=True)) == (answer == "n")


def test_without_a_terminal_confirmation_needs_an_option(tyre, tir, toml):
    for more in ((), ("--json",)):
        code, _, errors = tyre("update-tir", tir, "--from", toml, *more)
        assert code == 2
        assert "no --yes" in errors and "--dry-run" in errors
    assert tir.read_bytes() == content(in_mm=True)


def test_a_version_of_the_library(tyre, tir, toml, tmp_path):
    library = ("--library", tmp_path / "library")
    tyre("add", toml, *library)
    code, output, _ = tyre("update-tir", tir, "--from", "225/55R17", *library, "--yes")
    assert code == 0
    assert output.startswith("tyre.tir from 225-55R17@1:")
    assert_refused(tyre("update-tir", tir, "--from", "225-55R18", *library), "'225-55R17'")
    code, output, _ = tyre("from-tir", tir, "--like", "225-55R17@1", *library, "--json")
    ring = json.loads(output)["ring"]
    assert code == 0
    assert ring["axial_stiffness_n_m"] == {"value": 2.5e7, "how": "not identified"}
    assert ring["radial_stiffness_n_m3"]["value"] == pytest.approx(8e6, rel=1e-3)


def test_bad_input_is_refused(tyre, tir, toml):
    assert_refused(tyre("update-tir", toml.with_name("a.tir"), "--from", toml), "a.tir")
    assert_refused(tyre("from-tir", tir), "no belt width", "--belt-width-m")
    for width in ("-1", "0", "nan", "190"):  # the last one is in mm
        width_m = ("--belt-width-m", width)
        expected = (f"--belt-width-m: {width} m", "at most 2 m", "e.g. 0.19")
        assert_refused(tyre("update-tir", tir, "--from", toml, *width_m, "--yes"), *expected)
        assert_refused(tyre("from-tir", tir, *width_m), *expected)
    assert_refused(tyre("update-tir", tir, "--form", toml), "--from")
    tir.write_bytes(content().replace(b"'newton'", b"'newtn'"))
    assert_refused(tyre("update-tir", tir, "--from", toml), "FORCE", "Did you mean 'newton'?")


def test_a_bad_set_is_not_written_without_the_word(tyre, tir, tmp_path):
    bad, before = written(tmp_path / "bad.toml", doubted()), tir.read_bytes()
    for more in ((), ("--json",)):
        code, _, errors = tyre("update-tir", tir, "--from", bad, "--yes", *more)
        assert code == 2 and "--accept-warnings" in errors and "79 and 95 Hz" in errors
    assert tir.read_bytes() == before
    code, output, errors = tyre("update-tir", tir, "--from", bad, "--dry-run")
    assert code == 0 and "Nothing was written." in output
    assert "Verdict: bad: two modes" in errors and errors.count("Warning: hum") == 5
    asked = ("update-tir", tir, "--from", bad, "--yes", "--accept-warnings", "--comment")
    assert tyre(*asked)[0] == 0
    assert "verdict bad" in tir.read_text()


def test_a_person_is_asked(tyre, tir, tmp_path, monkeypatch):
    bad = written(tmp_path / "bad.toml", doubted())
    before = tir.read_bytes()
    person(monkeypatch, "n")
    assert tyre("update-tir", tir, "--from", bad)[0] == 0
    assert tir.read_bytes() == before
    person(monkeypatch, "y", "y")
    assert tyre("update-tir", tir, "--from", bad)[0] == 0
    assert tir.read_bytes() != before


def rows_of(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[0] == "# Modal targets for an FTire-style parameter fit"
    head, *rows = (line.split() for line in lines if not line.startswith("#"))
    return [dict(zip(head, row, strict=True)) for row in rows]


def test_modal_targets(tyre, sample_folder, truth, tmp_path):
    out = tmp_path / "targets.txt"
    assert tyre("modal-targets", sample_folder, "--out", out)[0] == 0
    rotation, *others = rows_of(out)
    assert (rotation["mode"], rotation["measured_hz"]) == ("in_plane_rotation", "-")
    assert [row["order"] for row in others] == ["1", "2", "3"]
    for row in others:
        mode = truth[int(row["order"])]
        assert float(row["frequency_hz"]) == pytest.approx(mode["frequency_hz"], rel=5e-3)
        assert float(row["measured_hz"]) == pytest.approx(mode["frequency_hz"], rel=1e-3)
        assert float(row["damping_ratio"]) == pytest.approx(mode["damping_ratio"], rel=0.15)
        assert row["frequency_hz"] == row["measured_hz"] != row["ring_hz"]
        assert 0 < float(row["frequency_std_hz"]) < 0.1 > float(row["damping_std"]) > 0
    assert "# inflation_pressure_pa: 220000\n" in out.read_text(encoding="utf-8")


def test_modal_targets_of_a_set_alone(tyre, toml, tmp_path):
    out = tmp_path / "targets.txt"
    code, output, _ = tyre("modal-targets", toml, "--out", out, "--json")
    assert code == 0
    record = json.loads(output)["targets"]
    assert [target["mode"] for target in record] == [row["mode"] for row in rows_of(out)]
    assert record[1]["measured_hz"] is None
    assert "measured_hz" not in rows_of(out)[0]
    exported = tmp_path / "exported.txt"
    assert tyre("export", toml, "--out", exported, "--format", "modal-targets")[0] == 0
    assert exported.read_bytes() == out.read_bytes()


def test_modal_targets_name_set_date_and_verdict(tyre, tmp_path):
    library, out = ("--library", tmp_path / "library"), tmp_path / "targets.txt"
    tyre("add", written(tmp_path / "bad.toml", doubted()), *library, "--accept-warnings")
    refused = ("modal-targets", "225-55R17@1", *library, "--out", out)
    assert_refused(tyre(*refused), "--accept-warnings")
    assert_refused(tyre("export", *refused[1:-1], tmp_path / "a.json"), "--accept-warnings")
    assert not out.exists()
    code, _, errors = tyre(*refused, "--accept-warnings")
    text = out.read_text(encoding="utf-8")
    assert code == 0 and "Verdict: bad" in errors
    assert f"# set: 225-55R17@1, {datetime.now(UTC).year}" in text
    assert "# campaign: first\n" in text and "# verdict: bad: two modes" in text


def test_modal_targets_without_damping_and_rotation(tyre, tmp_path):
    loose = {**SET.ring, "circumferential_stiffness_n_m3": Parameter(0.0, "at bound")}
    path = written(
        tmp_path / "loose.toml", replace(SET, ring=loose, damping={}, basis=Basis("follower"))
    )
    out = tmp_path / "targets.txt"
    assert tyre("modal-targets", path, "--out", out)[0] == 0
    rotation, translation, *_ = rows_of(out)
    assert rotation["frequency_hz"] == rotation["damping_ratio"] == "-"
    assert float(translation["frequency_hz"]) > 0
    assert translation["damping_ratio"] == "-"


def test_a_damaged_result_is_refused(tyre, toml, tmp_path):
    (tmp_path / "validation.csv").write_text("order,measured_hz\n1,78\n")
    assert_refused(tyre("modal-targets", tmp_path, "--out", tmp_path / "t.txt"), "measured_damping")
