"""Universal files: units, signs, geometry and FRFs, from scenarios with known answers."""

import re
import tracemalloc

import numpy as np
import pytest
from builders import binary58, floats, force58, frf58, nodes15, nodes2411, response58, units164
from hypothesis import given
from hypothesis import strategies as st

from ema.core.errors import RecordingFormatError
from ema.core.units import parse_ratio, parse_unit
from ema.io.uff.geometry import angles_on_circle
from ema.io.uff.reader import read as read_uff

G = 9.80665
H = np.array([1 + 2j, -3 + 0.5j, 0.25 - 4j, 2 + 0j])


def read(tmp_path, content):
    path = tmp_path / "a.uff"
    path.write_bytes(content)
    return read_uff(path)


def channel(tmp_path, **header):
    content = header.pop("before", b"") + response58(**header)
    return read(tmp_path, content).recording.channels[0]


@pytest.mark.parametrize(
    ("axis", "quantity", "factor"),
    [
        ((12, 0, 0, "Acceleration", "m/s^2"), "acceleration", 1.0),
        ((12, 0, 0, "Acceleration", "NONE"), "acceleration", 1.0),
        ((12, 0, 0, "Acceleration", "g"), "acceleration", G),
        ((12, 0, 0, "Acceleration", "mm/s2"), "acceleration", 1e-3),
        ((13, 0, 0, "Force", "kN"), "force", 1e3),
        ((13, 0, 0, "Force", ""), "force", 1.0),
        ((11, 0, 0, "Velocity", "mm/s"), "velocity", 1e-3),
        ((8, 0, 0, "Displacement", "µm"), "displacement", 1e-6),
        ((0, 1, 0, "Acceleration", "m/s²"), "acceleration", 1.0),
        ((15, 0, 0, "Pressure", "Pa"), "unknown", 1.0),
        ((12, 0, 0, "Acceleration", "V"), "voltage", 1.0),
    ],
)
def test_quantity_and_unit(tmp_path, axis, quantity, factor):
    found = channel(tmp_path, axis=axis)
    assert found.quantity == quantity
    assert found.scale_to_si == pytest.approx(factor, rel=1e-15)


@pytest.mark.parametrize(
    ("axis", "factor"),
    [
        ((12, 0, 0, "Acceleration", "NONE"), 1e-3),
        ((12, 1, 1, "Acceleration", "NONE"), 1e-3),  # exponents mean nothing here
        ((12, 0, 0, "Acceleration", "m/s^2"), 1.0),  # the label takes precedence
        ((13, 0, 0, "Force", "NONE"), 0.25),
        ((0, 0, 1, "Load", "NONE"), 0.25),
        ((1, 2, 0, "Area", "NONE"), 1e-6),
        ((0, 0, 0, "Counts", "NONE"), 1.0),
        ((0, -1, 1, "Stiffness", "NONE"), 250.0),
    ],
)
def test_factors_of_dataset_164_divide(tmp_path, axis, factor):
    found = channel(tmp_path, before=units164(1e3, 4.0), axis=axis)
    assert found.scale_to_si == pytest.approx(factor, rel=1e-12)


def test_odd_units_are_reported(tmp_path):
    found = read(tmp_path, response58(axis=(12, 0, 0, "Acceleration", "EU")))
    assert "'EU' is not known" in found.findings[0].detail
    found = read(tmp_path, response58(axis=(12, 0, 0, "Acceleration", "N")))
    assert found.recording.channels[0].quantity == "force"
    assert "type 12 means acceleration" in found.findings[0].detail
    found = read(tmp_path, units164(1e3, 1.0) + response58(axis=(0, 999, 0, "x", "")))
    assert "make no sense" in found.findings[0].detail


def test_negative_direction_flips_the_sign_once(tmp_path):
    forward = channel(tmp_path, direction=1).block(0, 8)
    backward = channel(tmp_path, direction=-1).block(0, 8)
    assert forward.any()
    np.testing.assert_array_equal(backward, -forward)


def circle(nodes, *, centre=(0.0, 0.0), radius=0.3, plane=(0, 1)):
    points = {}
    for node in nodes:
        point = [0.0, 0.0, 0.0]
        angle = np.radians(5.0 * node)
        point[plane[0]] = centre[0] + radius * np.cos(angle)
        point[plane[1]] = centre[1] + radius * np.sin(angle)
        points[node] = np.array(point)
    return points


@pytest.mark.parametrize("build", [nodes15, nodes2411])
@pytest.mark.parametrize("first", [True, False])
def test_geometry_gives_angles(tmp_path, build, first):
    geometry = build(circle([0, 7, 20, 71], plane=(0, 2)))
    functions = b"".join(response58(name=f"A{n}", node=n) for n in (7, 20, 71))
    content = geometry + functions if first else functions + geometry
    found = read(tmp_path, content).recording
    angles = [each.angle_deg for each in found.channels]
    assert angles == pytest.approx([35.0, 100.0, 355.0], abs=1e-3)


