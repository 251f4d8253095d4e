"""A result is used as it was written: what was tampered with is named, or accepted on purpose."""

import hashlib
import json
import random
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from results import tyre_result
from tampering import tamper, ways

from ema.core.errors import FitError, InputError
from model.errors import ParameterError
from pipelines.batch.run import run_batch
from pipelines.library.library import TyreLibrary
from pipelines.process.ring import retune
from pipelines.report.write import save
from pipelines.results.options import Options
from pipelines.results.provenance import is_as_written
from pipelines.results.schema import read_identification_json
from pipelines.results.store import load, write_identification
from pipelines.storage.atomic import MARKER
from pipelines.storage.checksums import OWN, write_marker

TAMPERED = 160
SEED = 1
FILES = (
    *("identification.json", "frf.parquet", "residues.parquet", "poles.parquet"),
    *("reference.parquet", "force.parquet", "modes.csv", "shapes.csv", "orders.csv", "quality.csv"),
    "corrections.csv",
    "other_modes.csv",
    *("validation.csv", "frf.uff", "tyre.toml", "report.html", MARKER),
)
CASES = [(name, way) for name in FILES for way in ways(Path(name))]
CONSUMERS = {
    "report": ("report", "{r}"),
    "tune": ("tune", "{r}", "--no-report"),
    "export": ("export", "{r}", "--out", "{o}.json"),
    "export to a folder": ("export", "{r}", "--out", "{o}"),
    "compare": ("compare", "{r}", "{other}", "--out", "{o}.html"),
    "compare with": ("compare", "{other}", "{r}", "--out", "{o}.html"),
    "compare shapes": ("compare-shapes", "{r}", "{other}"),
    "add": ("tyre", "add", "{r}", "--library", "{o}"),
    "diff": ("tyre", "diff", "{other}", "{r}"),
    "hand on": ("tyre", "export", "{r}", "--out", "{o}.toml"),
    "targets": ("tyre", "modal-targets", "{r}", "--out", "{o}.txt"),
    "simulate": ("simulate", "frequencies", "--tyre", "{r}"),
}


