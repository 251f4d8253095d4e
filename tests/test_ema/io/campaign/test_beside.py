"""Geometry and coherence in files of their own, beside recordings and FRFs."""

import numpy as np
import pytest
from builders import DELIMITER, floats, force58, frf58, header58, nodes15, nodes2411, response58

import ema
from ema.core.finding import Check
from ema.io.uff.reader import OF_A_RESULT
from ema.io.uff.write import write_frfs

N = 64
NODES = (1, 2, 3, 4)
XYZ = {1: (0.3, 0.0, 0.0), 2: (0.0, 0.3, 0.0), 3: (-0.3, 0.0, 0.0), 4: (0.0, -0.3, 0.0)}
MANIFEST = "schema = 1\n[grid]\npositions = 4\n[excitation]\nposition_deg = 0.0\n"


def frfs():
    """Causal FRFs of one resonance."""
    omega = 2 * np.pi * np.arange(N)
    values = -(omega**2) / (2e4 - omega**2 + 6j * omega)
    return b"".join(frf58(values * node, node=node) for node in NODES)


def coherence58(values, node):
    """A coherence in double precision, as real numbers."""
    header = header58(
        name="A",
        function_type=6,
        ordinate=4,
        n=len(values),
        step="  1.00000E+00",
        node=node,
        abscissa=(18, 0, 0, "Frequency", "Hz"),
        axis=(0, 0, 0, "NONE", "NONE"),
        reference_node=1,
        reference_direction=3,
        binary=(1, 8 * len(values)),
    )
    return header + floats(values, double=True) + f"{DELIMITER}\n".encode()


def written(folder, **files):
    for name, content in files.items():
        (folder / f"{name}.uff").write_bytes(content)
    return folder


def angle_by_size(frf):
    """Angles of nodes 1 to 4, whose FRFs grow with their numbers."""
    return frf.position_deg[np.argsort(np.abs(frf.values).max(axis=1))]


def joined(campaign):
    return {each.run: each.detail for each in campaign.findings if "joined" in each.detail}


def test_coherences_go_to_the_frfs_of_their_nodes(tmp_path):
    known = np.linspace(0.5, 1.0, N)
    coherences = coherence58(known, 2) + coherence58(0.5 * known, 4)
    campaign = ema.read_campaign(written(tmp_path, data=frfs(), coherence=coherences))
    found = dict(zip(campaign.frf.node.tolist(), campaign.frf.coherence, strict=True))
    np.testing.assert_allclose(found[2], known)
    np.testing.assert_allclose(found[4], 0.5 * known)
    assert np.isnan(found[1]).all()
    assert joined(campaign) == {"coherence.uff": "coherence joined to 1 file"}


