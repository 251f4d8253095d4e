"""What other modal programs are given: read back by us, by pyuff, by SDynPy, by MATLAB's format."""

import errno
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import pyuff
from openpyxl import load_workbook
from results import FREQUENCIES_HZ, structure_result, tyre_result
from scipy.io import loadmat
from sdynpy_reader import read_by_sdynpy

import ema
from ema.core.errors import InputError
from ema.core.mac import mac
from ema.io.uff.write import trace_lines_82
from pipelines.compare.shape_comparison import compare_shapes
from pipelines.compare.shape_source import Alignment
from pipelines.export.data import geometry_of
from pipelines.export.modal import FORMATS, export, gather
from pipelines.report.write import save
from pipelines.results.tables import numbered

MASS_KG = 4.0  # of each mode of the synthetic result, times √(1 − ζ²)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("export") / "tyre_7"
    save(tyre_result(), folder, report=False)
    return folder


@pytest.fixture(scope="module")
def universal(folder):
    return export(folder, folder.with_name("tyre_7.uff"))


def sets_of(path, number):
    file = pyuff.UFF(str(path))
    chosen = np.flatnonzero(file.get_set_types() == number)
    found = file.read_sets(chosen.tolist())
    return found if isinstance(found, list) else [found]


def test_pyuff_reads_header_units_and_geometry(universal):
    path, geometry = universal.path, universal.export.geometry
    (header,) = sets_of(path, 151)
    assert header["model_name"] == "synthetic"
    assert header["program"].startswith("ringmodal")
    (units,) = sets_of(path, 164)
    assert (units["units_code"], units["length"], units["force"]) == (1, 1.0, 1.0)
    (nodes,) = sets_of(path, 2411)
    np.testing.assert_array_equal(nodes["node_nums"], np.arange(1, 73))
    xyz = np.column_stack([nodes["x"], nodes["y"], nodes["z"]])
    np.testing.assert_allclose(xyz, geometry.xyz_m, atol=1e-15)
    np.testing.assert_allclose(np.hypot(xyz[:, 0], xyz[:, 2]), 0.33)
    np.testing.assert_allclose(xyz[18], [0.0, 0.0, 0.33], atol=1e-15)  # 90 degrees
    (line,) = sets_of(path, 82)
    assert line["nodes"].astype(int).tolist() == [*range(1, 73), 1]


def test_pyuff_reads_complex_shapes(universal):
    found = universal.export
    for number, (mode, held) in enumerate(
        zip(found.modes, sets_of(universal.path, 55), strict=True), start=1
    ):
        assert (held["analysis_type"], held["data_type"], held["mode_n"]) == (3, 5, number)
        assert held["id1"].startswith(f"Mode {number}, order {mode.order},")
        np.testing.assert_allclose(held["eig"], mode.pole, rtol=1e-5)
        turn = np.deg2rad(found.geometry.position_deg)
        radial = held["r1"] * np.cos(turn) + held["r3"] * np.sin(turn)
        np.testing.assert_allclose(radial, mode.shape, atol=2e-6)
        assert not held["r2"].any()
        at_force = mode.shape[0] ** 2 / held["modal_a"]
        np.testing.assert_allclose(at_force, mode.residues[0], rtol=1e-4)
        np.testing.assert_allclose(held["modal_b"], -held["eig"] * held["modal_a"], rtol=1e-4)


def test_shapes_along_a_cylindrical_system_are_radial_first(folder, tmp_path):
    written = export(folder, tmp_path / "wheel.uff", cylindrical=True)
    for mode, held in zip(written.export.modes, sets_of(written.path, 55), strict=True):
        np.testing.assert_allclose(held["r1"], mode.shape, atol=2e-6)
        assert not held["r2"].any()
        assert not held["r3"].any()
    (nodes,) = sets_of(written.path, 2411)
    assert set(nodes["disp_cs"]) == {2}


