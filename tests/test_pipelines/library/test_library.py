"""The library of parameter sets: what it keeps, how tyres are named, which version counts."""

import csv
import json
import os
import tomllib
from dataclasses import replace
from datetime import date
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from library import DESIGNATION, SET, doubted, varied, written

from ema.core.errors import InputError
from model.verdict import Reason
from pipelines.cli.options import numbers_of
from pipelines.library.export import FORMATS, LONG, WIDE, export, version_rows, write_table
from pipelines.library.history import difference, history_of, pressure_series
from pipelines.library.library import NamedSet, TyreLibrary, resolve
from pipelines.library.numbering import folder_name, split_reference
from pipelines.library.version import Event, record_approval
from pipelines.results.parameter_set import Parameter, from_tuning, read_parameter_set
from pipelines.results.verdict import Basis


@pytest.fixture
def library(tmp_path):
    return TyreLibrary(tmp_path / "library")


@pytest.fixture
def add(library, tmp_path):
    """Add a parameter set and return the version."""

    def added(parameters=SET, **options):
        return library.add(written(tmp_path / "set.toml", parameters), author="Ada", **options)

    return added


@pytest.fixture
def three(add, library):
    """A tyre with three versions."""
    for recording in "123":
        add(varied(recording))
    return library.tyre(DESIGNATION)


def test_a_version_keeps_the_set_and_its_origin(add, library, tmp_path):
    add(note="new contour", conditions={"temperature_c": 21.5})
    version = library.version("225-55R17@1")
    assert version.parameters == replace(
        SET, conditions={"inflation_pressure_pa": 220000.0, "temperature_c": 21.5}
    )
    assert (version.entry.author, version.entry.note) == ("Ada", "new contour")
    assert version.entry.source == "set.toml"
    assert version.entry.software.startswith("ringmodal ")
    content = tomllib.loads((library.folder / "225-55R17" / "0001.toml").read_text())
    assert content["designation"] == DESIGNATION
    assert content["version"]["number"] == 1


def test_a_version_is_a_parameter_set_for_every_other_command(add, library):
    add()
    assert read_parameter_set(library.folder / "225-55R17" / "0001.toml") == SET


def test_an_edited_copy_of_a_version_passes_for_no_parameter_set(add, library, tmp_path):
    add()
    text = (library.folder / "225-55R17" / "0001.toml").read_text()
    copy = tmp_path / "copy.toml"
    copy.write_text(text.replace("0.33", "0.34"))
    with pytest.raises(InputError, match=r"copy\.toml: a checksum that does not fit"):
        resolve(str(copy))
    with pytest.raises(InputError, match=r"copy\.toml"):
        library.add(copy, author="Ada")


def test_a_note_of_bytes_that_are_no_text_is_kept_as_far_as_it_is(add):
    assert add(note="gr\udcfcn").entry.note == "gr?n"


def test_a_result_folder_brings_campaign_and_checksums(library, sample_folder):
    version = library.add(sample_folder, author="Ada")
    provenance = version.parameters.provenance
    assert provenance["campaign"] == "tyre_225_55R17"
    assert len(provenance["inputs"]["config_1.uff"]) == 64
    assert version.parameters == read_parameter_set(sample_folder / "tyre.toml")


def test_numbers_in_the_manifest_become_conditions(sample_result):
    details = {"temperature_c": "21.5", "load_n": "light", "colour": "black"}
    made = from_tuning("tyre", sample_result.tuning, sample_result.damping, {}, details)
    assert made.conditions == {"inflation_pressure_pa": 220000.0, "temperature_c": 21.5}


def test_the_author_is_the_login_name_by_default(library, tmp_path, monkeypatch):
    monkeypatch.setattr("getpass.getuser", lambda: "lovelace")
    assert library.add(written(tmp_path / "set.toml")).entry.author == "lovelace"


def test_without_login_name_an_author_is_required(library, tmp_path, monkeypatch):
    def nobody():
        raise OSError

    monkeypatch.setattr("getpass.getuser", nobody)
    with pytest.raises(InputError, match="--author"):
        library.add(written(tmp_path / "set.toml"))
    assert not library.folder.exists()


def test_a_set_that_makes_no_ring_is_refused(add, library):
    ring = SET.ring | {"mass_per_area_kg_m2": Parameter(-1.0)}
    with pytest.raises(InputError, match="mass_per_area_kg_m2"):
        add(replace(SET, ring=ring))
    assert not library.folder.exists()


def test_a_mistyped_library_makes_no_folders(tmp_path):
    library = TyreLibrary(tmp_path / "nowhere" / "library")
    with pytest.raises(InputError, match="parent folder"):
        library.add(written(tmp_path / "set.toml"), author="Ada")
    assert not library.folder.parent.exists()


