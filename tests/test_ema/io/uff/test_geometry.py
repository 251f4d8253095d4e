"""Nodes in any coordinate system of the file come out in Cartesian ones of the structure."""

import numpy as np
import pytest
from builders import SHARED_DATA, dataset, nodes15, nodes2411, response58, row, units164
from uff_datasets import CARTESIAN, CYLINDRICAL, SPHERICAL, nodes_in, system18, system2420

from ema.core.errors import RecordingFormatError
from ema.io.uff.geometry import read_nodes, read_units
from ema.io.uff.reader import read as read_uff
from ema.io.uff.scan import scan

OROS = SHARED_DATA / "uff_corpus" / "mesh_Oros-modal_uff15_uff2412.uff"


def write(tmp_path, content):
    (path := tmp_path / "a.uff").write_bytes(content)
    return path


def nodes_of(tmp_path, content):
    path = write(tmp_path, content)
    found = read_nodes(path, scan(path))
    return found.xyz, found.doubt


def test_2411_is_in_the_structure_s_own_system(tmp_path):
    other = system2420(1, CYLINDRICAL, np.eye(3), (5, 5, 5))
    nodes, doubt = nodes_of(tmp_path, other + nodes2411({7: (1.0, -2.0, 1e-300)}))
    assert nodes[7].tolist() == [1.0, -2.0, 1e-300]
    assert doubt == ""


@pytest.mark.parametrize(
    ("kind", "stated", "expected"),
    [
        (CARTESIAN, (1, 2, 3), (1, 2, 3)),
        (CYLINDRICAL, (2, 30, 5), (np.sqrt(3), 1, 5)),
        (SPHERICAL, (2, 90, 30), (np.sqrt(3), 1, 0)),
        (SPHERICAL, (2, 0, 77), (0, 0, 2)),
    ],
)
@pytest.mark.parametrize("build", ["18", "2420"])
def test_kinds_of_systems(tmp_path, kind, stated, expected, build):
    system = system18(3, kind) if build == "18" else system2420(3, kind, np.eye(3), (0, 0, 0))
    nodes, doubt = nodes_of(tmp_path, nodes_in(3, {1: stated}) + system)
    np.testing.assert_allclose(nodes[1], expected, atol=1e-12)
    assert doubt == ""


def test_a_turned_and_shifted_system(tmp_path):
    turned = {"origin": (10, 0, 0), "x": (10, 1, 0), "xz": (10, 0, 1)}  # its x is the whole's y
    by_18, _ = nodes_of(tmp_path, nodes_in(2, {1: (1, 2, 3)}) + system18(2, **turned))
    axes = [(0, 1, 0), (-1, 0, 0), (0, 0, 1)]
    matrix = system2420(2, CARTESIAN, axes, (10, 0, 0))
    by_2420, _ = nodes_of(tmp_path, nodes_in(2, {1: (1, 2, 3)}) + matrix)
    np.testing.assert_allclose(by_18[1], [8, 1, 3], atol=1e-12)
    np.testing.assert_allclose(by_2420[1], by_18[1], atol=1e-12)


def test_systems_stand_on_one_another(tmp_path):
    turned = {"x": (0, 1, 0), "xz": (0, 0, 1)}  # a quarter turn about z; two make a half
    content = nodes_in(5, {1: (1, 0, 0)}) + system18(5, reference=6, **turned)
    nodes, _ = nodes_of(
        tmp_path, content + system18(6, origin=(0, 0, 4), x=(0, 1, 4), xz=(0, 0, 5))
    )
    np.testing.assert_allclose(nodes[1], [-1, 0, 4], atol=1e-12)


