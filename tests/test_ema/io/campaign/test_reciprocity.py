"""Roving force: one sensor that stays, and a force that moves from run to run."""

import numpy as np
from builders import force58, frf58, response58

import ema
from ema.core.finding import Check, Verdict

HEAD = """schema = 1
[grid]
positions = 8
[excitation]
channel = "force"
position_deg = 0.0
[sensors]
mass_kg = 0.004
"""
ANGLES = (0.0, 45.0, 90.0)


def written(folder, sensors_deg, force_node=lambda k: 0, sensors=("A01",)):
    for k in range(len(ANGLES)):
        channels = [response58(name=name, node=n) for n, name in enumerate(sensors, 7)]
        force = force58(node=force_node(k)) + b"\n" * k  # no two files alike
        (folder / f"hit_{k}.uff").write_bytes(force + b"".join(channels))
    if sensors_deg:
        runs = [
            f'[[runs]]\nfile = "hit_{k}.uff"\n'
            f"positions_deg = {{ force = {angle}, {sensors_deg} }}\n"
            for k, angle in enumerate(ANGLES)
        ]
        (folder / "campaign.toml").write_text(HEAD + "".join(runs))
    return folder


def places(campaign):
    return [(run.responses[0].node, run.responses[0].position_deg) for run in campaign.runs]


def roving(campaign):
    found = [each.verdict for each in campaign.findings if each.check == Check.RECIPROCITY]
    return found == [Verdict.OK]


def test_angles_of_force_and_sensor_are_exchanged(tmp_path):
    campaign = ema.read_campaign(written(tmp_path, "A01 = 135.0"))
    assert places(campaign) == [(0, 0.0), (1, 45.0), (2, 90.0)]
    assert campaign.excitation_deg == 135.0
    assert (campaign.sensor_mass_kg, campaign.live_mass_kg) == (None, 0.004)
    assert roving(campaign)


def test_so_are_the_nodes_of_universal_files(tmp_path):
    campaign = ema.read_campaign(written(tmp_path, "", force_node=lambda k: k + 1))
    assert places(campaign) == [(1, None), (2, None), (3, None)]
    assert roving(campaign)


def test_a_force_that_stays_is_none(tmp_path):
    campaign = ema.read_campaign(written(tmp_path, "", force_node=lambda k: 1))
    assert places(campaign) == [(7, None)] * 3
    assert not roving(campaign)


def test_several_sensors_are_references_and_one_of_them_will_do(tmp_path):
    sensors = "A01 = 0.0, A02 = 45.0"
    campaign = ema.read_campaign(written(tmp_path, sensors, sensors=("A01", "A02")))
    assert [run.forces[0].position_deg for run in campaign.runs] == [0.0] * 3 + [45.0] * 3
    assert places(campaign) == [(0, 0.0), (1, 45.0), (2, 90.0)] * 2
    campaign = ema.read_campaign(written(tmp_path, "A02 = 45.0", sensors=("A01", "A02")))
    assert campaign.excitation_deg == 45.0


def test_frfs_of_a_roving_force_in_files_of_their_own(tmp_path):
    values = np.arange(1.0, 9.0) + 1j
    for k in (1, 2, 3):
        (tmp_path / f"{k}.uff").write_bytes(frf58(k * values, node=5, reference_node=k))
    campaign = ema.read_campaign(tmp_path)
    assert campaign.frf.node.tolist() == [1, 2, 3]
    assert roving(campaign)