def test_a_structures_result_has_no_parameters_to_add(library, tmp_path):
    (tmp_path / "result").mkdir()
    (tmp_path / "result" / "provenance.json").write_text("{}")
    with pytest.raises(InputError, match=r"no tyre\.toml; its ring steps were left out"):
        library.add(tmp_path / "result", author="Ada")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("temperature_c=warm", "NAME=NUMBER"),
        ("temperature_c", "NAME=NUMBER"),
        ("temperature_c=nan", "NAME=NUMBER"),
        ("temperatur_c=20", "Did you mean 'temperature_c'"),
        ("load_kn=4", "Did you mean 'load_n'"),
    ],
)
def test_conditions_are_numbers_of_known_names(add, text, expected):
    with pytest.raises(InputError, match=expected):
        add(conditions=numbers_of("--condition", [text], "temperature_c=21.5"))


def test_tyres_of_one_designation_are_distinguished_by_id(add, library):
    assert add(tyre_id="winter A").reference == "225-55R17_winter-A@1"
    assert add(tyre_id="winter B").reference == "225-55R17_winter-B@1"
    assert add().reference == "225-55R17@1"
    assert library.tyre("winter a").name == "225-55R17_winter-A"
    assert library.tyre("225/55r17").name == "225-55R17"


def test_another_tyre_does_not_slip_into_a_folder(add):
    add()
    with pytest.raises(InputError, match="belongs to 225/55R17"):
        add(varied(designation="225-55R17"))


def test_nor_does_one_that_comes_at_the_same_moment(add, library, monkeypatch):
    link = os.link

    def link_after_another(source, place):
        monkeypatch.setattr("os.link", link)
        add()
        link(source, place)

    monkeypatch.setattr("pipelines.library.numbering._RENAME_KEEPS", False)
    monkeypatch.setattr("os.link", link_after_another)
    with pytest.raises(InputError, match="belongs to 225/55R17"):
        add(varied(designation="225-55R17"))
    (only,) = library.tyre(DESIGNATION).intact_versions()
    assert only.parameters.designation == DESIGNATION


@pytest.mark.parametrize("sign", ["x", "ü", "輪"])
def test_long_names_in_any_script_make_folders(add, library, sign):
    set_ = varied(designation=300 * sign)
    reference = add(set_, tyre_id=300 * sign).reference
    assert library.version(reference).parameters.designation == 300 * sign


def test_a_file_is_no_library(tmp_path):
    library = TyreLibrary(written(tmp_path / "set.toml"))
    for attempt in (library.tyres, lambda: library.add(library.folder, author="Ada")):
        with pytest.raises(InputError, match=r"set\.toml: a file; "):
            attempt()


def test_a_name_without_letters_is_no_tyre(add, library):
    add()
    with pytest.raises(InputError, match=r"'/'; .*225-55R17"):
        library.tyre("/")


def test_a_rollback_to_other_content_than_was_approved_is_refused(add, library):
    for recording in "12":
        add(varied(recording))
    tyre = library.tyre(DESIGNATION)
    for number in (1, 2):
        tyre.approve(number, "Ada")
    for number in (1, 2):
        (tyre.path / f"{number:04}.toml").unlink()
    add(varied("3"))
    with pytest.raises(InputError, match="another content than the one that was approved"):
        tyre.rollback("Ada")


def test_dates_are_exported_as_text(tmp_path):
    dated = replace(SET, conditions=SET.conditions | {"measured": date(2026, 5, 4)})
    export(dated, tmp_path / "set.json")
    content = json.loads((tmp_path / "set.json").read_text())
    assert content["conditions"]["measured"] == "2026-05-04"


def test_an_ambiguous_name_is_refused(add, library):
    for tyre_id in ("A", "B"):
        add(tyre_id=tyre_id)
    with pytest.raises(InputError, match=r"several tyres.*225-55R17_A, 225-55R17_B"):
        library.tyre(DESIGNATION)


@given(st.text(max_size=120), st.text(max_size=120))
def test_folder_names_suit_every_system(designation, tyre_id):
    try:
        name = folder_name(designation, tyre_id)
    except InputError:
        assert not any(sign.isalnum() for sign in designation + tyre_id)
        return
    assert not set(name) & set('<>:"/\\|?*@ \n')
    assert len(name) <= 170
    assert name[0] not in ". " and name[-1] not in ". "
    assert folder_name(name) == name


@pytest.mark.parametrize("name", ["CON", "nul", "COM1", "lpt9.x"])
def test_names_that_windows_keeps_for_itself_are_avoided(name):
    assert folder_name(name).startswith("tyre-")


@pytest.mark.parametrize("text", ["a@0", "a@x", "a@", "a@1.5", "a@-1"])
def test_versions_are_numbers_from_one_on(text):
    with pytest.raises(InputError, match=r"Write e\.g\. a@1"):
        split_reference(text)


