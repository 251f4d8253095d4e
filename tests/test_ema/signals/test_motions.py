"""Velocities and displacements as responses: the same FRFs and modes as accelerations."""

import numpy as np
import pytest
import recordings

import ema
from ema.core.errors import InputError
from ema.core.finding import Check

LIMITS_HZ = 40.0, 200.0
UNITS = {0: ("m/s^2", 1.0), 1: ("mm/s", 1e3), 2: ("µm", 1e6)}


def integrated(motion, times):
    """Accelerations as seen by a sensor of velocity or displacement, which is blind below 5 Hz."""
    spectrum = np.fft.rfft(motion)
    omega = 2 * np.pi * np.fft.rfftfreq(motion.shape[-1], 1 / recordings.RATE_HZ)
    factor = np.zeros_like(spectrum)
    seen = omega > 10 * np.pi
    factor[..., seen] = (1j * omega[seen]) ** -times
    return np.fft.irfft(spectrum * factor, motion.shape[-1])


def written(path, powers):
    """Force and the motion of each sensor as the derivative that `powers` says."""
    force = recordings.shaker_noise()
    motion = recordings.answers(force)
    names = ["time [s]", "force [N]"]
    columns = [np.arange(force.size) / recordings.RATE_HZ, force]
    for number, (power, own) in enumerate(zip(powers, motion, strict=True), 1):
        unit, scale = UNITS[power]
        names.append(f"A{number} [{unit}]")
        columns.append(scale * integrated(own, power) if power else own)
    np.savetxt(
        path,
        np.column_stack(columns),
        fmt="%.9g",
        delimiter=",",
        header=",".join(names),
        comments="",
        encoding="utf-8",
    )
    return path


@pytest.fixture(scope="module")
def of_accelerations(tmp_path_factory):
    path = written(tmp_path_factory.mktemp("motions") / "run.csv", [0] * 5)
    return ema.estimate_frf(ema.read_campaign(path))


@pytest.mark.parametrize("powers", [[1] * 5, [2] * 5])
def test_frfs_are_inertances(tmp_path, of_accelerations, powers):
    campaign = ema.read_campaign(written(tmp_path / "run.csv", powers))
    frf = ema.estimate_frf(campaign)
    lines = (frf.frequency_hz > LIMITS_HZ[0]) & (frf.frequency_hz < LIMITS_HZ[1])
    expected = of_accelerations.values[:, lines]
    assert np.abs(frf.values[:, lines] - expected).max() < 0.02 * np.abs(expected).max()
    assert np.allclose(frf.std[:, lines], of_accelerations.std[:, lines], rtol=0.3)
    told = [each for each in campaign.findings if each.check == Check.QUANTITY]
    assert len(told) == 5
    assert all(each.is_ok for each in told)
    assert {each.check for each in campaign.findings if not each.is_ok} == {Check.NODE}


def test_modes_agree(tmp_path, of_accelerations):
    frf = ema.estimate_frf(ema.read_campaign(written(tmp_path / "run.csv", [2] * 5)))
    found, known = (ema.identify_modes(each, LIMITS_HZ).model for each in (frf, of_accelerations))
    assert found.frequencies_hz == pytest.approx(known.frequencies_hz, rel=2e-4)
    assert found.damping_ratios == pytest.approx(known.damping_ratios, rel=0.01)


def test_accelerations_come_first_and_the_manifest_takes_all(tmp_path):
    path = written(tmp_path / "run.csv", [0, 0, 0, 0, 1])
    campaign = ema.read_campaign(path)
    assert [each.channel.name for each in campaign.runs[0].responses] == ["A1", "A2", "A3", "A4"]
    ignored = [each.channel for each in campaign.findings if each.check == Check.IGNORED]
    assert "A5" in ignored
    angles = ", ".join(f"A{k} = {30 * k}" for k in range(1, 6))
    manifest = tmp_path / "campaign.toml"
    manifest.write_text(
        "schema = 1\n[grid]\npositions = 12\n"
        f'[[runs]]\nfile = "run.csv"\npositions_deg = {{ {angles} }}\n'
    )
    assert len(ema.read_campaign(manifest).runs[0].responses) == 5


def test_a_channel_that_is_no_motion_is_no_response(tmp_path):
    path = written(tmp_path / "run.csv", [0] * 5)
    path.write_text(path.read_text(encoding="utf-8").replace("A5 [m/s^2]", "A5 [V]"), "utf-8")
    angles = ", ".join(f"A{k} = {30 * k}" for k in range(1, 6))
    manifest = tmp_path / "campaign.toml"
    manifest.write_text(
        "schema = 1\n[grid]\npositions = 12\n"
        f'[[runs]]\nfile = "run.csv"\npositions_deg = {{ {angles} }}\n'
    )
    with pytest.raises(InputError, match="voltage"):
        ema.read_campaign(manifest)
