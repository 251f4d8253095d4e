"""X, Y and Z around a circle: local ones are radial, global ones become so exactly or are named."""

import numpy as np
import pytest
from builders import binary58, floats, frf58, nodes2411
from systems import tyre_frf
from uff_datasets import CYLINDRICAL, system2420

import ema
from ema.checks.positions import axes_finding
from ema.core.campaign import Direction
from ema.core.errors import ManifestError, RecordingFormatError

POSITIONS, LINES = 24, np.arange(1.0, 201.0)
ANGLES = np.arange(POSITIONS) * 2 * np.pi / POSITIONS
X, Y, Z = 1, 2, 3


def motion():
    """Radial and tangential FRFs of a belt that does not stretch, driven at 0°."""
    omega, radial, tangential = 2 * np.pi * LINES, 0j, 0j
    for order in range(1, 9):
        pole = 2 * np.pi * (20 + 18 * order)
        q = -(omega**2) / (pole**2 - omega**2 + 0.05j * pole * omega)
        radial = radial + np.outer(np.cos(order * ANGLES), q)
        tangential = tangential - np.outer(np.sin(order * ANGLES) / order, q)
    return radial, tangential


RADIAL, TANGENTIAL = motion()
COS, SIN = np.cos(ANGLES)[:, None], np.sin(ANGLES)[:, None]
ALONG = {X: RADIAL * COS - TANGENTIAL * SIN, Z: RADIAL * SIN + TANGENTIAL * COS}


def frfs(rows, force=(1, X)):
    """FRFs of (node from 0, direction code, values); the file counts nodes from 1."""
    return b"".join(
        frf58(
            values,
            name=f"{node + 1}{'?XYZ'[abs(code)]}",
            node=node + 1,
            direction=code,
            start="  1.00000E+00",
            reference_node=force[0],
            reference_direction=force[1],
        )
        for node, code, values in rows
    )


def both_axes(force=(1, X)):
    return frfs([(k, code, ALONG[code][k]) for k in range(POSITIONS) for code in (X, Z)], force)


def circle(moving=1):
    """Nodes 1 to 24 in the x-z plane, which move along a system of dataset 2420."""
    wheel = system2420(2, CYLINDRICAL, [(1, 0, 0), (0, 0, 1), (0, -1, 0)], (0, 0, 0))
    points = {k + 1: (0.3 * np.cos(a), 0.0, 0.3 * np.sin(a)) for k, a in enumerate(ANGLES)}
    nodes = nodes2411(points)
    return wheel + nodes.replace(
        b"         1         1        11", b"%10d%10d%10d" % (1, moving, 11)
    )


def campaign(folder, content, grid="", run=""):
    (folder / "a.uff").write_bytes(content)
    text = f'schema = 1\n[grid]\npositions = {POSITIONS}\n{grid}\n[[runs]]\nfile = "a.uff"\n{run}\n'
    (folder / "campaign.toml").write_text(text)
    return ema.read_campaign(folder)


def by_angle(frf):
    return frf.values[np.argsort(np.round(frf.position_deg, 6))]


def says(found):
    (finding,) = axes_finding(found.frf, (10.0, 190.0))
    return finding.verdict, finding.detail


@pytest.mark.parametrize("snr_db", [0, 20])
@pytest.mark.parametrize("positions", [12, 24, 72])
@pytest.mark.parametrize("band_hz", [(20.0, 260.0), (20.0, 120.0), (150.0, 260.0)])
def test_radial_sensors_of_a_damped_tyre_are_not_doubted(snr_db, positions, band_hz):
    assert axes_finding(tyre_frf(snr_db=snr_db, positions=positions), band_hz) == []


def test_one_letter_at_all_nodes_is_radial_and_the_frfs_agree(tmp_path):
    found = campaign(
        tmp_path, frfs([(k, Z, RADIAL[k]) for k in range(POSITIONS)], (1, Z)) + circle()
    )
    np.testing.assert_allclose(by_angle(found.frf), RADIAL)
    verdict, detail = says(found)
    assert verdict == "ok"
    assert "the FRFs agree" in detail


@pytest.mark.parametrize(("letter", "at_deg"), [(X, 0), (Z, 90)])
def test_one_axis_of_space_at_all_nodes_is_doubted(tmp_path, letter, at_deg):
    rows = [(k, letter, ALONG[letter][k]) for k in range(POSITIONS)]
    verdict, detail = says(campaign(tmp_path, frfs(rows, (1, letter)) + circle()))
    assert verdict == "warning"
    assert f"that at {at_deg}°" in detail
    assert "axes = [" in detail


@pytest.mark.parametrize("grid", ['axes = ["X", "Z"]', ""])
def test_two_axes_of_space_become_radial_exactly(tmp_path, grid):
    """By the manifest; without it one letter is taken as local, and that is doubted."""
    found = campaign(tmp_path, both_axes() + circle(), grid)
    assert found.frf.n_positions == POSITIONS
    if grid:
        np.testing.assert_allclose(by_angle(found.frf), RADIAL, atol=1e-9)
        assert axes_finding(found.frf, (10.0, 190.0)) == []
    else:
        assert says(found)[0] == "warning"


