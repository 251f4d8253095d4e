"""Forces at several places: campaigns and files give FRFs of each, or say what is missing."""

import numpy as np
import pytest
from builders import force58, frf58, response58

import ema
from ema.core.errors import InputError
from ema.core.finding import Check
from ema.core.frf import FRF
from ema.core.references import References
from ema.io.uff.write import write_frfs

HEAD = """schema = 1
[grid]
positions = 8
"""
TWO = (
    HEAD
    + """
[[excitation]]
channel = "F1"
position_deg = 0.0
[[excitation]]
channel = "F2"
position_deg = 45.0
"""
)
VALUES = np.arange(1.0, 9.0) + 1j


def recording(path, forces, sensors, extra=b""):
    channels = [force58(name=name) for name in forces]
    channels += [response58(name=name, node=node) for name, node in sensors.items()]
    path.write_bytes(b"".join(channels) + extra)


def campaign_of(folder, text):
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    return ema.read_campaign(folder)


def angles(campaign):
    return [[force.position_deg for force in run.forces] for run in campaign.runs]


def test_a_force_that_moves_from_run_to_run(tmp_path):
    for name, node in (("a", 1), ("b", 2)):
        recording(tmp_path / f"{name}.uff", ["force"], {"A01": node})
    text = HEAD + '[excitation]\nposition_deg = 10.0\n[[runs]]\nfile = "a.uff"\n'
    text += '[[runs]]\nfile = "b.uff"\nexcitation = { position_deg = 370.0 }\n'
    campaign = campaign_of(tmp_path, text)
    assert angles(campaign) == [[10.0], [10.0]]
    assert len({run.references for run in campaign.runs}) == 1
    moved = campaign_of(tmp_path, text.replace("370.0", "23.0"))
    assert angles(moved) == [[10.0], [23.0]]
    assert moved.excitation_deg == 10.0


def test_several_forces_by_the_channels_that_a_run_has(tmp_path):
    for name, node, forces in (("a", 1, ["F1"]), ("b", 2, ["F2"])):
        recording(tmp_path / f"{name}.uff", forces, {"A01": node})
    runs = '[[runs]]\nfile = "a.uff"\n[[runs]]\nfile = "b.uff"\n'
    assert angles(campaign_of(tmp_path, TWO + runs)) == [[0.0], [45.0]]
    recording(tmp_path / "a.uff", ["F1", "F2"], {"A01": 1})
    recording(tmp_path / "b.uff", ["F1", "F2"], {"A01": 2})
    assert angles(campaign_of(tmp_path, TWO + runs)) == [[0.0, 45.0]] * 2
    chosen = runs + 'excitation = { channel = "F2" }\n'
    with pytest.raises(InputError, match="2 forces at once"):
        campaign_of(tmp_path, TWO + chosen)
    listed = HEAD + '[excitation]\nchannel = "F1"\nposition_deg = 0.0\n'
    own = 'excitation = [{ channel = "F1" , position_deg = 0.0 }, '
    own += '{ channel = "F2", position_deg = 45.0 }]\n'
    listed += f'[[runs]]\nfile = "a.uff"\n{own}[[runs]]\nfile = "b.uff"\n{own}'
    assert angles(campaign_of(tmp_path, listed)) == [[0.0, 45.0]] * 2


@pytest.mark.parametrize(
    "fault",
    [
        '[[excitation]]\nchannel = "F1"\n[[excitation]]\nchannel = "F1"\n',
        '[[excitation]]\nchannel = "F1"\n[[excitation]]\nposition_deg = 9.0\n',
        '[[excitation]]\nchannel = "F1"\n[[excitation]]\nchannel = "F2"\n',  # places unknown
        '[[excitation]]\nchannel = "F8"\n[[excitation]]\nchannel = "F9"\n',
    ],
)
def test_what_leaves_open_where_forces_act_is_refused(tmp_path, fault):
    recording(tmp_path / "a.uff", ["F1", "F2"], {"A01": 1})
    with pytest.raises(InputError):
        campaign_of(tmp_path, HEAD + fault + '[[runs]]\nfile = "a.uff"\n')


def test_several_references_in_one_file(tmp_path):
    rows = [(response, force) for force in (1, 4) for response in (1, 2, 3)]
    content = b"".join(
        frf58((10 * force + response) * VALUES, node=response, reference_node=force)
        for response, force in rows
    )
    (tmp_path / "a.uff").write_bytes(content)
    frfs = ema.read_campaign(tmp_path).frf
    assert [frf.force_node for frf in frfs] == [1, 4]
    assert [frf.force_axis for frf in frfs] == [3, 3]
    for frf, force in zip(frfs, (1, 4), strict=True):
        assert frf.node.tolist() == [1, 2, 3]
        expected = np.outer(10 * force + np.arange(1, 4), VALUES)
        np.testing.assert_allclose(frf.values, expected, rtol=1e-12)
    estimated = ema.estimate_frf(ema.read_campaign(tmp_path))
    assert [frf.force_node for frf in estimated] == [1, 4]


