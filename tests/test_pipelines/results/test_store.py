"""Result folders: whole or not at all, read back as they were."""

import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema.core.errors import InputError
from ema.core.finding import Check
from ema.core.recording import ExponentialWindow
from pipelines.process.ring import tune
from pipelines.process.run import process
from pipelines.report.write import save
from pipelines.results.options import Options
from pipelines.results.store import load
from pipelines.storage.atomic import MARKER, require_free


@pytest.fixture(scope="module")
def stored(short_result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("stored") / "result"
    save(short_result, folder, report=False)
    return folder


@pytest.fixture
def copy(stored, tmp_path):
    return Path(shutil.copytree(stored, tmp_path / "result"))


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_modes_come_back_exactly(short_result, stored):
    loaded = load(stored).modal_model
    model = short_result.modal_model
    for kind in ("modes", "guard_modes"):
        for one, other in zip(getattr(model, kind), getattr(loaded, kind), strict=True):
            assert one.pole == other.pole
            assert (one.order, one.member, one.status) == (other.order, other.member, other.status)
            np.testing.assert_array_equal(one.residues, other.residues)
            np.testing.assert_array_equal(one.residues_std, other.residues_std)
            np.testing.assert_equal(
                (one.frequency_std_hz, one.damping_std, one.order_purity),
                (other.frequency_std_hz, other.damping_std, other.order_purity),
            )
    np.testing.assert_array_equal(model.covariance, loaded.covariance)
    np.testing.assert_array_equal(model.frac, loaded.frac)
    assert (model.band_hz, model.fit_band_hz) == (loaded.band_hz, loaded.fit_band_hz)
    assert model.misfit == loaded.misfit
    assert model.notes == loaded.notes


def test_the_window_of_the_analyser_comes_back(short_result, tmp_path):
    window = ExponentialWindow(0.4, 0.01)
    model = replace(short_result.modal_model, exponential_window=window)
    save(replace(short_result, modal_model=model), tmp_path / "result", report=False)
    assert load(tmp_path / "result").modal_model.exponential_window == window


def test_frfs_come_back(short_result, stored):
    pairs = [(short_result.frf, load(stored).frf)]
    pairs.append((pairs[0][0].reference, pairs[0][1].reference))
    for frf, loaded in pairs:
        for name in ("frequency_hz", "values", "node", "position_deg"):
            np.testing.assert_array_equal(getattr(frf, name), getattr(loaded, name), name)
        for name in ("coherence", "std"):  # kept in single precision
            np.testing.assert_allclose(getattr(loaded, name), getattr(frf, name), rtol=1e-6)
        assert frf.run == loaded.run
        assert frf.channel == loaded.channel
    assert short_result.frf.blocks == load(stored).frf.blocks
    assert short_result.frf.n_effective == load(stored).frf.n_effective


def test_synthesised_frfs_come_back(short_result, stored):
    lines_hz = np.linspace(40, 240, 50)
    run = short_result.frf.run
    np.testing.assert_array_equal(
        load(stored).modal_model.synthesise(lines_hz, run),
        short_result.modal_model.synthesise(lines_hz, run),
    )


def test_the_drift_comes_back(tmp_path):
    from pipelines.simulate.campaign import simulate_campaign

    campaign = simulate_campaign(tmp_path / "campaign", duration_s=4.0, drift_percent=0.05)
    result = process(campaign, Options(tune=False))
    assert result.modal_model.drift.run
    save(result, tmp_path / "result", report=False)
    loaded = load(tmp_path / "result").modal_model.drift
    assert loaded.run == result.modal_model.drift.run
    np.testing.assert_array_equal(loaded.percent, result.modal_model.drift.percent)
    np.testing.assert_array_equal(loaded.std_percent, result.modal_model.drift.std_percent)


def test_the_diagram_and_the_findings_come_back(short_result, stored):
    loaded = load(stored)
    assert loaded.diagram.clusters == short_result.diagram.clusters
    np.testing.assert_allclose(loaded.diagram.poles, short_result.diagram.poles, rtol=1e-12)
    np.testing.assert_array_equal(loaded.diagram.cluster, short_result.diagram.cluster)
    np.testing.assert_array_equal(loaded.diagram.indicator, short_result.diagram.indicator)
    assert loaded.findings == short_result.findings
    assert all(type(each.check) is Check for each in loaded.findings)
    assert loaded.tyre == short_result.tyre
    assert loaded.reference.ratio == pytest.approx(short_result.reference.ratio)
    assert (loaded.excitation_deg, loaded.reference_deg) == (0.0, 2.5)


def test_a_loaded_result_gives_the_same_ring(short_result, stored):
    again = tune(load(stored), Options())
    assert again.tuning.ring == short_result.tuning.ring
    assert again.damping.damping == short_result.damping.damping
    np.testing.assert_array_equal(again.validation.mac, short_result.validation.mac)
    assert again.notes == short_result.notes


def test_saving_a_loaded_result_changes_no_file(short_result, stored, tmp_path):
    again = tune(load(stored), Options())
    save(again, tmp_path / "again", report=False)
    for name, content in contents(stored).items():
        # Poles lose their last digit to frequency and damping.
        if name not in ("poles.parquet", MARKER):
            assert (tmp_path / "again" / name).read_bytes() == content, name


def test_two_runs_give_the_same_bytes(short_campaign, stored, tmp_path):
    save(process(short_campaign), tmp_path / "again", report=False)
    names = ("modes.csv", "shapes.csv", "quality.csv", "validation.csv", "frf.uff", "frf.parquet")
    for name in names:
        assert (tmp_path / "again" / name).read_bytes() == (stored / name).read_bytes(), name


def test_an_earlier_result_is_not_overwritten_unasked(short_result, copy):
    before = contents(copy)
    with pytest.raises(InputError, match="--force"):
        save(short_result, copy, report=False)
    assert contents(copy) == before
    save(short_result, copy, report=False, force=True)
    assert names(copy.parent) == ["result"]


@pytest.mark.parametrize("force", [True, False])
def test_a_folder_of_something_else_is_never_replaced(short_result, tmp_path, force):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter_1.tex").write_text("Tyres")
    with pytest.raises(InputError, match="other files"):
        save(short_result, tmp_path / "thesis", report=False, force=force)
    assert names(tmp_path / "thesis") == ["chapter_1.tex"]


def test_an_empty_folder_may_become_a_result(short_result, tmp_path):
    (tmp_path / "empty").mkdir()
    save(short_result, tmp_path / "empty", report=False)
    assert (tmp_path / "empty" / MARKER).is_file()
    assert names(tmp_path) == ["empty"]


def test_a_file_is_no_place_for_a_result(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="a result is a folder"):
        require_free(tmp_path / "file", force=True)


def test_a_place_that_cannot_be_written_is_named(short_result, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="could not be written"):
        save(short_result, tmp_path / "file" / "result", report=False)
    assert names(tmp_path) == ["file"]


class _TextFault(RuntimeError):
    """A fault of the program in the middle of writing."""


@pytest.mark.parametrize("fault", [_TextFault("a fault"), OSError(28, "No space left on device")])
def test_nothing_is_left_behind_when_writing_fails(short_result, copy, monkeypatch, fault):
    def fail(*_):
        raise fault

    monkeypatch.setattr("pipelines.report.write.write_report", fail)
    expected = InputError if isinstance(fault, OSError) else _TextFault
    with pytest.raises(expected):
        save(short_result, copy.parent / "new")
    before = contents(copy)
    with pytest.raises(expected):
        save(short_result, copy, force=True)
    assert names(copy.parent) == ["result"]
    assert contents(copy) == before


def test_only_a_result_folder_is_read(tmp_path):
    for folder in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(InputError, match="ringmodal process"):
            load(folder)


@pytest.mark.parametrize(
    "name", ["frf.parquet", "identification.json", "residues.parquet", "poles.parquet", MARKER]
)
@pytest.mark.parametrize("left", [0, 100])
def test_a_damaged_result_is_named(copy, name, left):
    damaged = copy / name
    damaged.write_bytes(damaged.read_bytes()[:left])
    for accept_changes in (False, True):
        with pytest.raises(InputError, match=name):
            load(copy, accept_changes=accept_changes)


@pytest.mark.parametrize("name", ["frf.parquet", "identification.json", "residues.parquet"])
def test_an_incomplete_result_is_named(copy, name):
    (copy / name).unlink()
    for accept_changes in (False, True):
        with pytest.raises(InputError, match=name):
            load(copy, accept_changes=accept_changes)


@pytest.mark.parametrize("content", ["[]", "null", '"text"', "{}", "[" * 100_000])
@pytest.mark.parametrize("name", ["identification.json", MARKER])
def test_a_result_of_the_wrong_shape_is_named(copy, name, content):
    (copy / name).write_text(content)
    for accept_changes in (False, True):
        with pytest.raises(InputError, match=name):
            load(copy, accept_changes=accept_changes)


def test_a_result_lists_its_files_with_their_checksums(copy):
    content = json.loads((copy / MARKER).read_text())
    listed = [path for path in copy.iterdir() if path.name != MARKER]
    assert content["files"] == {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in listed
    }
    assert not {"files", "content_sha256"} & set(load(copy).provenance)


def test_files_of_others_are_not_lost_with_a_result(short_result, copy):
    (copy / "notes.txt").write_text("The sensor at 30 degrees was loose.")
    (copy / "pictures").mkdir()
    (copy / ".DS_Store").write_text("")
    before = names(copy)
    with pytest.raises(InputError, match=r"notes\.txt, pictures"):
        save(short_result, copy, report=False, force=True)
    assert names(copy) == before
    (copy / "notes.txt").unlink()
    (copy / "pictures").rmdir()
    save(short_result, copy, report=False, force=True)


def test_a_result_with_a_damaged_list_is_not_replaced(short_result, copy):
    (copy / MARKER).write_text("{")
    before = contents(copy)
    with pytest.raises(InputError, match=MARKER):
        save(short_result, copy, report=False, force=True)
    assert contents(copy) == before


def test_a_result_without_some_of_its_files_may_be_replaced(short_result, copy):
    (copy / "modes.csv").unlink()
    save(short_result, copy, report=False, force=True)
    assert load(copy).modal_model.modes