def test_pyuff_reads_normal_modes(folder, tmp_path):
    written = export(folder, tmp_path / "real.uff", real=True, frfs="none")
    held = sets_of(written.path, 55)
    assert {each["analysis_type"] for each in held} == {2}
    np.testing.assert_allclose([each["freq"] for each in held], FREQUENCIES_HZ, rtol=1e-5)
    ratios = [mode.damping_ratio for mode in written.export.modes]
    np.testing.assert_allclose([each["modal_damp_vis"] for each in held], ratios, rtol=1e-5)
    masses = MASS_KG / np.sqrt(1 - np.square(ratios))
    np.testing.assert_allclose([each["modal_m"] for each in held], masses, rtol=1e-5)
    assert 58 not in pyuff.UFF(str(written.path)).get_set_types()


@pytest.mark.parametrize("text", [False, True])
def test_pyuff_reads_measured_and_synthesised_frfs(folder, tmp_path, text):
    written = export(folder, tmp_path / "frfs.uff", text=text)
    found, held = written.export, sets_of(written.path, 58)
    assert {each["binary"] for each in held} == {0 if text else 1}
    assert [each["id3"].split(";")[0] for each in held] == ["measured"] * 72 + ["synthesised"] * 72
    assert [each["rsp_node"] for each in held] == [*range(1, 73)] * 2
    assert {(each["func_type"], each["ref_node"], each["rsp_dir"]) for each in held} == {(4, 1, 1)}
    for frf, part in ((found.measured, held[:72]), (found.synthesised, held[72:])):
        np.testing.assert_allclose(part[0]["x"], frf.frequency_hz)
        np.testing.assert_allclose([each["data"] for each in part], frf.values, rtol=1e-10)
    lines = found.synthesised.frequency_hz
    model = found.result.modal_model
    assert lines.min() >= model.fit_band_hz[0]
    assert lines.max() <= model.fit_band_hz[1]
    np.testing.assert_array_equal(
        found.synthesised.values, model.synthesise(lines, found.result.frf.run)
    )


def test_measured_frfs_alone_keep_all_lines(folder, tmp_path):
    written = export(folder, tmp_path / "measured.uff", frfs="measured").export
    assert written.synthesised is None
    np.testing.assert_array_equal(written.measured.values, written.result.frf.values)


@pytest.mark.parametrize("real", [False, True])
def test_a_second_program_reads_the_same(folder, tmp_path, real):
    written = export(folder, tmp_path / "second.uff", real=real, text=real, cylindrical=True)
    held, found = read_by_sdynpy(written.path), written.export
    modes, geometry = found.modes, found.geometry
    frequencies_hz = [mode.frequency_hz for mode in modes]
    np.testing.assert_allclose(held["frequency_hz"], frequencies_hz, rtol=1e-5)
    np.testing.assert_allclose(
        held["damping_ratio"], [mode.damping_ratio for mode in modes], rtol=1e-4
    )
    modal = found.modal_mass_kg if real else found.modal_a
    np.testing.assert_allclose(complex_of(held["modal"]), modal, rtol=1e-4, atol=1e-2)
    shapes = complex_of(held["shapes"]).reshape(len(modes), 72, 3)
    assert held["shape_node"][::3] == list(range(1, 73))
    assert held["shape_direction"][:3] == [1, 2, 3]
    axes = np.reshape(held["shape_global"], (72, 3, 3))
    motion = np.einsum("mna,nax->mnx", shapes, axes)
    np.testing.assert_allclose(motion, found.shapes[..., None] * geometry.direction, atol=2e-6)
    ends = np.reshape(held["frf_global"], (144, 2, 3))
    np.testing.assert_allclose(ends[:, 0], np.tile(geometry.direction, (2, 1)), atol=1e-9)
    np.testing.assert_allclose(ends[:, 1], np.tile(geometry.direction[0], (144, 1)), atol=1e-9)
    assert held["node"] == list(range(1, 73))
    np.testing.assert_allclose(held["xyz_m"], geometry.xyz_m, atol=1e-15)
    assert held["line"] == [[*range(1, 73), 1]]
    assert held["frf_kind"] == "TransferFunctionArray"
    assert held["frf_nodes"] == [[node, 1] for node in [*range(1, 73)] * 2]
    np.testing.assert_allclose(held["frf_hz"], found.measured.frequency_hz)
    both = np.vstack([found.measured.values, found.synthesised.values])
    np.testing.assert_allclose(complex_of(held["frfs"]), both, rtol=1e-10)


