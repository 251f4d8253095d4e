"""Hits and bursts: blocks that start before each, overloads left out, double hits named."""

import numpy as np
import pytest
import recordings
import systems
from recordings import N_SENSORS, POLES, RATE_HZ, RESIDUES, N
from systems import campaign_of, inertance, white

from ema.checks.corrections import screen
from ema.core.finding import Check, Verdict
from ema.core.recording import FORCE, Channel
from ema.signals.events import find_events, is_overloaded
from ema.signals.frf_estimation import estimate_frf

HITS_S = np.array([0.8, 2.9, 4.7, 6.9, 9.1, 10.8, 13.3])
PULSE = np.hanning(9)[1:-1]


def hits(times_s=HITS_S, bounce=()):
    """A hammer; hits named in `bounce` come twice."""
    force = np.zeros(N)
    for number, time_s in enumerate(times_s):
        size = 60 + 40 * np.cos(3 * number)
        for later_s, share in ((0, 1.0), *([(0.03, 0.4)] if number in bounce else [])):
            start = round((time_s + later_s) * RATE_HZ)
            force[start : start + PULSE.size] += share * size * PULSE
    return force


def bursts():
    gate = np.zeros(N)
    for start in (500, 4300, 8600, 12_100):
        gate[start : start + 1500] = 1
    return 10 * gate * white(N, 5)


def hammered(force=None, noise=1e-3, seed=2):
    force = hits() if force is None else force
    return recordings.run(force + 1e-3 * white(N, 9), recordings.answers(force, seed, noise))


def limited(hit, share):
    """A change that cuts a channel at a share of its peak in one hit."""

    def change(samples):
        start = round(HITS_S[hit] * RATE_HZ) - 50
        part = samples[start : start + 1000]
        limit = share * np.abs(part).max()
        np.clip(part, -limit, limit, out=part)
        return samples

    return change


def error(frf, rows=slice(None)):
    truth = inertance(frf.frequency_hz, POLES, RESIDUES[: frf.n_positions])
    band = (frf.frequency_hz > 30) & (frf.frequency_hz < 250)
    size = np.linalg.norm(truth[rows][:, band])
    return np.linalg.norm((frf.values - truth)[rows][:, band]) / size


@pytest.mark.parametrize(
    ("force", "starts_s"),
    [(hits(), HITS_S), (hits(bounce=(2, 5)), HITS_S), (bursts(), [0.5, 4.3, 8.6, 12.1])],
)
def test_hits_and_bursts_are_found_where_they_are(force, starts_s):
    noisy = Channel("force", FORCE, "N", 3 + force + 0.05 * white(N, 8))
    found = find_events(noisy, RATE_HZ)
    np.testing.assert_allclose([each.start / RATE_HZ for each in found], starts_s, atol=0.006)


@pytest.mark.parametrize("force", [recordings.shaker_noise(), np.zeros(N), np.full(N, np.nan)])
def test_a_force_that_goes_on_has_no_events(force):
    assert len(find_events(Channel("force", FORCE, "N", force), RATE_HZ)) < 2


@pytest.mark.parametrize("force", [hits(), hits(bounce=(1, 3)), bursts()])
def test_blocks_start_before_each_event_and_give_a_coherence(force):
    frf = estimate_frf(campaign_of(hammered(force)))
    assert frf.blocks.n_blocks == len(find_events(Channel("", FORCE, "N", force), RATE_HZ))
    assert frf.n_effective == frf.blocks.n_blocks
    assert error(frf) < 0.01
    assert np.median(frf.coherence) > 0.99
    assert not [each for each in frf.findings if not each.is_ok]


def test_blocks_that_are_asked_for_stay():
    frf = estimate_frf(campaign_of(hammered(), averages=4))
    assert not frf.blocks.event_starts


def test_noise_at_the_end_of_blocks_is_no_ringing():
    quiet, noisy = (estimate_frf(campaign_of(hammered(noise=share))) for share in (1e-3, 0.3))
    assert noisy.blocks.n_blocks == quiet.blocks.n_blocks == HITS_S.size


@pytest.mark.parametrize("ratio", [5e-4, 1e-3])
def test_hits_on_what_still_rings_stay_one_block(ratio):
    poles = systems.pole(np.array([62.0, 110.0, 165.0]), np.full(3, ratio))
    motion = systems.responses_to(hits(), RATE_HZ, poles, RESIDUES)
    frf = estimate_frf(campaign_of(recordings.run(hits(), motion)))
    assert frf.blocks.n_blocks == 1
    assert frf.blocks.block_s == N / RATE_HZ


@pytest.mark.parametrize(
    ("channel", "share"), [("force", 0.5), ("force", 0.8), ("A02", 0.4), ("A02", 0.6)]
)
def test_an_overloaded_hit_is_left_out_and_named(channel, share):
    run = recordings.edited(hammered(), limited(3, share), [channel])
    frf = estimate_frf(campaign_of(run))
    (finding,) = [each for each in frf.findings if not each.is_ok]
    assert (finding.run, finding.channel, finding.check) == ("run_1.uff", channel, Check.CLIPPED)
    assert "6.90 s" in finding.detail
    assert frf.blocks.n_blocks == HITS_S.size - 1
    assert error(frf) < 0.01
    usable, findings, _ = screen(frf, (30.0, 250.0))
    assert usable.n_positions == frf.n_positions
    assert findings == []