def test_one_file_for_each_reference_on_a_circle(tmp_path):
    for force in (1, 2):
        rows = [frf58(force * VALUES, node=node, reference_node=force) for node in (1, 3, 5)]
        (tmp_path / f"{force}.uff").write_bytes(b"".join(rows))
    runs = '[[runs]]\nfile = "1.uff"\n[[runs]]\nfile = "2.uff"\n'
    campaign = campaign_of(tmp_path, HEAD + runs)
    assert [frf.excitation_deg for frf in campaign.frf] == [45.0, 90.0]
    stated = campaign_of(tmp_path, HEAD + runs + "excitation = { position_deg = 13.0 }\n")
    assert [frf.excitation_deg for frf in stated.frf] == [45.0, 13.0]
    usual = campaign_of(tmp_path, HEAD + "[excitation]\nposition_deg = 0.0\n" + runs)
    assert [frf.excitation_deg for frf in usual.frf] == [45.0, 90.0]
    assert Check.EXCITATION in {each.check for each in usual.findings}


def test_a_roving_hammer_and_several_sensors_by_reciprocity(tmp_path):
    rows = [(response, force) for force in (1, 2, 3, 4) for response in (7, 8)]
    content = b"".join(
        frf58((10 * force + response) * VALUES, node=response, reference_node=force)
        for response, force in rows
    )
    (tmp_path / "a.uff").write_bytes(content)
    campaign = ema.read_campaign(tmp_path)
    assert [frf.force_node for frf in campaign.frf] == [7, 8]
    for frf, sensor in zip(campaign.frf, (7, 8), strict=True):
        assert frf.node.tolist() == [1, 2, 3, 4]
        expected = np.outer(10 * np.arange(1, 5) + sensor, VALUES)
        np.testing.assert_allclose(frf.values, expected, rtol=1e-12)
    assert Check.RECIPROCITY in {each.check for each in campaign.findings}


def test_so_of_recordings(tmp_path):
    for k in (1, 2, 3):
        channels = [response58(name=name, node=n) for name, n in (("A", 7), ("B", 8))]
        content = force58(node=k) + b"\n" * k + b"".join(channels)
        (tmp_path / f"hit_{k}.uff").write_bytes(content)
    campaign = ema.read_campaign(tmp_path)
    seen = [(run.forces[0].node, run.responses[0].node) for run in campaign.runs]
    assert seen == [(7, 1), (7, 2), (7, 3), (8, 1), (8, 2), (8, 3)]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([(1, 1), (2, 2)], "without a point in common"),
        ([(1, 1), (2, 1), (1, 2), (1, 0), (2, 0)], "a force anywhere"),
    ],
)
def test_references_that_belong_to_nothing_are_refused(tmp_path, rows, message):
    content = b"".join(frf58(VALUES, node=node, reference_node=force) for node, force in rows)
    (tmp_path / "a.uff").write_bytes(content)
    with pytest.raises(InputError, match=message):
        ema.read_campaign(tmp_path)


def test_a_tangential_force_on_a_circle_is_no_second_reference(tmp_path):
    rows = [
        frf58(VALUES, node=node, direction=axis, reference_node=1, reference_direction=axis)
        for axis in (1, 3)
        for node in (1, 2, 3)
    ]
    (tmp_path / "a.uff").write_bytes(b"".join(rows))
    with pytest.raises(InputError, match="several directions"):
        campaign_of(tmp_path, HEAD + '[[runs]]\nfile = "a.uff"\n')
    (tmp_path / "campaign.toml").unlink()
    assert [frf.force_axis for frf in ema.read_campaign(tmp_path).frf] == [1, 3]


@pytest.mark.parametrize("binary", [True, False])
def test_what_is_written_is_read_back_with_its_forces(tmp_path, binary):
    random = np.random.default_rng(1)
    positions = np.arange(0.0, 360.0, 45.0)
    frfs = References(
        tuple(
            FRF.from_arrays(
                np.arange(64.0),
                random.normal(size=(8, 64)) + 1j * random.normal(size=(8, 64)),
                angles_deg=positions,
                nodes=np.arange(8),
                excitation_deg=angle,
            )
            for angle in (0.0, 45.0, 13.0)
        )
    )
    write_frfs(tmp_path / "frf.uff", frfs, binary=binary)
    campaign = campaign_of(tmp_path, HEAD + '[[runs]]\nfile = "frf.uff"\n')
    assert [frf.excitation_deg for frf in campaign.frf] == [0.0, 45.0, 13.0]
    for read, written in zip(ema.estimate_frf(campaign), frfs, strict=True):
        np.testing.assert_allclose(read.values, written.values, rtol=1e-12)
        np.testing.assert_array_equal(read.position_deg, positions)
    (tmp_path / "campaign.toml").unlink()
    assert [frf.force_node for frf in ema.read_campaign(tmp_path).frf] == [8, 1, 101300]