def complex_of(parts):
    real, imag = map(np.array, parts)
    return real + 1j * imag


@pytest.mark.parametrize("cylindrical", [False, True])
def test_we_read_our_shapes(folder, tmp_path, cylindrical):
    universal = export(folder, tmp_path / "ours.uff", cylindrical=cylindrical)
    found = ema.read_shapes(universal.path)
    assert found.findings == ()
    np.testing.assert_allclose(found.angle_deg[::3], np.arange(72) * 5.0, atol=1e-9)
    np.testing.assert_allclose(found.frequency_hz, FREQUENCIES_HZ, rtol=1e-5)
    written = universal.export
    along = written.shapes[..., None] * written.geometry.direction  # of the global axes
    np.testing.assert_allclose(found.values, along.reshape(len(found.values), -1), atol=2e-6)


def test_synthesised_frfs_are_not_read_as_measurements(folder, universal, tmp_path):
    found = ema.read_campaign(universal.path)
    assert found.frf.n_positions == 72
    np.testing.assert_allclose(found.frf.values, universal.export.measured.values)
    assert any("72 FRFs synthesised" in each.detail for each in found.findings)
    alone = export(folder, tmp_path / "alone.uff", frfs="synthesised")
    found = ema.read_campaign(alone.path)
    np.testing.assert_allclose(found.frf.values, alone.export.synthesised.values)
    assert any("none is measured" in each.detail for each in found.findings)


def test_a_force_between_sensors_gets_a_node_of_its_own():
    found = gather(tyre_result(excitation_deg=2.5))
    assert found.geometry.reference_nodes == (73,)
    assert found.geometry.path[:3] == [1, 73, 2]
    assert found.measured.node.size == 72
    assert np.isnan(found.modal_a).all()


def test_masses_are_unknown_where_the_force_cannot_have_been():
    """At 90 degrees odd orders have a node, and 2 and 6 move against a force that acts at 0."""
    found = gather(tyre_result(excitation_deg=90.0))
    known = np.isfinite(found.modal_mass_kg)
    assert known.tolist() == [mode.order == 4 for mode in found.modes]
    assert np.isfinite(found.modal_a).tolist() == known.tolist()


def test_numbers_of_the_recordings_are_kept_where_other_programs_take_them():
    result = tyre_result()
    own = np.arange(101, 173)
    assert geometry_of(replace(result, frf=replace(result.frf, node=own))).node[5] == 106
    twice = np.repeat(np.arange(1, 37), 2)
    assert geometry_of(replace(result, frf=replace(result.frf, node=twice))).node[5] == 6


def test_a_missing_radius_is_noted():
    geometry = geometry_of(tyre_result(tyre=None))
    assert "drawn with 1 m" in geometry.notes[-1]
    np.testing.assert_allclose(np.linalg.norm(geometry.xyz_m, axis=1), 1.0)


def test_a_structure_is_drawn_on_a_line(tmp_path):
    save(structure_result(), tmp_path / "plate", report=False)
    written = export(tmp_path / "plate", tmp_path / "plate.unv")
    (header,) = sets_of(written.path, 151)
    assert header["description"].startswith("no angles known")
    (line,) = sets_of(written.path, 82)
    assert line["nodes"].astype(int).tolist() == list(range(1, 11))
    held = sets_of(written.path, 55)[0]
    np.testing.assert_allclose(held["r3"], written.export.modes[0].shape, atol=2e-6)
    assert {each["rsp_dir"] for each in sets_of(written.path, 58)} == {3}


NODES, AXES = [5, 5, 5, 12, 12, 12, 7, 7, 3, 9], [1, 2, 3, 1, 2, 3, 1, 3, 3, 2]
DOFS = [f"{node}{'XYZ'[axis - 1]}" for node, axis in zip(NODES, AXES, strict=True)]