def test_a_sensor_overloaded_in_most_hits_costs_no_hit():
    run = hammered()
    for hit in range(6):
        run = recordings.edited(run, limited(hit, 0.5), ["A02"])
    assert estimate_frf(campaign_of(run)).blocks.n_blocks == HITS_S.size


@pytest.mark.parametrize("bits", [12, 16])
def test_rounding_is_no_overload(bits):
    motion = recordings.answers(hits(), 2, 1e-3)[0]
    step = 2.5 * np.abs(motion).max() / 2**bits
    assert not is_overloaded(np.round(motion[:2000] / step) * step)
    assert not is_overloaded(np.zeros(100))


def test_double_hits_are_named_with_run_and_time():
    frf = estimate_frf(campaign_of(hammered(hits(bounce=(2, 5)))))
    (finding,) = [each for each in frf.findings if each.check == Check.DOUBLE_HITS]
    assert (finding.run, finding.verdict) == ("run_1.uff", Verdict.OK)
    assert [time in finding.detail for time in ("4.70 s", "10.80 s", "6.90 s")] == [1, 1, 0]


def sweep():
    time = np.arange(N) / RATE_HZ
    return np.sin(2 * np.pi * (10 + 240 / 32 * time) * time) * (time < 15)


@pytest.mark.parametrize("force", [hits(), hits()[:3000], hits(HITS_S[:2]), sweep()])
def test_a_dead_sensor_is_named_whatever_the_force(force):
    def dead(samples):
        return 1e-2 * white(samples.size, 21)

    run = recordings.run(force, recordings.answers(force, 2, 0.05))
    frf = estimate_frf(campaign_of(recordings.edited(run, dead, ["A03"])))
    usable, findings, _ = screen(frf, (30.0, 250.0))
    assert [(each.channel, each.check) for each in findings] == [("A03", Check.INCOHERENT)]
    assert usable.n_positions == N_SENSORS - 2


def test_a_weak_sensor_near_nodes_is_not_incoherent():
    force = hits()[:3000]
    run = recordings.run(force, recordings.answers(force, 2, 0.03))
    weak = recordings.edited(run, lambda samples: 0.1 * samples + 0.1 * white(3000, 4), ["A03"])
    assert screen(estimate_frf(campaign_of(weak)), (30.0, 250.0))[1] == []


@pytest.mark.parametrize("force", [hits(), bursts(), recordings.shaker_noise()])
def test_a_sensor_with_a_loose_cable_is_left_out(force):
    def loose(samples):
        samples[6500:11_500] = 1e-3 * white(5000, 6)
        return samples

    run = recordings.run(force, recordings.answers(force, 2, 0.1))
    assert estimate_frf(campaign_of(run)).findings == ()
    frf = estimate_frf(campaign_of(recordings.edited(run, loose, ["A03"])))
    assert [(each.channel, each.check) for each in frf.findings] == [("A03", Check.DROPOUT)]
    assert screen(frf, (30.0, 250.0))[0].channel == ("A01", "A02", "A04")


def through_a_window(time_constant_s, n=N):
    """A change that multiplies what follows each hit by a window, noise included."""
    since_s = np.arange(N) / RATE_HZ - HITS_S[np.searchsorted(HITS_S, np.arange(N) / RATE_HZ) - 1]
    window = np.exp(-np.where(since_s < 0, 0.0, since_s) / time_constant_s)[:n]
    return lambda samples: samples * window


@pytest.mark.parametrize("n", [N, 2800])
@pytest.mark.parametrize(("applied_s", "named"), [(0.3, False), (1.0, True), (1e9, True)])
def test_a_declared_window_has_to_be_in_the_noise(n, applied_s, named):
    run = recordings.run(hits()[:n], recordings.answers(hits(), 2, 0.02)[:, :n])
    sensors = [f"A{k:02d}" for k in range(1, 5)] + ["REF"]
    run = recordings.edited(run, through_a_window(applied_s, n), sensors)
    frf = estimate_frf(campaign_of(run, exponential_window_s=0.3))
    assert [each.check for each in frf.findings] == [Check.WINDOW] * named


@pytest.mark.parametrize(("applied_s", "named"), [(0.3, True), (1.5, True), (1e9, False)])
def test_a_window_that_was_not_declared_shows_in_the_noise(applied_s, named):
    run = recordings.run(hits(), recordings.answers(hits(), 2, 0.02))
    sensors = [f"A{k:02d}" for k in range(1, 5)] + ["REF"]
    run = recordings.edited(run, through_a_window(applied_s), sensors)
    found = estimate_frf(campaign_of(run)).findings
    assert [each.check for each in found] == [Check.WINDOW] * named
    if named:
        stated = float(found[0].detail.rpartition("= ")[2])
        assert stated == pytest.approx(applied_s, rel=0.15)


def test_a_structure_that_still_rings_shows_no_window():
    force = hits()
    ringing = recordings.answers(force, 2, 1e-4)
    found = estimate_frf(campaign_of(recordings.run(force, ringing))).findings
    assert Check.WINDOW not in [each.check for each in found]
