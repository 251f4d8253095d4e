"""Forces at several places: H1 right to its σ, one after the other and at the same time."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ema
from ema.core.campaign import Campaign, Response, Run
from ema.core.errors import InputError
from ema.core.finding import Verdict
from ema.core.recording import ACCELERATION, FORCE, Channel, Recording
from ema.core.settings import CHECKS

RATE, N, PERIOD = 1000.0, 60_000, 1000
PLACES = (0.0, 45.0)
# FIR filters: responses at 3 places to 2 forces, within a block so that nothing leaks much.
TAPS = np.random.default_rng(7).standard_normal((3, 2, 12)) * 0.7 ** np.arange(12)
NOISE = 0.5


def response_of(forces, taps, random, noise=NOISE):
    clean = sum(np.convolve(force, each)[:N] for force, each in zip(forces, taps, strict=True))
    return clean + noise * random.standard_normal(N)


def run_of(name, forces, sensors, places=PLACES):
    names = [f"F{k + 1}" for k in range(len(forces))]
    channels = [Channel(n, FORCE, "N", f) for n, f in zip(names, forces, strict=True)]
    acting = tuple(Response(c, None, p) for c, p in zip(channels, places, strict=True))
    seen = [
        Response(Channel(f"A{k}", ACCELERATION, "m/s^2", samples), None, angle)
        for k, (angle, samples) in enumerate(sensors.items())
    ]
    recording = Recording(Path(name), RATE, (*channels, *(each.channel for each in seen)))
    return Run(name, recording, channels[0], tuple(seen), forces=acting)


def joint_campaign(mix=0.0, seed=1, noise=NOISE, runs=2):
    """Two runs; the second force is a share of the first one where `mix` is not 0."""
    found = []
    for number in range(runs):
        random = np.random.default_rng([seed, number])
        first, second = random.standard_normal((2, N))
        second = np.sqrt(1 - mix**2) * second + mix * first
        sensors = {
            90.0 * k: response_of((first, second), TAPS[k], random, noise)
            for k in ((0, 1), (1, 2))[number]
        }
        found.append(run_of(f"run {number}", (first, second), sensors))
    return Campaign("joint", tuple(found), positions=8, excitation_deg=0.0)


def truth(taps, lines_hz):
    omega = 2 * np.pi * lines_hz / RATE
    return taps @ np.exp(-1j * np.outer(np.arange(taps.shape[-1]), omega))


def scatter(frfs):
    """RMS of real and imaginary error over σ, by force."""
    found = []
    for number, frf in enumerate(frfs):
        error = frf.values - truth(TAPS[:, number], frf.frequency_hz)
        found.append(np.sqrt(np.mean(np.abs(error / frf.std) ** 2) / 2))
    return found


@pytest.mark.parametrize("mix", [0.0, 0.7])
def test_forces_at_the_same_time(mix):
    frfs = ema.estimate_frf(joint_campaign(mix), block_seconds=0.5)
    assert [frf.excitation_deg for frf in frfs] == list(PLACES)
    assert frfs.frfs[0].position_deg.tolist() == [0.0, 90.0, 180.0]
    assert scatter(frfs) == pytest.approx([1.0, 1.0], abs=0.05)


def test_coherences_against_theory():
    """Without the other force's share: partial; with both: multiple."""
    frfs = ema.estimate_frf(joint_campaign(), block_seconds=0.5)
    power = [np.abs(truth(TAPS[:, k], frfs.frequency_hz)) ** 2 for k in range(2)]
    multiple = (power[0] + power[1]) / (power[0] + power[1] + NOISE**2)
    assert np.abs(frfs.multiple_coherence - multiple).mean() < 0.01
    for frf, own in zip(frfs, power, strict=True):
        assert np.abs(frf.coherence - own / (own + NOISE**2)).mean() < 0.02
    # σ, coherence and averages belong together, as for one force.
    frf = frfs.frfs[0].rows([1])  # in both runs
    n = frf.n_effective * 2 + 1
    expected = np.abs(frf.values) ** 2 * (1 - frf.coherence) / frf.coherence / (2 * (n - 1))
    np.testing.assert_allclose(frf.std**2, expected, rtol=0.02)


def test_condition_number_of_known_correlation():
    frfs = ema.estimate_frf(joint_campaign(mix=0.9), block_seconds=0.5)
    assert np.median(frfs.condition) == pytest.approx((1 + 0.9) / (1 - 0.9), rel=0.1)
    doubted = [each.verdict for each in frfs.frfs[0].findings]
    assert doubted == [Verdict.WARNING] * 2
    assert all(each.is_ok for each in ema.estimate_frf(joint_campaign()).frfs[0].findings)


def test_copies_of_one_force_are_refused():
    with pytest.raises(InputError, match="must be independent"):
        ema.estimate_frf(joint_campaign(mix=1.0))
    strict = replace(CHECKS, force_condition_most=5.0)
    with pytest.raises(InputError, match="force_condition_most"):
        ema.estimate_frf(replace(joint_campaign(mix=0.9), checks=strict))
    with pytest.raises(InputError, match="more averages than forces"):
        ema.estimate_frf(joint_campaign(), averages=2, window="boxcar")
    with pytest.raises(InputError, match="H1"):
        ema.estimate_frf(joint_campaign(), estimator="H2")


def test_blocks_with_missing_samples_are_left_out_for_their_sensor():
    campaign = joint_campaign(noise=0.0)
    broken = campaign.runs[0].responses[0].channel.samples
    broken[5000:6000] = np.nan
    frfs = ema.estimate_frf(campaign, block_seconds=0.5)
    assert frfs.frfs[0].missing[0] > 0 == frfs.frfs[0].missing[2]
    for number, frf in enumerate(frfs):
        error = np.abs(frf.values - truth(TAPS[:, number], frf.frequency_hz))
        assert error.max() < 0.05


def test_forces_one_after_the_other_are_as_campaigns_of_their_own():
    runs = []
    for number, place in enumerate(PLACES):
        for part, places in enumerate(((0, 1), (1, 2))):
            random = np.random.default_rng([number, part])
            force = random.standard_normal(N)
            sensors = {
                90.0 * k: response_of((force,), TAPS[k, number : number + 1], random)
                for k in places
            }
            runs.append(run_of(f"{number} {part}", (force,), sensors, (place,)))
    campaign = Campaign("moved", tuple(runs), positions=8, excitation_deg=0.0)
    frfs = ema.estimate_frf(campaign)
    for number, frf in enumerate(frfs):
        alone = replace(campaign, runs=campaign.runs[2 * number : 2 * number + 2])
        alone = replace(alone, excitation_deg=PLACES[number])
        expected = ema.estimate_frf(alone)
        np.testing.assert_array_equal(frf.values, expected.values)
        np.testing.assert_array_equal(frf.std, expected.std)
        assert (frf.excitation_deg, frf.run) == (expected.excitation_deg, expected.run)
        assert frf.forces.keys() == expected.forces.keys()
    assert frfs.condition.size == 0