@pytest.fixture(scope="module")
def triaxial(tmp_path_factory):
    """A structure with up to three directions at a node, driven at node 12 along Y."""
    result, folder = structure_result(), tmp_path_factory.mktemp("export") / "plate"
    places = {"node": np.array(NODES), "axis": np.array(AXES)}
    frf = replace(result.frf, **places, force_node=12, force_axis=2)
    modal_model = replace(result.modal_model, **places)
    save(replace(result, frf=frf, measured=frf, modal_model=modal_model), folder, report=False)
    return folder


def test_universal_files_keep_nodes_and_directions(triaxial, tmp_path):
    written = export(triaxial, tmp_path / "plate.uff", frfs="measured")
    frf, modes = written.export.result.frf, written.export.modes
    held = sets_of(written.path, 58)
    assert [(each["rsp_node"], each["rsp_dir"]) for each in held] == [
        *zip(NODES, AXES, strict=True)
    ]
    assert {(each["ref_node"], each["ref_dir"]) for each in held} == {(12, 2)}
    np.testing.assert_array_equal([each["data"] for each in held], frf.values)
    (nodes,) = sets_of(written.path, 2411)
    assert sorted(nodes["node_nums"]) == [3, 5, 7, 9, 12]
    for mode, shape in zip(modes, sets_of(written.path, 55), strict=True):
        at = {int(node): row for row, node in enumerate(shape["node_nums"])}
        parts = np.column_stack([shape["r1"], shape["r2"], shape["r3"]])
        rows, columns = [at[node] for node in NODES], [axis - 1 for axis in AXES]
        np.testing.assert_allclose(parts[rows, columns], mode.shape, atol=2e-6)
        assert np.count_nonzero(parts) == len(NODES)
        if shape["modal_a"]:
            at_force = mode.shape[4] ** 2 / shape["modal_a"]
            np.testing.assert_allclose(at_force, mode.residues[4], rtol=1e-4)
    assert np.isfinite(written.export.modal_a).any()
    back = ema.read_campaign(written.path).frf
    assert (back.node.tolist(), back.axis.tolist()) == (NODES, AXES)
    assert (back.force_node, back.force_axis) == (12, 2)


def test_a_second_program_reads_nodes_and_directions(triaxial, tmp_path):
    written = export(triaxial, tmp_path / "plate.uff", frfs="measured").export
    held, result = read_by_sdynpy(tmp_path / "plate.uff"), written.result
    assert held["frf_nodes"] == [[node, 12] for node in NODES]
    ends = np.reshape(held["frf_global"], (10, 2, 3))
    np.testing.assert_allclose(ends[:, 0], np.eye(3)[np.array(AXES) - 1])
    np.testing.assert_allclose(ends[:, 1], np.eye(3)[[1] * 10])
    np.testing.assert_array_equal(complex_of(held["frfs"]), result.frf.values)
    found = zip(held["shape_node"], held["shape_direction"], strict=True)
    column = {place: row for row, place in enumerate(found)}
    columns = [column[place] for place in zip(NODES, AXES, strict=True)]
    shapes = [mode.shape for mode in result.modal_model.modes]
    np.testing.assert_allclose(complex_of(held["shapes"])[:, columns], shapes, atol=2e-6)