def test_geometry_of_no_circle_gives_no_angles(tmp_path):
    line = nodes15({node: (0.1 * node, 0.0, 0.0) for node in (1, 2, 3, 4, 5)})
    functions = b"".join(response58(name=f"A{n}", node=n) for n in (1, 2, 3, 4, 5))
    found = read(tmp_path, line + functions)
    assert {each.angle_deg for each in found.recording.channels} == {None}
    assert [finding.check for finding in found.findings] == ["geometry"]


@given(
    st.sets(st.integers(0, 71), min_size=5, max_size=30),
    st.tuples(st.floats(-2, 2), st.floats(-2, 2)),
    st.sampled_from([(0, 1), (0, 2), (1, 2)]),
)
def test_angles_do_not_depend_on_centre_or_plane(nodes, centre, plane):
    # Offset by at least a tenth of the radius or not at all: smaller ones count as round.
    centre = tuple(0.0 if abs(each) < 0.1 else each for each in centre)
    span = np.ptp([5.0 * node for node in nodes])
    if span < 90.0:
        return
    found = angles_on_circle(circle(sorted(nodes), centre=centre, plane=plane))
    for node, angle in found.items():
        difference = (angle - 5.0 * node + 180.0) % 360.0 - 180.0
        assert abs(difference) < 1e-6
    assert set(found) == nodes


def test_angles_need_points():
    assert angles_on_circle({}) == {}
    assert angles_on_circle({1: np.zeros(3)}) == {}
    assert angles_on_circle({1: np.full(3, np.nan)}) == {}


def test_frf_rows_are_inertances(tmp_path):
    content = frf58(H, node=3) + frf58(2 * H, node=5)
    frf = read(tmp_path, content).frf
    np.testing.assert_array_equal(frf.values, [H, 2 * H])
    np.testing.assert_array_equal(frf.frequency_hz, [0.0, 1.0, 2.0, 3.0])
    assert frf.node.tolist() == [3, 5]
    assert np.isnan(frf.position_deg).all()


@pytest.mark.parametrize(
    ("axis", "power"), [((8, 0, 0, "Displacement", "mm"), 2), ((11, 0, 0, "Velocity", "mm/s"), 1)]
)
def test_receptance_and_mobility_become_inertance(tmp_path, axis, power):
    found = read(tmp_path, frf58(H, axis=axis))
    omega = 2j * np.pi * np.arange(4.0)
    np.testing.assert_allclose(found.frf.values[0], 1e-3 * H * omega**power, rtol=1e-14)
    assert [finding.check for finding in found.findings] == ["quantity"]


@pytest.mark.parametrize(
    ("direction", "reference", "sign"), [(3, 3, 1), (-3, 3, -1), (3, -3, -1), (-3, -3, 1)]
)
def test_signs_of_both_directions_count(tmp_path, direction, reference, sign):
    frf = read(tmp_path, frf58(H, direction=direction, reference_direction=reference)).frf
    np.testing.assert_array_equal(frf.values[0], sign * H)


@pytest.mark.parametrize(
    ("axis", "denominator", "factor"),
    [
        ((12, 0, 0, "Acceleration", "g"), (13, 0, 0, "Force", "kN"), G / 1e3),
        ((12, 0, 0, "Acceleration", "(m/s^2)/N"), (0, 0, 0, "NONE", "NONE"), 1.0),
        ((12, 0, 0, "Acceleration", "g/N"), (13, 0, 0, "Force", "NONE"), G),
        ((12, 0, 0, "Acceleration", "m/s^2"), (0, 0, 0, "NONE", "NONE"), 1.0),
    ],
)
def test_units_of_frfs(tmp_path, axis, denominator, factor):
    frf = read(tmp_path, frf58(H, axis=axis, denominator=denominator)).frf
    np.testing.assert_allclose(frf.values[0], factor * H, rtol=1e-14)


def test_every_frf_keeps_its_force(tmp_path):
    content = b"".join(frf58(H, node=1, reference_node=k) for k in (1, 2, 3))
    found = read(tmp_path, content)
    assert found.frf.node.tolist() == [1, 1, 1]
    assert found.frf_forces == ((1, 3), (2, 3), (3, 3))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (frf58(H, axis=(13, 0, 0, "Force", "N")), "force over force"),
        (frf58(H, denominator=(12, 0, 0, "Acceleration", "g")), "over acceleration"),
        (frf58(H) + frf58(H[:3], node=2), "3 lines, 0 to 2 Hz; dataset 1: 4 lines"),
        (frf58(H) + frf58(H, node=2, step="  2.00000E+00"), "0 to 6 Hz"),
        (frf58(H, step="  0.00000E+00"), "equidistant"),
        (frf58(H, start=" -1.00000E+00"), "positive and finite"),
        (frf58(H[:1]), "1 lines"),
    ],
)
def test_frfs_that_cannot_be_used(tmp_path, content, message):
    with pytest.raises(RecordingFormatError, match=re.escape(message)):
        read(tmp_path, content)


