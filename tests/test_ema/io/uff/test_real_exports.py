"""Universal files as other programs and people write them."""

import numpy as np
import pytest
from builders import ascii58, binary58, fixed, floats, frf58, header58, units164

import ema
from ema.core.errors import InputError
from ema.core.finding import Check, Verdict
from ema.io.formats import read_file

LINES = np.arange(1, 9)
VALUES = np.exp(1j * LINES / 3)


def written(path, *parts):
    path.write_bytes(b"".join(parts))
    return path


def rows(axes, nodes=range(1, 5), reference=(1, 3)):
    """FRFs of nodes in some axes (1 to 3), to a force at `reference` (node, axis)."""
    return [
        frf58(
            axis * VALUES,
            name="NONE",
            node=node,
            direction=axis,
            reference_node=reference[0],
            reference_direction=reference[1],
        )
        for node in nodes
        for axis in axes
    ]


def test_units_hold_for_what_follows(tmp_path):
    samples, millimetres = floats([1.0] * 8), {"axis": (12, 0, 0, "Acceleration", "NONE")}
    path = written(
        tmp_path / "a.uff",
        units164(1.0, 1.0),
        binary58(samples, name="A01", **millimetres),
        units164(1000.0, 1000.0),
        binary58(samples, name="A02", **millimetres),
    )
    channels = read_file(path).recording.channels
    assert [channel.scale_to_si for channel in channels] == [1.0, pytest.approx(1e-3)]


def test_a_last_line_filled_with_zeros(tmp_path):
    text = fixed([*np.arange(1.0, 9.0), 0, 0, 0, 0])
    content = read_file(written(tmp_path / "a.uff", ascii58(text)))
    samples = content.recording.channels[0].samples
    np.testing.assert_array_equal(samples, np.arange(1.0, 9.0))
    (said,) = (each for each in content.findings if each.check is Check.CONTENT)
    assert (said.verdict, "last line" in said.detail) == (Verdict.OK, True)
    wrong = fixed([*np.arange(1.0, 9.0), 0, 0, 0, 1])
    with pytest.raises(InputError, match="more than stated"):
        read_file(written(tmp_path / "b.uff", ascii58(wrong)))


@pytest.mark.parametrize("entity", ["WHEEL_FL_12", "WHEEL_FRONT_LEFT_2", "A"])
def test_entity_names_of_any_length(tmp_path, entity):
    header = header58(node=7, direction=3, reference_node=4, reference_direction=-1)
    names = [f"{'NONE':<10}{number:10d}{axis:4d}".encode() for number, axis in ((7, 3), (4, -1))]
    for old in names:
        assert old in header
        header = header.replace(old, f"{entity:<10}".encode() + old[10:])
    path = written(tmp_path / "a.uff", header, fixed(np.arange(8.0)).encode(), b"    -1\n")
    (channel,) = read_file(path).recording.channels
    assert (channel.node, channel.axis) == (7, 3)


@pytest.mark.parametrize("ordinate", [2, 4])
def test_magnitudes_are_no_frfs(tmp_path, ordinate):
    path = written(
        tmp_path / "a.uff",
        ascii58(
            fixed(np.abs(VALUES), *((13, 5, 6) if ordinate == 2 else (20, 12, 4))),
            function_type=4,
            ordinate=ordinate,
            abscissa=(18, 0, 0, "Frequency", "Hz"),
            denominator=(13, 0, 0, "Force", "N"),
        ),
    )
    with pytest.raises(InputError, match="real and imaginary part"):
        read_file(path)


def test_channels_of_one_title_go_by_degree_of_freedom(tmp_path):
    parts = [
        binary58(floats(range(8)), name="Run 1", node=n, direction=d) for n, d in ((1, 3), (2, -1))
    ]
    assert read_file(written(tmp_path / "a.uff", *parts)).recording.names == ("1+Z", "2-X")


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252"])
def test_headers_in_any_encoding(tmp_path, encoding):
    name = "Vorderrad – außen"
    lines = header58(name="@@", axis=(12, 0, 0, "Acceleration", "m/s^2")).decode("latin-1")
    header = lines.replace("@@", name).encode(encoding)
    path = written(tmp_path / "a.uff", header, fixed(np.arange(8.0)).encode(), b"    -1\n")
    assert read_file(path).recording.names == (name,)