def test_coherences_on_other_lines_are_left_out_and_named(tmp_path):
    files = {"data": frfs(), "coherence": coherence58(np.ones(N // 2), 2)}
    campaign = ema.read_campaign(written(tmp_path, **files))
    assert np.isnan(campaign.frf.coherence).all()
    left = [each for each in campaign.findings if each.run == "coherence.uff"]
    assert [each.check for each in left] == [Check.CONTENT]
    assert not left[0].is_ok


@pytest.mark.parametrize("dataset", [nodes15, nodes2411])
def test_geometry_gives_the_angles_of_recordings(tmp_path, dataset):
    samples = b"".join(response58(n=N, name=f"A{node}", node=node) for node in NODES)
    files = {"run": force58(n=N) + samples, "geometry": dataset(XYZ)}
    written(tmp_path, **files)
    runs = '[[runs]]\nfile = "run.uff"\n[[runs]]\nfile = "geometry.uff"\n'
    (tmp_path / "campaign.toml").write_text(MANIFEST + runs)
    campaign = ema.read_campaign(tmp_path)
    angles = [each.position_deg for each in campaign.runs[0].responses]
    assert angles == pytest.approx([0.0, 90.0, 180.0, 270.0])
    assert len(campaign.runs) == 1
    assert "geometry.uff" in joined(campaign)


def test_geometry_gives_the_angles_of_frfs(tmp_path):
    written(tmp_path, data=frfs(), geometry=nodes15(XYZ))
    runs = '[[runs]]\nfile = "data.uff"\n[[runs]]\nfile = "geometry.uff"\n'
    (tmp_path / "campaign.toml").write_text(MANIFEST + runs)
    frf = ema.read_campaign(tmp_path).frf
    assert angle_by_size(frf) == pytest.approx([0.0, 90.0, 180.0, 270.0])


def test_a_file_keeps_its_own_geometry(tmp_path):
    turned = {node: (-x, -y, z) for node, (x, y, z) in XYZ.items()}
    written(tmp_path, data=nodes15(turned) + frfs(), geometry=nodes15(XYZ))
    runs = '[[runs]]\nfile = "data.uff"\n'
    (tmp_path / "campaign.toml").write_text(MANIFEST + runs)
    frf = ema.read_campaign(tmp_path).frf
    assert angle_by_size(frf) == pytest.approx([180.0, 270.0, 0.0, 90.0])


@pytest.mark.parametrize(
    "table",
    [
        "mode,order,frequency_hz\n1,1,78.7\n2,2,100.3\n",
        "Remark\nTyre changed after run 2\n",
        "Time [s],Temperature [degC]\n0,21.5\n60,21.7\n120,21.9\n",
    ],
)
def test_a_stray_table_is_set_aside_and_named(tmp_path, table):
    samples = b"".join(response58(n=4 * N, name=f"A{node}", node=node) for node in NODES)
    written(tmp_path, run=force58(n=4 * N) + samples)
    (tmp_path / "notes.csv").write_text(table)
    campaign = ema.read_campaign(tmp_path)
    assert [run.name for run in campaign.runs] == ["run.uff"]
    (named,) = [each for each in campaign.findings if each.run == "notes.csv"]
    assert not named.is_ok


def test_a_small_recording_is_not_set_aside(tmp_path):
    samples = b"".join(response58(n=64 * N, name=f"A{node}", node=node) for node in NODES)
    written(tmp_path, run=force58(n=64 * N) + samples)
    rows = "".join(f"{k / 2000:.4f},1,{k % 7}\n" for k in range(200))
    (tmp_path / "short.csv").write_text("Time [s],force [N],A1 [m/s^2]\n" + rows)
    campaign = ema.read_campaign(tmp_path)
    assert len(campaign.runs) == 2


@pytest.mark.parametrize("mark", [OF_A_RESULT, "measured; direction 1 is radial, outward"])
def test_frfs_of_a_result_beside_recordings_are_set_aside_and_named(tmp_path, mark):
    samples = b"".join(response58(n=N, name=f"A{node}", node=node) for node in NODES)
    written(tmp_path, run=force58(n=N) + samples, own=frfs())
    made = ema.read_campaign(tmp_path / "own.uff").frf
    write_frfs(tmp_path / "own.uff", made, note=mark)
    campaign = ema.read_campaign(tmp_path)
    assert [run.name for run in campaign.runs] == ["run.uff"]
    (named,) = [each for each in campaign.findings if each.run == "own.uff"]
    assert not named.is_ok
    alone = ema.read_campaign(tmp_path / "own.uff")
    np.testing.assert_array_equal(alone.frf.values, made.values)
    assert Check.CONTENT in {each.check for each in alone.findings}


def test_frfs_of_rotations_are_left_out(tmp_path):
    omega = 2 * np.pi * np.arange(N)
    values = -(omega**2) / (2e4 - omega**2 + 6j * omega)
    turning = frf58(values, node=1, direction=-5)
    campaign = ema.read_campaign(written(tmp_path, data=frfs() + turning))
    assert len(campaign.frf.values) == len(NODES)
    assert Check.DIRECTION in {each.check for each in campaign.findings if not each.is_ok}