@pytest.fixture(scope="module")
def stored(short_result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("stored") / "result"
    save(short_result, folder)
    return folder


@pytest.fixture(scope="module")
def other(short_result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("other") / "other"
    save(tyre_result(2, provenance=short_result.provenance), folder)
    return folder


@pytest.fixture
def copy(stored, tmp_path):
    return Path(shutil.copytree(stored, tmp_path / "result"))


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def tampered(folder, other, number):
    """Tamper with a folder in the way of a number; returns the file's name."""
    name, way = CASES[number % len(CASES)]
    tamper(folder / name, way, other, random.Random(f"{SEED} {number}"))
    return name


def test_every_file_of_a_result_is_tampered_with(stored):
    assert set(FILES) == {path.name for path in stored.iterdir()}
    assert len(CASES) < TAMPERED


def test_tampered_results_are_named_by_every_consumer(ringmodal, copy, other, tmp_path):
    """Each of them in turn; the folder is left as it is, and nothing is written."""
    whole, consumers = contents(copy), list(CONSUMERS.values())
    there = sorted(tmp_path.iterdir())
    named = 0
    for number in range(0, TAMPERED, 2):
        name = tampered(copy, other, number)
        before = contents(copy)
        if before != whole and not (name == "report.html" and name not in before):
            arguments = consumers[number % len(consumers)]
            places = {"r": copy, "o": tmp_path / "out", "other": other}
            code, output, errors = ringmodal(*(part.format(**places) for part in arguments))
            assert (code, output) == (2, ""), (CASES[number % len(CASES)], arguments)
            # With the list of another result, all files are those of another one.
            assert (name if CASES[number % len(CASES)] != (MARKER, "swapped") else "frf") in errors
            assert contents(copy) == before
            assert sorted(tmp_path.iterdir()) == there
            named += 1
        for path in copy.iterdir():
            path.unlink()
        for each, content in whole.items():
            (copy / each).write_bytes(content)
    assert named > 0.9 * TAMPERED / 2
    assert is_as_written(copy)


def test_tampered_results_that_are_accepted_are_used_or_named(copy, other, tmp_path):
    whole = contents(copy)
    read_back = [n for n in range(TAMPERED) if CASES[n % len(CASES)][0] in {*FILES[:6], MARKER}]
    used = 0
    for number in read_back:
        name = tampered(copy, other, number)
        try:
            result = retune(copy, accept_changes=True)
        except (InputError, FitError, ParameterError):
            pass
        else:
            used += 1
            is_changed = not is_as_written(copy)
            assert bool(result.provenance.get("accepted_changes")) == is_changed
        (copy / name).write_bytes(whole[name])
    assert used > 5


def test_a_part_that_was_added_is_named(copy, other):
    (copy / "reference.parquet").rename(copy.parent / "reference.parquet")
    content = json.loads((copy / MARKER).read_text())
    write_marker(copy / MARKER, {k: v for k, v in content.items() if k not in ("files",)})
    assert is_as_written(copy)
    (copy.parent / "reference.parquet").rename(copy / "reference.parquet")
    with pytest.raises(InputError, match=r"reference\.parquet"):
        load(copy)


def test_files_that_are_no_part_of_a_result_do_not_keep_it_from_being_read(copy):
    (copy / "notes.txt").write_text("the sensor at 30 degrees was loose")
    (copy / ".git").mkdir()
    (copy / "report.html").unlink()
    assert load(copy).modal_model.modes


def test_provenance_of_other_types_is_refused_though_its_checksum_fits(copy):
    record = json.loads((copy / MARKER).read_text())
    record["inputs"][1]["file"] = 3
    write_marker(copy / MARKER, {key: record[key] for key in record if key != OWN})
    with pytest.raises(InputError, match=r"inputs\.1\.file"):
        load(copy)


@pytest.mark.parametrize("part", ["check", "verdict"])
def test_findings_of_unknown_name_are_refused(short_result, tmp_path, part):
    unknown = replace(short_result.findings[0], **{part: "tarot"})
    write_identification(replace(short_result, findings=(unknown,)), tmp_path)
    with pytest.raises(InputError, match=rf"findings\.0\.{part}: unknown name"):
        read_identification_json(tmp_path / "identification.json")


@pytest.mark.parametrize("name", ["frf", "reference", "residues", "poles"])
def test_rows_in_another_order_read_the_same(short_result, copy, name):
    path = copy / f"{name}.parquet"
    table = pq.read_table(path)
    pq.write_table(table.take(np.random.default_rng(3).permutation(table.num_rows)), path)
    with pytest.raises(InputError, match=path.name):
        load(copy)
    found = load(copy, accept_changes=True)
    np.testing.assert_array_equal(found.frf.values, short_result.frf.values)
    np.testing.assert_array_equal(found.frf.reference.values, short_result.frf.reference.values)
    np.testing.assert_allclose(found.diagram.poles, short_result.diagram.poles, rtol=1e-12)
    for one, two in zip(found.modal_model.modes, short_result.modal_model.modes, strict=True):
        np.testing.assert_array_equal(one.residues, two.residues)
    changed = [finding for finding in found.findings if finding.check == "changed"]
    assert [(each.channel, each.verdict) for each in changed] == [(path.name, "warning")]


def test_what_was_accepted_is_recorded_in_what_is_written_from_it(ringmodal, copy, tmp_path):
    path = copy / "frf.parquet"
    table = pq.read_table(path)
    pq.write_table(table.take(np.arange(table.num_rows)[::-1]), path)
    checksum = hashlib.sha256(path.read_bytes()).hexdigest()
    assert ringmodal("report", copy)[0] == 2
    code, _, _ = ringmodal("export", copy, "--out", tmp_path / "out.json", "--accept-changes")
    assert code == 0
    assert "frf.parquet" in " ".join(json.loads((tmp_path / "out.json").read_text())["notes"])
    assert ringmodal("report", copy, "--accept-changes")[0] == 0
    provenance = json.loads((copy / MARKER).read_text())
    assert provenance["accepted_changes"] == {"frf.parquet": checksum}
    assert tomllib.loads((copy / "tyre.toml").read_text())["provenance"]["accepted_changes"] == [
        "frf.parquet"
    ]
    assert load(copy).provenance["accepted_changes"] == {"frf.parquet": checksum}
    assert "changed" in (copy / "quality.csv").read_text()


@pytest.mark.parametrize("name", ["modes.csv", "report.html", "tyre.toml"])
def test_an_edited_file_that_nothing_reads_back_is_not_replaced(ringmodal, copy, name):
    (copy / name).write_bytes((copy / name).read_bytes() + b"\n")
    before = contents(copy)
    code, _, errors = ringmodal("report", copy, "--accept-changes")
    assert code == 2
    assert name in errors
    assert contents(copy) == before
    assert [path.name for path in copy.parent.iterdir()] == ["result"]


def edited_set(path):
    """A hand-edited radial stiffness, 27 % higher, still called identified."""
    text = path.read_text()
    value = tomllib.loads(text)["ring"]["radial_stiffness_n_m3"]["value"]
    path.write_text(text.replace(repr(value), repr(1.27 * value)))
    assert path.read_text() != text
    return path


@pytest.mark.parametrize("alone", [True, False])
def test_an_edited_parameter_set_is_named_or_accepted(ringmodal, copy, tmp_path, alone):
    source = shutil.copy(copy / "tyre.toml", tmp_path / "tyre.toml") if alone else copy
    library = tmp_path / "library"
    assert ringmodal("tyre", "add", source, "--library", library)[0] == 0
    edited_set(source if alone else copy / "tyre.toml")
    code, _, errors = ringmodal("tyre", "add", source, "--library", library)
    assert code == 2
    assert "tyre.toml" in errors
    assert TyreLibrary(library).tyres()[0].newest == 1
    assert ringmodal("tyre", "add", source, "--library", library, "--accept-changes")[0] == 0
    first, second = (TyreLibrary(library).tyres()[0].version(number) for number in (1, 2))
    assert second.parameters.provenance["accepted_changes"] == ["tyre.toml"]
    assert "accepted_changes" not in first.parameters.provenance


def test_a_version_of_a_library_can_be_handed_on_and_added_again(ringmodal, copy, tmp_path):
    library, file = tmp_path / "library", tmp_path / "tyre.toml"
    assert ringmodal("tyre", "add", copy, "--library", library)[0] == 0
    code, _, _ = ringmodal("tyre", "export", "225-55R17", "--library", library, "--out", file)
    assert code == 0
    assert ringmodal("tyre", "add", file, "--library", tmp_path / "theirs")[0] == 0


@pytest.mark.parametrize("value", ["1e308", "-1e308", "1e-308", "1e200", "1e31", "nan", "inf"])
def test_values_that_no_tyre_has_are_named(ringmodal, copy, tmp_path, value):
    file = tmp_path / "tyre.toml"
    content = tomllib.loads((copy / "tyre.toml").read_text())
    for section in ("ring", "damping"):
        for name, entry in content[section].items():
            text = (copy / "tyre.toml").read_text()
            file.write_text(text.replace(f"value = {entry['value']!r}", f"value = {value}"))
            code, _, errors = ringmodal("simulate", "frequencies", "--tyre", file)
            assert code == 2, name
            assert name in errors


def test_a_batch_processes_a_result_again_that_was_tampered_with(short_campaign, tmp_path):
    shutil.copytree(short_campaign, tmp_path / "all" / "one")
    options, out = Options(tune=False), tmp_path / "out"
    assert run_batch(tmp_path / "all", out, options, jobs=1).fresh
    assert not run_batch(tmp_path / "all", out, options, jobs=1).fresh
    result = out / "results" / "one"
    (result / "modes.csv").unlink()
    assert run_batch(tmp_path / "all", out, options, jobs=1).fresh
    assert is_as_written(result)
    (result / ".notes.txt").write_text("mine")
    assert not run_batch(tmp_path / "all", out, options, jobs=1).fresh
    (result / "modes.csv").write_text("mine")
    batch = run_batch(tmp_path / "all", out, options, jobs=1)
    assert [record.is_done for record in batch.records] == [False]
    assert (result / "modes.csv").read_text() == (result / ".notes.txt").read_text() == "mine"


@pytest.mark.parametrize("theirs", ["records/first.txt", "summary.html"])
def test_a_batch_takes_no_folder_of_somebody_else(short_campaign, tmp_path, theirs):
    out = tmp_path / "out"
    (out / "records").mkdir(parents=True)
    (out / theirs).write_text("mine")
    (out / "modes.parquet").write_text("mine")
    with pytest.raises(InputError):
        run_batch(short_campaign, out, Options(tune=False), jobs=1)
    assert (out / "modes.parquet").read_text() == (out / theirs).read_text() == "mine"


def test_a_batch_leaves_a_hidden_file_in_its_folder(short_campaign, tmp_path):
    out = tmp_path / "out"
    run_batch(short_campaign, out, Options(tune=False), jobs=1)
    (out / ".probe").write_text("mine")
    run_batch(short_campaign, out, Options(tune=False), jobs=1)
    assert (out / ".probe").read_text() == "mine"
