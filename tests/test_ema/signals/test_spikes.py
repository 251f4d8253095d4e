"""Samples that no sensor gave: flipped bits cost averages, not modes; impacts are no damage."""

from dataclasses import replace

import numpy as np
import pytest
import systems

import ema
from ema.core.finding import Check, Verdict
from ema.core.recording import ACCELERATION, FORCE, VOLTAGE, Channel, Recording
from ema.signals.signal_checks import summarise
from ema.signals.spikes_and_gaps import spike_findings, with_limits

RATE_HZ = 2000.0
N_SAMPLES = 40 * 2000
RAW_HZ, DAMPING = np.array([60.0, 140.0]), np.array([0.02, 0.02])
EXPONENT_BITS = range(52, 63)


def signals(force):
    poles = systems.pole(RAW_HZ, DAMPING)
    residues = np.outer([1.0, -1.0, 0.5, 0.8], systems.residue(poles))
    return systems.responses_to(force, RATE_HZ, poles, residues)


@pytest.fixture(scope="module")
def shaken():
    force = systems.white(N_SAMPLES, 1)
    motion = signals(force)
    return force, motion + 0.05 * motion.std() * systems.white(N_SAMPLES, 2, 4)


def limited(force, motion):
    run = systems.run_of(force, motion, RATE_HZ)
    recording = with_limits(run.recording)
    load_cell, *sensors = recording.channels
    responses = [
        replace(each, channel=channel) for each, channel in zip(run.responses, sensors, strict=True)
    ]
    return replace(run, recording=recording, force=load_cell, responses=tuple(responses))


def with_flipped_bit(signal, at, bit):
    damaged = signal.copy()
    damaged[at : at + 1].view(np.uint64)[0] ^= np.uint64(1 << bit)
    return damaged


def n_impossible(run):
    return [summarise(channel).n_impossible for channel in run.channels]


@pytest.mark.parametrize("bit", EXPONENT_BITS)
@pytest.mark.parametrize("row", [0, 2])
def test_one_flipped_bit_leaves_the_modes_right(shaken, row, bit):
    force, motion = shaken
    rows = [force, *motion]
    at = 41_000 + int(np.argmax(np.abs(rows[row][41_000:42_000])))
    rows[row] = with_flipped_bit(rows[row], at, bit)
    run = limited(rows[0], np.array(rows[1:]))
    frf = ema.estimate_frf(systems.campaign_of(run))
    model = ema.fit_modes(frf, ema.select_poles(ema.build_stability(frf, (20.0, 200.0))))
    np.testing.assert_allclose([m.frequency_hz for m in model.modes], RAW_HZ, rtol=2e-3)
    np.testing.assert_allclose([m.damping_ratio for m in model.modes], DAMPING, rtol=0.1)


@pytest.mark.parametrize("value", [1e12, -1e12, 1e77, 1.7e308])
def test_where_and_how_many_is_said(shaken, value):
    force, motion = shaken
    motion = motion.copy()
    motion[1, [7000, 50_000]] = value
    run = limited(force, motion)
    assert n_impossible(run) == [0, 0, 2, 0, 0]
    found = summarise(run.channels[2])
    assert (found.first_impossible, found.n_missing) == (7000, 2)
    assert found.worst_impossible == abs(value)
    (finding,) = spike_findings("run_1", run.channels)
    assert (finding.run, finding.channel) == ("run_1", "A02")
    assert (finding.check, finding.verdict) == (Check.IMPOSSIBLE_SAMPLES, Verdict.WARNING)


def impact(kind):
    """Hits of a hammer, and what the structure answers."""
    force = np.zeros(N_SAMPLES)
    hits = {"one": [4000], "some": [4000, 24_000, 44_000, 64_000]}[kind]
    for hit in hits:
        force[hit] = 1000.0
    return force


@pytest.mark.parametrize("hits", ["one", "some"])
@pytest.mark.parametrize("width", [1, 2, 8])
@pytest.mark.parametrize("bits", [12, 16, 24, 53])
def test_an_impact_is_no_damage(hits, width, bits):
    pulse = np.sin(np.pi * (np.arange(width) + 0.5) / width)
    force = np.convolve(impact(hits), pulse)[:N_SAMPLES]
    motion = signals(force)
    rows = np.array([force, *motion])
    step = np.abs(rows).max(axis=1, keepdims=True) / 2.0 ** (bits - 1)
    noise = 0.1 * step if bits == 12 else 10 * step if bits == 24 else step
    rows = rows + noise * systems.white(N_SAMPLES, 3, 5) * (bits < 53)
    force, *motion = np.round(rows / step) * step
    assert n_impossible(limited(force, np.array(motion))) == [0] * 5


def test_a_flipped_bit_beside_impacts_is_found():
    force = np.convolve(impact("some"), np.hanning(12))[:N_SAMPLES]
    rows = np.array([force, *signals(force)]) + 1e-3 * systems.white(N_SAMPLES, 4, 5)
    rows[0, 30_000] = 1e12
    rows[3, 31_000] = -1e20
    assert n_impossible(limited(rows[0], rows[1:])) == [1, 0, 0, 1, 0]


@pytest.mark.parametrize(("quantity", "expected"), [(ACCELERATION, 1), (FORCE, 1), (VOLTAGE, 0)])
def test_a_trigger_of_one_sample_is_a_voltage(shaken, quantity, expected):
    _, motion = shaken
    pulse = 1e-3 * systems.white(N_SAMPLES, 5)
    pulse[10_000] = 5.0
    channels = [Channel(f"A{row}", ACCELERATION, "m/s^2", each) for row, each in enumerate(motion)]
    channels.append(Channel("X", quantity, "", pulse))
    recording = with_limits(Recording(systems.Path("run.uff"), RATE_HZ, tuple(channels)))
    assert summarise(recording.channels[-1]).n_impossible == expected


def test_healthy_signals_keep_no_limit(shaken):
    run = limited(*shaken)
    assert all(np.isinf(channel.limit) for channel in run.channels)


@pytest.mark.parametrize("at", [0, 1, N_SAMPLES - 1, (1 << 16) - 1, 1 << 16])
def test_ends_and_seams_are_places_like_others(shaken, at):
    force, motion = shaken
    force = force.copy()
    force[at] = 1e9
    run = limited(force, motion)
    assert n_impossible(run) == [1, 0, 0, 0, 0]
    assert summarise(run.force).first_impossible == at


def test_many_of_them_are_a_pattern(shaken):
    """As of a brush that sparks: nothing is left out in silence where so much would go."""
    force, motion = shaken
    motion = motion.copy()
    motion[0, ::8000] = 1000 * motion[0].std()
    assert n_impossible(limited(force, motion)) == [0] * 5