MANIFEST = """\
schema = 1
[grid]
positions = 4
[excitation]
position_deg = 0.0
[[runs]]
file = "a.uff"
"""


def test_on_a_circle_the_direction_of_the_force_counts(tmp_path):
    written(tmp_path / "a.uff", *rows((1, 2, 3)))
    (tmp_path / "campaign.toml").write_text(MANIFEST, encoding="utf-8")
    campaign = ema.read_campaign(tmp_path)
    np.testing.assert_array_equal(campaign.frf.axis, [3, 3, 3, 3])
    (finding,) = [each for each in campaign.findings if each.check is Check.DIRECTION]
    assert "8 of 12" in finding.detail


def test_a_force_in_no_direction_of_the_sensors_is_refused(tmp_path):
    written(tmp_path / "a.uff", *rows((1, 2)))
    (tmp_path / "campaign.toml").write_text(MANIFEST, encoding="utf-8")
    with pytest.raises(InputError, match="direction of the force"):
        ema.read_campaign(tmp_path)


def test_a_structure_keeps_all_directions(tmp_path):
    frf = ema.read_campaign(written(tmp_path / "a.uff", *rows((1, 2, 3)))).frf
    np.testing.assert_array_equal(frf.axis, [1, 2, 3] * 4)
    np.testing.assert_array_equal(frf.node, np.repeat([1, 2, 3, 4], 3))


def test_forces_at_several_nodes_are_not_mixed(tmp_path):
    for number in (1, 2):
        written(tmp_path / f"{number}.uff", *rows((3,), reference=(number, 3)))
    found = ema.read_campaign(tmp_path).frf
    assert [(frf.force_node, frf.run[0]) for frf in found] == [(1, "1.uff"), (2, "2.uff")]


def test_a_long_entity_name_with_blanks_is_no_node(tmp_path):
    name = b"WHEEL FL 12         7   3"
    header = header58(node=7, direction=3).replace(f"{'NONE':<10}{7:10d}{3:4d}".encode(), name)
    path = written(tmp_path / "a.uff", header, fixed(np.arange(8.0)).encode(), b"    -1\n")
    with pytest.raises(InputError, match=r"line 8.*WHEEL FL 12"):
        read_file(path)


def resonances(sign):
    """Inertances of four nodes at 0 to 127 Hz, all of one sign."""
    omega = 2j * np.pi * np.arange(128.0)
    modes = sum(omega**2 / (w**2 + 0.04 * w * omega + omega**2) for w in (190.0, 420.0))
    return [sign * shape * modes for shape in (1.0, -0.5, 0.3, 1.5)]


@pytest.mark.parametrize("sign", [1, -1])
def test_phases_of_the_other_convention_are_refused(tmp_path, sign):
    for name, change in (("right", np.asarray), ("wrong", np.conj)):
        parts = [
            frf58(change(values), node=node, name=f"H{node}")
            for node, values in enumerate(resonances(sign), 1)
        ]
        path = written(tmp_path / f"{name}.uff", *parts)
        if name == "right":
            assert ema.read_campaign(path).frf.n_positions == 4
        else:
            with pytest.raises(InputError, match=r"e\^\{-jωt\}"):
                ema.read_campaign(path)


def test_sensors_in_no_direction_of_the_force_are_refused(tmp_path):
    force = {"name": "force", "node": 1, "direction": 3, "axis": (13, 0, 0, "Force", "N")}
    parts = [
        binary58(floats(range(8)), name=f"A{node}{axis}", node=node, direction=axis)
        for node in (1, 2)
        for axis in (1, 2)
    ]
    written(tmp_path / "a.uff", binary58(floats(range(8)), **force), *parts)
    (tmp_path / "campaign.toml").write_text(MANIFEST, encoding="utf-8")
    with pytest.raises(InputError, match="no response in the direction of the force"):
        ema.read_campaign(tmp_path)