def test_tables_keep_nodes_and_directions(triaxial, tmp_path):
    written = export(triaxial, tmp_path / "tables", "csv").export
    values = written.result.frf.values
    shapes = pd.read_csv(tmp_path / "tables" / "shapes.csv").query("mode == 2")
    assert (shapes["node"].astype(str) + shapes["direction"]).tolist() == DOFS
    frf = pd.read_csv(tmp_path / "tables" / "frf_synthesised.csv")
    np.testing.assert_array_equal(frf["imag_node_12_Z"], written.synthesised.values[5].imag)
    about = json.loads((tmp_path / "tables" / "export.json").read_text())
    assert (about["force_node"], about["force_direction"]) == (12, "Y")
    held = loadmat(export(triaxial, tmp_path / "a.mat", frfs="measured").path, simplify_cells=True)
    assert held["nodes"]["node"].tolist() == NODES
    np.testing.assert_array_equal(held["nodes"]["direction"], np.eye(3)[np.array(AXES) - 1])
    np.testing.assert_array_equal(held["measured"]["frf"], values)
    book = load_workbook(export(triaxial, tmp_path / "a.xlsx", frfs="measured").path)
    title = book["FRF measured, real"]
    assert [cell.value.split()[1] for cell in title[1][1:]] == DOFS
    cells = [title.cell(9, column).value for column in range(2, 12)]
    np.testing.assert_allclose(cells, values[:, 7].real, rtol=1e-14)
    rows = [*book["Shapes"].values][1:]
    assert [f"{node}{axis}" for node, axis, *_ in rows] == DOFS
    table = pd.read_csv(triaxial / "shapes.csv")
    assert table["direction"].tolist() == [dof[-1] for dof in DOFS] * 7


def test_shapes_of_several_axes_are_compared_along_one(triaxial, tmp_path):
    export(triaxial, tmp_path / "own.uff")
    with pytest.raises(InputError, match="X, Y, Z"):
        compare_shapes(triaxial, tmp_path / "own.uff")
    for other in (tmp_path / "own.uff", triaxial / "shapes.csv", triaxial):
        found = compare_shapes(triaxial, other, Alignment(direction="z"))
        assert found.result.node.tolist() == [5, 12, 7, 3]
        np.testing.assert_allclose(np.diag(found.mac), 1.0, atol=1e-9)


def test_rows_without_numbers_get_one_each():
    """Recordings with names only, as CSV has them."""
    result = structure_result()
    frf = replace(result.frf, node=np.full(10, -1), channel=tuple("abcdefghij"))
    further = replace(frf.rows(np.array([9, 0])), force_node=7)
    found, second = numbered([frf, further])
    assert (found.node.tolist(), second.node.tolist()) == ([*range(1, 11)], [10, 1])
    assert second.force_node == 11


def test_long_rings_have_lines_in_pieces_that_meet():
    path = [*range(1, 361), 1]
    lines = trace_lines_82("ring", path).decode().split("\n    -1\n")
    pieces = [list(map(int, piece.split("ring")[1].split())) for piece in lines if "ring" in piece]
    assert max(map(len, pieces)) <= 125
    assert [piece[0] for piece in pieces[1:]] == [piece[-1] for piece in pieces[:-1]]
    assert pieces[0] + [node for piece in pieces[1:] for node in piece[1:]] == path


def test_json_is_complete(folder, tmp_path):
    written = export(folder, tmp_path / "all.json")
    held, found = json.loads(written.path.read_text(encoding="utf-8")), written.export
    model = found.result.modal_model
    np.testing.assert_array_equal(held["modes"]["frequency_hz"], model.frequencies_hz)
    stds = [mode.frequency_std_hz for mode in found.modes]
    np.testing.assert_array_equal(held["modes"]["frequency_hz_std"], stds)
    shapes = np.array(held["shapes"]["real"]) + 1j * np.array(held["shapes"]["imag"])
    np.testing.assert_array_equal(shapes, found.shapes)
    assert held["units"]["frequency_hz"] == "Hz"
    assert np.shape(held["residues_std"]) == (7, 72)
    assert held["nodes"]["force_node"] == 1
    np.testing.assert_array_equal(held["measured"]["frf"]["real"], found.measured.values.real)
    assert "frf_std" in held["measured"]
    assert "coherence" not in held["synthesised"]


def test_json_knows_no_nan(tmp_path):
    save(structure_result(), tmp_path / "plate", report=False)
    text = export(tmp_path / "plate", tmp_path / "plate.json").path.read_text(encoding="utf-8")
    assert "NaN" not in text
    assert json.loads(text)["nodes"]["position_deg"] == [None] * 10


