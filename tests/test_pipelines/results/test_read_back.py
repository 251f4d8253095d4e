"""What is written is read back by other programs: the same numbers, directions and units."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import pyuff
from results import structure_result
from scipy.io import loadmat
from sdynpy_reader import read_by_sdynpy

import ema
from ema.core.references import References
from ema.io.uff.write import write_frfs
from pipelines.export.modal import export
from pipelines.report.write import save
from pipelines.results.store import load

X, Y, Z = 1, 2, 3


@pytest.fixture(scope="module")
def result():
    """A structure whose sensors point along all axes, with a force along Y at node 7."""
    found = structure_result()
    axis = np.resize([Z, X, Y], found.frf.n_positions)
    frf = replace(found.frf, axis=axis, force_node=7, force_axis=Y)
    return replace(found, frf=frf, measured=frf)


@pytest.fixture(scope="module")
def folder(result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("back") / "result"
    save(result, folder, report=False)
    return folder


def test_universal_files_by_pyuff(result, folder, tmp_path):
    written = export(folder, tmp_path / "modes.uff", frfs="measured")
    for path, nodes in ((folder / "frf.uff", result.frf.node), (written.path, None)):
        sets = [each for each in pyuff.UFF(str(path)).read_sets() if each["type"] == 58]
        assert [each["rsp_dir"] for each in sets] == result.frf.axis.tolist()
        assert {each["ref_dir"] for each in sets} == {Y}
        labels = ("abscissa_axis_units_lab", "ordinate_axis_units_lab", "orddenom_axis_units_lab")
        assert {tuple(each[name] for name in labels) for each in sets} == {("Hz", "m/s^2", "N")}
        np.testing.assert_allclose([each["data"] for each in sets], result.frf.values, rtol=1e-12)
        if nodes is not None:
            assert [each["rsp_node"] for each in sets] == nodes.tolist()
            assert {each["ref_node"] for each in sets} == {7}


def test_universal_files_by_ourselves(result, folder):
    found = ema.read_campaign(folder / "frf.uff").frf
    np.testing.assert_allclose(found.values, result.frf.values)
    assert found.axis.tolist() == result.frf.axis.tolist()
    assert (found.force_node, found.force_axis) == (7, Y)
    loaded = load(folder).frf
    assert loaded.axis.tolist() == result.frf.axis.tolist()
    assert (loaded.force_node, loaded.force_axis) == (7, Y)


def test_universal_files_by_sdynpy(result, folder, tmp_path):
    written = export(folder, tmp_path / "modes.uff", frfs="measured")
    held = read_by_sdynpy(written.path)
    ends = np.reshape(held["frf_global"], (-1, 2, 3))
    np.testing.assert_allclose(ends[:, 0], np.eye(3)[result.frf.axis - 1])
    real, imag = map(np.array, held["frfs"])
    np.testing.assert_allclose(real + 1j * imag, result.frf.values, rtol=1e-10)
    shapes = np.reshape(held["shapes"][0], (len(written.export.modes), -1, 3))
    moves = np.abs(shapes).sum(axis=0) > 0
    np.testing.assert_array_equal(moves, np.eye(3)[result.frf.axis - 1] > 0)


@pytest.mark.parametrize("binary", [True, False])
def test_two_references_in_different_directions(result, folder, tmp_path, binary):
    first = result.frf
    second = replace(first, values=-2 * first.values, force_node=3, force_axis=Z)
    path = tmp_path / "frf.uff"
    write_frfs(path, References((first, second)), binary=binary)
    sets = [each for each in pyuff.UFF(str(path)).read_sets() if each["type"] == 58]
    ends = [(each["ref_node"], each["ref_dir"]) for each in sets]
    assert ends == [(7, Y)] * first.n_positions + [(3, Z)] * first.n_positions
    assert [each["rsp_dir"] for each in sets] == 2 * first.axis.tolist()
    both = np.concatenate([first.values, second.values])
    np.testing.assert_allclose([each["data"] for each in sets], both, rtol=1e-12)
    ours = ema.read_campaign(path).frf
    assert [(each.force_node, each.force_axis) for each in ours] == [(7, Y), (3, Z)]
    np.testing.assert_allclose(np.concatenate([each.values for each in ours]), both, rtol=1e-12)
    shapes = export(folder, tmp_path / "modes.uff", frfs="none").path.read_bytes()
    (tmp_path / "all.uff").write_bytes(shapes + path.read_bytes())
    held = read_by_sdynpy(tmp_path / "all.uff")
    there = np.reshape(held["frf_global"], (-1, 2, 3))
    np.testing.assert_allclose(there[:, 0], np.eye(3)[np.tile(first.axis, 2) - 1])
    np.testing.assert_allclose(there[:, 1], np.repeat(np.eye(3)[[Y - 1, Z - 1]], 10, axis=0))
    real, imag = map(np.array, held["frfs"])
    np.testing.assert_allclose(real + 1j * imag, both, rtol=1e-10)


def test_tables_by_pandas(result, folder):
    table = pd.read_parquet(folder / "frf.parquet")
    by_row = table.groupby("row")
    np.testing.assert_array_equal(by_row["axis"].first(), result.frf.axis)
    np.testing.assert_array_equal(by_row["node"].first(), result.frf.node)
    values = (table["real"] + 1j * table["imag"]).to_numpy().reshape(result.frf.values.shape)
    np.testing.assert_array_equal(values, result.frf.values)
    shapes = pd.read_csv(folder / "shapes.csv")
    first = shapes[shapes["mode"] == 1]
    assert first["direction"].tolist() == ["XYZ"[axis - 1] for axis in result.frf.axis]
    shape = result.modal_model.modes[0].shape
    np.testing.assert_allclose(first["real"] + 1j * first["imag"], shape, rtol=1e-12, atol=1e-15)


def test_matlab_by_scipy(result, folder, tmp_path):
    written = export(folder, tmp_path / "modes.mat")
    held = loadmat(written.path, simplify_cells=True)
    np.testing.assert_array_equal(held["nodes"]["direction"], np.eye(3)[result.frf.axis - 1])
    np.testing.assert_allclose(held["modes"]["frequency_hz"], result.modal_model.frequencies_hz)
    assert held["units"]["frf"] == "(m/s^2)/N"