def test_time_series_and_frfs_of_one_file_are_both_there(tmp_path):
    found = read(tmp_path, force58() + response58() + frf58(H))
    assert found.recording.names == ("force", "A01")
    assert found.frf_names == ("A01",)


def coherence58(values, **header):
    defaults = {"function_type": 6, "ordinate": 2, "n": len(values), "step": "  1.00000E+00"}
    defaults |= {"abscissa": (18, 0, 0, "Frequency", "Hz")}
    defaults |= {"reference_node": 1, "reference_direction": 3}
    return binary58(floats(values), **defaults | header)


def test_coherence_goes_with_the_frf_of_its_nodes(tmp_path):
    """In any order, whatever the signs of directions; it is not among what was left out."""
    one, two = [0.9, 0.8, 0.5, 1.0005], [0.1, 0.2, 0.3, 0.4]
    found = read(
        tmp_path,
        coherence58(two, node=8) + frf58(H, node=7) + frf58(H, node=8) + coherence58(one, node=7),
    )
    np.testing.assert_allclose(found.frf.coherence, [np.minimum(one, 1.0), two], rtol=1e-6)
    assert found.findings == ()


@pytest.mark.parametrize(
    "odd",
    [
        coherence58([0.9, 0.8, 0.5, 0.4], node=9),
        coherence58([0.9, 0.8, 0.5, 0.4], node=8, step="  2.00000E+00"),
        coherence58([0.9, 0.8, 1.5, 0.4], node=8),
        coherence58([0.9, 0.8, np.nan, 0.4], node=8),
        coherence58([0.9, 0.8, 0.5, 0.4], node=8, step="  0.00000E+00"),
    ],
    ids=["nodes", "lines", "values", "not a number", "damaged"],
)
def test_what_is_no_coherence_of_an_frf_is_left_out_and_named(tmp_path, odd):
    good = coherence58([0.9, 0.8, 0.5, 0.4], node=7)
    found = read(tmp_path, frf58(H, node=7) + frf58(H, node=8) + good + odd)
    assert np.isfinite(found.frf.coherence[0]).all()
    assert np.isnan(found.frf.coherence[1]).all()
    (finding,) = found.findings
    assert finding.check == "coherence"
    assert finding.verdict == "warning"


def test_uneven_lines_that_are_equidistant(tmp_path):
    rows = [part for k, h in enumerate(H) for part in (float(k), h.real, h.imag)]
    payload = floats(rows)
    content = binary58(
        payload,
        function_type=4,
        ordinate=5,
        n=4,
        even=0,
        abscissa=(18, 0, 0, "Frequency", "Hz"),
        denominator=(13, 0, 0, "Force", "N"),
    )
    frf = read(tmp_path, content).frf
    np.testing.assert_array_equal(frf.values[0], H)
    np.testing.assert_array_equal(frf.frequency_hz, [0.0, 1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("text", "quantity", "factor"),
    [
        ("m/s^2", "acceleration", 1.0),
        ("m/s²", "acceleration", 1.0),
        ("m/s2", "acceleration", 1.0),
        ("M/S^2", "acceleration", 1.0),
        ("(m/s^2)", "acceleration", 1.0),
        ("m s^-2", "acceleration", 1.0),
        ("G", "acceleration", G),
        ("in/s^2", "acceleration", 0.0254),
        ("mN", "force", 1e-3),
        ("MN", "force", 1e6),
        ("Newtons", "force", 1.0),
        ("lbf", "force", 4.4482216152605),
        ("um", "displacement", 1e-6),
        ("μm", "displacement", 1e-6),
        ("volts", "voltage", 1.0),
    ],
)
def test_unit_texts(text, quantity, factor):
    unit = parse_unit(text)
    assert (unit.quantity, unit.factor) == (quantity, factor)


@pytest.mark.parametrize("text", ["", "NONE", "EU", "mn", "N/V", "()", "m/s^3"])
def test_unknown_unit_texts(text):
    assert parse_unit(text) is None


def test_ratios():
    motion, force = parse_ratio("(m/s^2)/N")
    assert (motion.quantity, force.quantity) == ("acceleration", "force")
    assert parse_ratio("m/s^2") is None
    assert parse_ratio("N") is None


def test_single_precision_frfs_take_twice_their_file(tmp_path):
    values = np.random.default_rng(5).normal(size=(40, 8000)).astype("<f4")
    path = tmp_path / "a.uff"
    path.write_bytes(
        b"".join(frf58(row.view("<c8"), node=k, single=True) for k, row in enumerate(values))
    )
    tracemalloc.start()
    try:
        frf = read_uff(path).frf
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert frf.values.nbytes > 1.9 * path.stat().st_size
    assert peak < 2.5 * path.stat().st_size
