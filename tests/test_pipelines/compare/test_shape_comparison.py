"""Shapes of a result against shapes whose answer is known: its own, a model's, other programs'."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
import pyuff
from results import FREQUENCIES_HZ, structure_result, tyre_result

from ema.core.errors import InputError
from ema.io.uff.write import ShapeDataset, nodes_2411, shape_55
from pipelines.compare.shape_comparison import (
    compare_shapes,
    compare_sources,
    explained_share,
    match_rows,
)
from pipelines.compare.shape_source import Alignment, of_result, read_source
from pipelines.export.modal import export
from pipelines.report.comparison import shape_sections as sections
from pipelines.report.write import save

RADIUS_M = 0.33
OWN = of_result(tyre_result(), "tyre_7")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shapes") / "tyre_7"
    save(tyre_result(), folder, report=False)
    return folder


@pytest.fixture(scope="module")
def plate(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shapes") / "plate"
    save(structure_result(), folder, report=False)
    return folder


def tyre_model(path, *, axes=(0, 2), turned_deg=0.0, sense=1, step_deg=3.0, millimetre=False):
    """A finite-element tyre: tread and sidewalls, modes in pairs, radial and tangential motion.

    Its pairs have other angles; frequencies are 2 % above those of the result.
    """
    angles = np.arange(0.3, 360.0, step_deg)
    rings = [(RADIUS_M, 0.0), (RADIUS_M, 0.06), (RADIUS_M, -0.06), (0.25, 0.09), (0.25, -0.09)]
    seen = np.deg2rad(sense * (angles - turned_deg))
    first, second = axes
    axle = ({0, 1, 2} - set(axes)).pop()
    points = np.zeros((len(rings), angles.size, 3))
    radial, tangential = np.zeros((2, angles.size, 3))
    radial[:, first], radial[:, second] = np.cos(seen), np.sin(seen)
    tangential[:, first], tangential[:, second] = -np.sin(seen), np.cos(seen)
    for ring, (radius, across) in enumerate(rings):
        points[ring] = radius * radial
        points[ring, :, axle] = across
    node = np.arange(1001, 1001 + points.size // 3)
    scale = 1e3 if millimetre else 1.0
    with path.open("wb") as file:
        if millimetre:
            file.write(b"    -1\n   164\n         5mm (milli newton)             2\n")
            file.write(b"%25.16E%25.16E%25.16E\n%25.16E\n    -1\n" % (1e3, 1e3, 1.0, 273.15))
        file.write(nodes_2411(node, scale * points.reshape(-1, 3), 1))
        for number, (order, half) in enumerate(
            [(order, half) for order in range(1, 8) for half in (0, 1)], start=1
        ):
            phase = order * np.deg2rad(angles) + 0.7 * order + half * np.pi / 2
            motion = np.cos(phase)[:, None] * radial - np.sin(phase)[:, None] / order * tangential
            values = np.concatenate([motion if radius == RADIUS_M else 0.2 * motion
                                     for radius, _ in rings])  # fmt: skip
            pole = 2j * np.pi * 1.02 * FREQUENCIES_HZ[order - 1]
            file.write(shape_55(ShapeDataset(number, (), pole, node, values)))
    return path


@pytest.mark.parametrize("real", [False, True])
def test_exported_shapes_compared_with_themselves_have_mac_1(folder, tmp_path, real):
    written = export(folder, tmp_path / "own.uff", real=real, frfs="none")
    for alignment in (Alignment(), Alignment(by="node")):
        found = compare_shapes(folder, written.path, alignment)
        assert found.places.row.size == 72
        assert [match.other for match in found.matches] == list(range(7))
        np.testing.assert_allclose(np.diag(found.mac), 1.0, atol=1e-9)
        np.testing.assert_allclose([m.difference_percent for m in found.matches], 0.0, atol=1e-3)


@pytest.mark.parametrize("kind", ["result", "tables", "table"])
def test_results_and_tables_are_sources_too(folder, tmp_path, kind):
    other = folder
    if kind != "result":
        other = export(folder, tmp_path / "tables", "csv", frfs="none").path
    found = compare_shapes(folder, other / "shapes.csv" if kind == "table" else other)
    np.testing.assert_allclose(np.diag(found.mac), 1.0, atol=1e-12)
    np.testing.assert_allclose([match.difference_hz for match in found.matches], 0.0, atol=1e-9)


def test_scale_sign_and_phase_do_not_matter():
    turned = OWN.values * np.exp(1j * np.arange(7))[:, None] * -3.7
    found = compare_sources(OWN, replace(OWN, values=turned))
    np.testing.assert_allclose(np.diag(found.mac), 1.0)


def test_complex_against_real():
    wave = np.exp(
        1j * np.deg2rad(3 * OWN.angle_deg)
    )  # travelling wave: half of it is a standing wave
    values = np.array(OWN.values)
    values[2] = wave
    found = compare_sources(OWN, replace(OWN, values=values))
    assert found.mac[2, 2] == pytest.approx(0.5, abs=1e-6)
    assert found.mac[0, 0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("form", "alignment", "axle"),
    [
        ({}, Alignment(), "axle along y, angles from x towards z"),
        ({"axes": (0, 1)}, Alignment(), "axle along z, angles from x towards y"),
        (
            {"axes": (1, 2), "millimetre": True},
            Alignment(),
            "axle along x, angles from y towards z",
        ),
        ({"turned_deg": 40.0}, Alignment(rotate_deg=40.0), "axle along y"),
        (
            {"sense": -1, "turned_deg": 25.0},
            Alignment(rotate_deg=25.0, mirror=True),
            "axle along y",
        ),
    ],
    ids=["as measured", "axle along z", "millimetres", "turned", "mirrored"],
)
def test_a_model_has_the_measured_shapes_in_its_pairs(folder, tmp_path, form, alignment, axle):
    found = compare_shapes(folder, tyre_model(tmp_path / "model.unv", **form), alignment)
    assert found.places.row.size == 72
    assert axle in found.notes[0]
    for match in found.matches:
        assert match.other // 2 == match.mode
        assert match.mac < 0.99
        assert match.mac_pair > 0.99
        assert match.difference_percent == pytest.approx(2.0, abs=1e-3)
        assert match.verdict == "same shape"
    tread = slice(0, 120)
    assert set(found.other.node[found.places.other_row]) <= set(found.other.node[tread])


def test_a_wrong_zero_does_not_pass_for_the_right_one(folder, tmp_path):
    """Single shapes, no pairs: turned by half a wave of n = 2, it is at right angles."""
    turned = replace(OWN, angle_deg=OWN.angle_deg + 45.0)
    found = compare_sources(OWN, turned)
    assert found.mac[1, 1] < 1e-9
    aligned = compare_sources(OWN, turned, Alignment(rotate_deg=-45.0))
    assert aligned.mac[1, 1] == pytest.approx(1.0)


def test_coarse_nodes_serve_the_nearest_position_and_missing_ones_are_named():
    rows = np.arange(0, 72, 4)
    coarse = replace(
        OWN,
        node=OWN.node[rows],
        angle_deg=OWN.angle_deg[rows] + 1.0,
        values=OWN.values[:, rows],
        radius_m=OWN.radius_m[rows],
        across_m=OWN.across_m[rows],
    )
    found = compare_sources(OWN, coarse, Alignment(tolerance_deg=10.0))
    assert found.places.row.tolist() == rows.tolist()
    assert "18 of 72 places" in found.notes[0]
    assert "at most 1° apart" in found.notes[0]
    assert "positions 5°, 10°, 15°" in found.notes[1]
    assert "48 more" in found.notes[1]


def test_nodes_that_a_mode_lacks_are_left_out():
    values = np.array(OWN.values)
    values[3, 10] = np.nan
    found = compare_sources(OWN, replace(OWN, values=values))
    assert found.places.row.size == 71
    assert "position 50°" in found.notes[1]
    assert np.isfinite(found.mac).all()


def test_other_node_numbers_match_by_angle_only():
    other = replace(OWN, node=OWN.node + 500)
    assert compare_sources(OWN, other).places.row.size == 72
    with pytest.raises(InputError, match="0 places in common"):
        compare_sources(OWN, other, Alignment(by="node"))


def test_a_structure_is_compared_by_node(plate, tmp_path):
    written = export(plate, tmp_path / "plate.uff", frfs="none")
    found = compare_shapes(plate, written.path)
    assert found.places.by == "node"
    assert "motion along z, the only one" in found.notes[0]
    np.testing.assert_allclose(np.diag(found.mac), 1.0, atol=1e-9)
    with pytest.raises(InputError, match="Choose --by node"):
        compare_shapes(plate, written.path, Alignment(by="angle"))


def test_motion_in_space_needs_nodes_or_a_direction(plate, tmp_path):
    path = tmp_path / "space.uff"
    node = np.arange(1, 11)
    shapes = [mode.shape for mode in structure_result().modal_model.modes]
    path.write_bytes(
        b"".join(
            shape_55(ShapeDataset(k, (), 600j, node, np.outer(shape, [0.3, 1.0, 0.0])))
            for k, shape in enumerate(shapes, start=1)
        )
    )
    with pytest.raises(InputError, match="shapes along x, y"):
        compare_shapes(plate, path)
    found = compare_shapes(plate, path, Alignment(direction="y"))
    np.testing.assert_allclose(np.diag(found.mac), 1.0, atol=1e-9)


def test_shapes_that_pyuff_wrote_are_read(folder, tmp_path):
    """Another writer: dataset 15 for the nodes, in the x-y plane, and real shapes."""
    path, node = tmp_path / "other.uff", np.arange(1, 37)
    turn = np.deg2rad(10.0 * (node - 1))
    zeros = np.zeros(node.size)
    file = pyuff.UFF(str(path))
    file.write_sets(
        {
            "type": 15,
            "node_nums": node,
            "def_cs": zeros,
            "disp_cs": zeros,
            "color": zeros,
            "x": np.cos(turn),
            "y": np.sin(turn),
            "z": zeros,
        },
        "overwrite",
    )
    shape = np.cos(2 * turn)
    mode = {
        "type": 55,
        "model_type": 1,
        "analysis_type": 2,
        "data_ch": 2,
        "spec_data_type": 8,
        "data_type": 2,
        "load_case": 1,
        "mode_n": 1,
        "freq": 101.0,
        "modal_m": 1.0,
        "modal_damp_vis": 0.02,
        "modal_damp_his": 0.0,
        "node_nums": node,
        "r1": shape * np.cos(turn),
        "r2": shape * np.sin(turn),
        "r3": zeros,
    }
    file.write_sets(mode, "add")
    found = compare_shapes(folder, path)
    assert found.places.row.size == 36
    assert found.matches[1].mac == pytest.approx(1.0, abs=1e-9)
    assert found.matches[1].difference_hz == pytest.approx(101.0 - FREQUENCIES_HZ[1], abs=1e-3)
    assert found.matches[0].verdict == "no counterpart"
    assert set(match_rows(found)[0][2:6]) == {"–"}


def test_the_span_of_a_pair_explains_any_turn_of_it():
    angles = np.deg2rad(OWN.angle_deg)
    pair = np.stack([np.cos(2 * angles), np.sin(2 * angles)])
    assert explained_share(np.cos(2 * angles - 0.4), pair) == pytest.approx(1.0)
    assert explained_share(np.cos(3 * angles), pair) == pytest.approx(0.0, abs=1e-12)
    twice = np.vstack([pair, pair[0]])  # a shape that adds nothing
    assert explained_share(np.cos(2 * angles - 0.4), twice) == pytest.approx(1.0)
    assert explained_share(np.cos(angles), np.zeros((1, 72))) == 0.0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a,b\n1,2\n", "columns a, b"),
        ("mode,node,real\n", "no lines"),
        ("mode,node,real\n1,1,zero\n", "line 2"),
        ("mode,node,real\n1,1,\n", "no real"),
        ("mode,node,real\n1,1,1\n1,nan,1\n", "line 3: node nan; node must be a whole number"),
        ("mode,node,real\n1,1.5,1\n", "node 1.5"),
        ("mode,node,real\ninf,1,1\n", "mode inf"),
        ("mode,node,real\n1,4,1\n2,4,1\n1,4,3\n", "two values of mode 1 at node 4; "),
        ("mode,position_deg,real\n1,5,1\n1,5,3\n", "mode 1 at 5 degrees"),
    ],
)
def test_malformed_tables_are_refused(tmp_path, text, expected):
    path = tmp_path / "shapes.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=expected):
        read_source(path)


def test_an_angle_of_nan_is_unknown(tmp_path):
    path = tmp_path / "shapes.csv"
    path.write_text("mode,node,position_deg,real\n1,1,nan,0.5\n1,2,nan,1\n2,1,nan,1\n2,2,nan,0.1\n")
    found = read_source(path)
    assert not found.has_angles
    np.testing.assert_array_equal(found.values, [[0.5, 1.0], [1.0, 0.1]])


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["nowhere.uff"], "no such file"),
        (["RESULT", "--by", "angel"], "angle"),
        (["RESULT", "--direction", "radail"], "radial"),
        (["RESULT", "--tolerance-deg", "0"], "above 0"),
        (["RESULT", "--rotate-deg", "inf"], "finite angle"),
        (["RESULT", "--out", "shapes.xlsx"], ".csv, .html"),
    ],
)
def test_bad_choices_end_with_2_and_the_nearest_good_one(
    ringmodal, folder, tmp_path, monkeypatch, words, expected
):
    monkeypatch.chdir(tmp_path)
    code, _, complaint = ringmodal(
        "compare-shapes", folder, *[folder if word == "RESULT" else word for word in words]
    )
    assert code == 2
    assert expected in complaint
    assert not any(tmp_path.iterdir())


def test_the_command_shows_table_and_notes(ringmodal, folder, tmp_path):
    model = tyre_model(tmp_path / "model.unv")
    code, output, _ = ringmodal("compare-shapes", folder, model)
    assert code == 0
    assert output.count("same shape") == 7
    assert "Note: model.unv: axle along y" in output
    assert "mm off the measured circle" not in output
    code, output, _ = ringmodal("compare-shapes", folder, model, "--json")
    record = json.loads(output)
    assert np.shape(record["mac"]) == (7, 14)
    assert record["modes"][2]["verdict"] == "same shape"


def test_table_and_page_are_written(ringmodal, folder, tmp_path):
    model = tyre_model(tmp_path / "model.unv")
    table, page = tmp_path / "shapes.csv", tmp_path / "shapes.html"
    for place in (table, page):
        assert ringmodal("compare-shapes", folder, model, "--out", place)[0] == 0
        code, _, complaint = ringmodal("compare-shapes", folder, model, "--out", place)
        assert code == 2
        assert "--force" in complaint
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["verdict"] for row in rows] == ["same shape"] * 7
    assert {"mac_1", "mac_14"} <= set(rows[0])
    text = page.read_text(encoding="utf-8")
    assert "7 of 7 modes of tyre_7 have the same shape as a mode of model.unv." in text


def test_a_page_shows_only_modes_worth_showing():
    many = np.concatenate(
        [np.tile(np.exp(1j * 20 * np.deg2rad(OWN.angle_deg)), (60, 1)), OWN.values]
    )
    unknown = np.full(67, np.nan)
    other = replace(
        OWN,
        values=many,
        frequency_hz=np.arange(67) + 1.0,
        damping_ratio=unknown,
        frequency_std_hz=unknown,
        mode_name=tuple(map(str, range(1, 68))),
    )
    (chart,) = sections(compare_sources(OWN, other))[1].blocks
    assert "7 of 67 are shown" in chart.caption