def test_matlab_reads_arrays_and_structures(folder, tmp_path):
    written = export(folder, tmp_path / "all.mat", real=True)
    held = loadmat(written.path, simplify_cells=True)
    np.testing.assert_array_equal(held["shapes"], written.export.shapes)
    np.testing.assert_allclose(held["modes"]["modal_mass_kg"], written.export.modal_mass_kg)
    assert held["modes"]["status"].tolist() == ["ok"] * 7
    assert held["units"]["xyz_m"] == "m"
    np.testing.assert_array_equal(held["measured"]["frf"], written.export.measured.values)


def test_tables_open_in_pandas(folder, tmp_path):
    written = export(folder, tmp_path / "tables", "csv")
    modes = pd.read_csv(written.path / "modes.csv")
    np.testing.assert_allclose(modes["modal_mass_kg"], MASS_KG, rtol=1e-2)
    assert modes["order"].tolist() == list(range(1, 8))
    shapes = pd.read_csv(written.path / "shapes.csv")["real"].to_numpy().reshape(7, 72)
    np.testing.assert_allclose(np.diag(mac(shapes, written.export.shapes)), 1.0)
    frf = pd.read_csv(written.path / "frf_synthesised.csv")
    np.testing.assert_array_equal(frf["imag_node_3"], written.export.synthesised.values[2].imag)
    about = json.loads((written.path / "export.json").read_text())
    assert {*about["files"], "export.json"} == {path.name for path in written.path.iterdir()}


@pytest.mark.parametrize("file_format", FORMATS)
def test_nothing_is_replaced_unasked(folder, tmp_path, file_format):
    place = tmp_path / f"earlier.{file_format}"
    export(folder, place, file_format, frfs="none")
    with pytest.raises(InputError, match="--force"):
        export(folder, place, file_format, frfs="none")
    export(folder, place, file_format, frfs="none", force=True)


def test_tables_do_not_replace_a_result(folder, tmp_path):
    save(tyre_result(), tmp_path / "result", report=False)
    with pytest.raises(InputError, match="other files"):
        export(folder, tmp_path / "result", "csv", force=True)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--format", "uf"], "uff"),
        (["--out", "modes.docx"], "uff, xlsx, csv, json, mat"),
        (["--frfs", "measurd"], "measured"),
        (["--out", "nowhere/modes.uff"], "does not exist"),
    ],
)
def test_bad_choices_end_with_2_and_the_nearest_good_one(
    ringmodal, folder, tmp_path, monkeypatch, words, expected
):
    monkeypatch.chdir(tmp_path)
    code, _, complaint = ringmodal("export", folder, *words)
    assert code == 2
    assert expected in complaint
    assert not any(tmp_path.iterdir())


def test_no_result_is_bad_input(ringmodal, tmp_path):
    code, _, complaint = ringmodal("export", tmp_path)
    assert code == 2
    assert "it must be a result folder" in complaint


def test_the_command_prints_what_it_wrote(ringmodal, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, output, _ = ringmodal("export", folder, "--real")
    assert code == 0
    assert "7 real shapes at 72 nodes, 72 measured and 72 synthesised FRFs" in output
    assert "Written: tyre_7.uff" in output
    code, output, _ = ringmodal("export", folder, "--format", "csv", "--frfs", "none", "--json")
    record = json.loads(output)
    assert (code, record["path"], record["modes"], record["frfs_measured"]) == (
        0,
        "tyre_7_csv",
        7,
        0,
    )
    assert (tmp_path / "tyre_7_csv" / "modes.csv").is_file()


def test_a_full_drive_is_no_fault_of_the_program(monkeypatch):
    def full(*_, **__):
        try:
            raise OSError(errno.ENOSPC, "No space left on device")
        except OSError:
            raise Exception("Error writing data-set #82")  # noqa: B904  # as pyuff does

    monkeypatch.setattr(pyuff.UFF, "write_sets", full)
    with pytest.raises(OSError, match="No space left"):
        trace_lines_82("ring", [1, 2, 3])