def test_unknown_tyres_and_versions_get_the_nearest_choice(three, library):
    with pytest.raises(InputError, match="Did you mean '225-55R17'"):
        library.tyre("225/55R18")
    with pytest.raises(InputError, match=r"versions 1 to 3\. The newest is 225-55R17@3"):
        library.version("225-55R17@4")


def test_the_newest_counts_until_one_is_approved(three):
    assert three.chosen().number == 3
    three.approve(2, "Grace", "checked")
    assert three.chosen().number == 2
    assert three.chosen("newest").number == 3
    assert three.chosen("approved").number == 2
    assert "approved by Grace" in three.standing(three.version(2))
    assert "not approved; version 2 is" in three.standing(three.version(3))


def test_standing_without_approval(three):
    assert "no version is approved" in three.standing(three.version(3))
    with pytest.raises(InputError, match="tyre approve 225-55R17@3"):
        three.chosen("approved")


def test_approving_changes_no_version_and_is_recorded_once(three):
    before = {path: path.read_bytes() for path in three.path.glob("*.toml")}
    three.approve(2, "Grace")
    three.approve(2, "Grace")
    assert {path: path.read_bytes() for path in three.path.glob("*.toml")} == before
    assert [path.name for path in (three.path / "approvals").iterdir()] == ["0001.toml"]


@pytest.mark.parametrize("reason", [Reason.RIM, Reason.UNTESTED])
def test_a_set_in_doubt_is_not_approved_without_the_word(add, library, reason):
    version = add(doubted(reason), accept_warnings=True)
    tyre = library.tyre(version.tyre)
    with pytest.raises(InputError, match="--accept-warnings"):
        tyre.approve(1, "Ada")
    assert tyre.approval() is None
    assert tyre.approve(1, "Ada", accept_warnings=True).number == 1
    assert tyre.approval().accepted == version.parameters.basis.verdict.text()
    assert "accepted as" in tyre.standing(version)


def test_notes_name_what_is_in_doubt(add, library):
    later = replace(varied("2", 250000.0), basis=replace(doubted().basis, pressure_load="follower"))
    found = difference(NamedSet("a", replace(SET, basis=Basis("dead"))), NamedSet("b", later))
    assert any(note.startswith("b: verdict bad") for note in found.notes)
    assert any("dead load" in note and "follower" in note for note in found.notes)
    series = pressure_series([add(), add(later, accept_warnings=True)])
    assert any(note.startswith("Version 2: verdict bad") for note in series.notes)
    assert any("mixed" in note for note in series.notes)


def test_rollback_goes_back_approval_by_approval(three):
    for number in (1, 3, 2):
        three.approve(number, "Grace")
    assert three.rollback("Grace").number == 3
    assert three.rollback("Grace", note="again").number == 1
    assert three.chosen().number == 1
    with pytest.raises(InputError, match="no earlier approval"):
        three.rollback("Grace")
    three.approve(2, "Grace")
    assert three.rollback("Grace", 1).number == 1


def test_rollback_to_what_was_never_approved_is_refused(three):
    for number in (1, 2):
        three.approve(number, "Grace")
    with pytest.raises(InputError, match="Did you mean '225-55R17@1'"):
        three.rollback("Grace", 3)


def test_the_same_rollback_by_two_people_is_one_step(three):
    for number in (1, 2, 3):
        three.approve(number, "Grace")
    for author in ("Ada", "Grace"):
        record_approval(three.path, Event.ROLLBACK, three.version(2), author, "")
    assert three.chosen().number == 2
    assert three.rollback("Ada").number == 1


def test_references_mean_files_results_or_versions(three, library, tmp_path, sample_folder):
    assert resolve(str(tmp_path / "set.toml")).parameters == varied("3")
    assert resolve(str(sample_folder)).parameters.designation == DESIGNATION
    found = resolve("225/55R17@2", library.folder)
    assert found.name == "225-55R17@2"
    assert found.parameters.ring == varied("2").ring
    assert found.parameters.provenance["library"]["version"] == 2
    with pytest.raises(InputError, match="RINGMODAL_LIBRARY"):
        resolve("225/55R17@2")


def test_a_difference_is_held_against_the_error_bars():
    higher = varied(radial_stiffness_n_m3=8.5e6, mass_per_area_kg_m2=19.8, mean_radius_m=0.34)
    found = difference(NamedSet("A", SET), NamedSet("B", higher))
    changes = {change.name: change for change in found.changes}
    radial = changes["radial_stiffness_n_m3"]
    assert radial.difference.z == pytest.approx(5e5 / (2**0.5 * 1e5))
    assert radial.status == "significant"
    assert changes["mass_per_area_kg_m2"].status == "not significant"
    assert changes["mean_radius_m"].status == "not tested"
    assert changes["axial_stiffness_n_m"].status == "not tested"
    assert changes["bending_stiffness_n_m"].status == "σ unknown"
    assert found.largest_change == radial