def test_undefined_systems_are_doubted_unless_they_are_the_whole(tmp_path):
    assert nodes_of(tmp_path, nodes_in(1, {1: (1, 0, 0)}))[1] == ""
    nodes, doubt = nodes_of(tmp_path, nodes_in(4, {1: (1, 2, 0)}))
    assert nodes[1].tolist() == [1, 2, 0]
    assert "coordinate system 4" in doubt


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (nodes_in(1, {1: (1, 0, 0)}) + system18(1, x=(0, 0, 0)), "span a plane"),
        (nodes_in(1, {1: (1, 0, 0)}) + system18(1, x=(0, 0, 2)), "span a plane"),
        (nodes_in(1, {1: (1, 0, 0)}) + system18(1, x=(np.inf, 0, 2)), "span a plane"),
        (
            nodes_in(1, {1: (1, 0, 0)}) + system18(1, reference=2) + system18(2, reference=1),
            "coordinate system 2",
        ),
        (
            nodes_in(1, {1: (1, 0, 0)}) + dataset(18, "         1         0         0", "x"),
            "end of",
        ),
        (dataset(2411, "         1         1         1        11", "  1.0  2.0"), "3 numbers"),
        (dataset(2411, "         1         1         1        11"), "end of the dataset"),
        (dataset(15, "1.5 0 0 0 1.0 0.0 0.0"), "whole numbers"),
        (dataset(15, "1e300 0 0 0 1.0 0.0 0.0"), "whole numbers"),
        (dataset(15, "1 0 0 0 1.0 0.0"), "7 numbers"),
        (dataset(2411, "       inf         1         1        11", "0.0 0.0 0.0"), "whole numbers"),
    ],
)
def test_damaged_geometry_is_named(tmp_path, content, message):
    with pytest.raises(RecordingFormatError, match=message) as caught:
        nodes_of(tmp_path, content)
    assert caught.value.where.startswith("a.uff, dataset ")


@pytest.mark.parametrize("stated", [(np.nan, 0, 0), (np.inf, 90, 0), (1, np.inf, 0), (1e300, 1, 2)])
def test_senseless_coordinates_give_no_angles(tmp_path, stated):
    content = nodes_in(3, {1: stated, 2: (1, 90, 0)}) + system18(3, CYLINDRICAL)
    content += response58(node=1) + response58(name="A02", node=2)
    found = read_uff(write(tmp_path, content))
    assert {each.angle_deg for each in found.recording.channels} == {None}
    assert [each.check for each in found.findings] == ["geometry"]


def test_angles_from_a_cylindrical_system(tmp_path):
    places = {node: (0.3, 5.0 * node, 0.1) for node in range(0, 72, 6)}
    content = system18(2, CYLINDRICAL) + nodes_in(2, places)
    content += b"".join(response58(name=f"A{node}", node=node) for node in places)
    channels = read_uff(write(tmp_path, content)).recording.channels
    found = [each.angle_deg for each in channels]
    assert found == pytest.approx([5.0 * each.node for each in channels], abs=1e-3)


def test_elements_trace_lines_and_headers_are_passed_over_silently(tmp_path):
    around = [
        dataset(151, *["x"] * 7),
        dataset(82, "1 2 0", "lines", "1 2"),
        dataset(2412, row("10d " * 6, 1, 11, 0, 0, 7, 2), row("10d 10d 10d", 0, 0, 0), "1 2"),
        units164(1.0, 1.0),
        nodes15({1: (1, 0, 0), 2: (0, 1, 0)}),
    ]
    content = b"".join(around) + response58(node=1) + response58(name="A02", node=2)
    found = read_uff(write(tmp_path, content))
    assert found.findings == ()
    assert [each.angle_deg for each in found.recording.channels] == [0.0, 90.0]


@pytest.mark.parametrize(
    ("line", "message"), [("1.0", "2 numbers"), ("-1.0 1.0", "positive"), ("nan 1.0", "positive")]
)
def test_damaged_units_are_named(tmp_path, line, message):
    path = write(tmp_path, dataset(164, "         9user", line))
    with pytest.raises(RecordingFormatError, match=message):
        read_units(path, scan(path)[0])


@pytest.mark.skipif(not OROS.exists(), reason="measured data of others are not at hand")
def test_nodes_of_a_real_drum_lie_every_fifteen_degrees_or_so():
    found = read_nodes(OROS, scan(OROS))
    nodes, doubt = found.xyz, found.doubt
    assert doubt == ""
    assert len(nodes) == 96
    np.testing.assert_allclose(nodes[4], [0.0, 83.25, 50.0], atol=1e-12)
    np.testing.assert_allclose(nodes[22], [83.25, 0.0, 50.0], atol=1e-12)