def test_other_letters_and_senses_of_the_axes(tmp_path):
    rows = [(k, -Y, ALONG[X][k]) for k in range(POSITIONS)]  # −Y points to 0°, X to 90°
    rows += [(k, X, ALONG[Z][k]) for k in range(POSITIONS)]
    content = frfs(rows, (1, -Y)) + circle()
    found = campaign(tmp_path, content, 'axes = ["-Y", "X"]')
    np.testing.assert_allclose(by_angle(found.frf), RADIAL, atol=1e-9)


def test_axes_that_the_file_defines_are_followed(tmp_path):
    """Radial and tangential by a cylindrical system, whatever the direction of the force."""
    rows = [(k, code, v[k]) for k in range(POSITIONS) for code, v in ((X, RADIAL), (Y, TANGENTIAL))]
    found = campaign(tmp_path, frfs(rows, (1, -X)) + circle(moving=2))
    np.testing.assert_allclose(by_angle(found.frf), -RADIAL, atol=1e-9)
    with pytest.raises(RecordingFormatError, match=r"force along Y, of which 0\.000 is radial"):
        campaign(tmp_path, frfs(rows, (1, Y)) + circle(moving=2))


def quarter(sense=1):
    """Each node along the nearest axis, as laboratories do with glued blocks."""
    codes = [(0, X), (6, Z), (12, sense * X), (18, sense * Z), (3, X), (9, Z)]
    return frfs([(k, code, np.sign(code) * ALONG[abs(code)][k]) for k, code in codes])


@pytest.mark.parametrize("sense", [1, -1])
def test_letters_that_change_are_global(tmp_path, sense):
    found = campaign(tmp_path, quarter(sense) + circle())
    np.testing.assert_allclose(by_angle(found.frf), RADIAL[[0, 6, 12, 18]], atol=1e-9)
    (askew,) = (each for each in found.findings if "neither radial" in each.detail)
    assert askew.verdict == "warning"
    assert "4X along X, 10Z along Z" in askew.detail


def test_letters_that_change_without_geometry_name_the_line_that_helps(tmp_path):
    with pytest.raises(RecordingFormatError, match=r'axes to \[grid\].*"X", "Z"'):
        campaign(tmp_path, quarter())
    angles = "positions_deg = { 1X = 0, 7Z = 90, 13X = 180, 19Z = 270, 4X = 45, 10Z = 135 }"
    found = campaign(tmp_path, quarter(), 'axes = ["X", "Z"]', angles)
    np.testing.assert_allclose(by_angle(found.frf), RADIAL[[0, 6, 12, 18]], atol=1e-9)


def recordings_of_two_axes():
    """Radial and tangential motion, the force, and a file of X and Z at each node."""
    noise = np.random.default_rng(1)
    n, force = 400, noise.normal(size=400)
    radial, tangential = noise.normal(size=(2, POSITIONS, n))
    parts = [
        binary58(
            floats(-force, double=True),
            ordinate=4,
            n=n,
            name="force",
            node=7,
            direction=-Z,
            axis=(13, 0, 0, "Force", "N"),
        )
    ]  # at 90 degrees, inwards
    for k, (c, s) in enumerate(zip(COS[:, 0], SIN[:, 0], strict=True)):
        for code, x in (
            (X, radial[k] * c - tangential[k] * s),
            (Z, radial[k] * s + tangential[k] * c),
        ):
            values = floats(x, double=True)
            parts.append(
                binary58(
                    values,
                    ordinate=4,
                    n=n,
                    name=f"{k + 1}{'?XYZ'[code]}",
                    node=k + 1,
                    direction=code,
                )
            )
    return radial, tangential, force, b"".join(parts) + circle()


def test_channels_along_two_axes_become_radial_and_tangential(tmp_path):
    radial, tangential, force, content = recordings_of_two_axes()
    n = len(force)
    found = campaign(tmp_path, content, 'axes = ["X", "Z"]')
    (run,), (sideways,) = found.runs, found.others
    for responses, expected in ((run.responses, radial), (sideways.runs[0].responses, tangential)):
        assert len(responses) == POSITIONS
        for each in responses:
            k = round(each.position_deg / 15) % POSITIONS
            np.testing.assert_allclose(each.channel.block(0, n), expected[k], atol=1e-12)
    assert sideways.direction == Direction.TANGENTIAL
    np.testing.assert_allclose(run.force.block(0, n), force)


def test_channels_of_a_triaxial_sensor_weigh_once(tmp_path):
    content = recordings_of_two_axes()[-1]
    own = "[sensors]\nmass_kg = { default = 0.004, 3X = 0.010, 3Z = 0.010 }"
    (run,) = (found := campaign(tmp_path, content, f'axes = ["X", "Z"]\n{own}')).runs
    masses = {each.node: found.mass_of(each.name) for each in run.sensors}
    assert masses == {node: 0.010 if node == 3 else 0.004 for node in range(1, POSITIONS + 1)}
    with pytest.raises(ManifestError, match="3X, 3Z of different"):
        campaign(tmp_path, content, f'axes = ["X", "Z"]\n{own.replace("3Z = 0.010", "3Z = 0")}')