def test_sets_from_the_same_recordings_are_not_tested():
    higher = varied("1", radial_stiffness_n_m3=8.5e6)
    found = difference(NamedSet("A", SET), NamedSet("B", higher))
    assert not found.independent
    assert "same recordings" in found.notes[0]
    assert not any(change.status == "significant" for change in found.changes)


def test_conditions_and_parameters_of_only_one_set_are_listed():
    other = replace(varied("2", 250000.0), damping={}, wheel={"mass_kg": 12.0}, designation="X")
    found = difference(NamedSet("A", SET), NamedSet("B", other))
    assert found.conditions == (("inflation_pressure_pa", 220000.0, 250000.0),)
    text = " ".join(found.notes)
    assert "The tyres differ: 225/55R17 and X." in text
    assert "Only the first set has radial_n_s_m3, circumferential_n_s_m3, loss_factor." in text
    assert "Only the second set has wheel_mass_kg." in text


def test_history_shows_the_main_change(add, library):
    add()
    add(varied("2", 250000.0, radial_stiffness_n_m3=8.5e6))
    add(varied("3", 250000.0, radial_stiffness_n_m3=8.5e6))
    tyre = library.tyre(DESIGNATION)
    tyre.approve(1, "Ada")
    tyre.approve(2, "Ada")
    lines = history_of(tyre).lines
    assert [line.approval for line in lines] == ["was approved", "approved", ""]
    assert lines[1].change == (
        "inflation_pressure_pa 220000 → 250000; radial_stiffness_n_m3 +6.2 % (z = +3.5)"
    )
    assert lines[2].change == "nothing"


def test_history_gathers_damage(three):
    three.approve(1, "Ada")
    (three.path / "0002.toml").write_text("")
    (three.path / "approvals" / "0001.toml").write_text("")
    found = history_of(three)
    assert [line.version.number for line in found.lines] == [1, 3]
    assert len(found.damage) == 2
    assert found.approved is None


@pytest.mark.parametrize("wide", [False, True])
def test_tables_hold_every_version(three, tmp_path, wide):
    three.approve(2, "Ada")
    rows, damage = version_rows([three], wide=wide)
    assert damage == []
    write_table(tmp_path / "table.parquet", rows, wide=wide)
    write_table(tmp_path / "table.csv", rows, wide=wide)
    read = pq.read_table(tmp_path / "table.parquet").to_pylist()
    assert tuple(read[0]) == (WIDE if wide else LONG)
    assert len(read) == (3 if wide else 30)
    assert {row["version"] for row in read if row["approved"]} == {2}
    with (tmp_path / "table.csv").open(newline="") as file:
        assert len(list(csv.DictReader(file))) == len(read)
    if wide:
        assert read[0]["radial_stiffness_n_m3_std"] == 1e5
        assert read[0]["wheel_mass_kg"] is None
    else:
        (row,) = (r for r in read if r["version"] == 1 and r["parameter"] == "loss_factor")
        assert (row["value"], row["std"], row["how"]) == (0.015, 0.003, "identified")


def test_a_damaged_version_hides_no_other_from_a_table(three):
    (three.path / "0002.toml").write_text("")
    rows, damage = version_rows([three])
    assert {row["version"] for row in rows} == {1, 3}
    assert [Path(error.where).name for error in damage] == ["0002.toml"]


def test_exports_hold_every_value(three, tmp_path):
    parameters = resolve("225-55R17@2", three.path.parent).parameters
    for name in ("toml", "json", "csv"):
        assert export(parameters, tmp_path / f"out.{name}") == name
    assert read_parameter_set(tmp_path / "out.toml") == parameters
    content = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert content["ring"]["radial_stiffness_n_m3"] == {
        "value": 8.0e6,
        "how": "identified",
        "std": 1.0e5,
    }
    with (tmp_path / "out.csv").open(newline="") as file:
        rows = {row["name"]: row for row in csv.DictReader(file)}
    assert float(rows["radial_stiffness_n_m3"]["std"]) == 1.0e5
    assert rows["axial_stiffness_n_m"]["std"] == ""
    assert rows["inflation_pressure_pa"]["section"] == "conditions"


def test_an_unknown_format_gets_the_nearest_one(tmp_path):
    with pytest.raises(InputError, match="Did you mean 'toml'"):
        export(SET, tmp_path / "out.tml")
    assert list(tmp_path.iterdir()) == []


def test_colleagues_formats_are_functions_in_one_table(tmp_path, monkeypatch):
    monkeypatch.setitem(
        FORMATS, "name", lambda own, path: path.write_text(own.designation) and None
    )
    assert export(SET, tmp_path / "out.txt", "name") == "name"
    assert (tmp_path / "out.txt").read_text() == DESIGNATION
