"""Recordings that cannot be what was measured are named and left out; healthy ones are not."""

from dataclasses import replace

import numpy as np
import pytest
import recordings as rec
import systems
from scipy.signal import chirp

import ema
from ema.core.errors import InputError
from ema.core.finding import Check, Verdict
from ema.core.recording import ACCELERATION, Channel
from ema.signals.damage import without_damage
from ema.signals.stuck_and_repeated import _look

TIMES_S = np.arange(rec.N) / rec.RATE_HZ


def checked(*runs):
    """Findings as (run, channel, check), and the gaps of each channel of the first run."""
    usable, findings = without_damage(runs)
    assert all(finding.verdict == Verdict.WARNING for finding in findings)
    gaps = {channel.name: channel.gaps for channel in usable[0].channels}
    return [(each.run, each.channel, each.check) for each in findings], gaps


def others_without_gaps(gaps, *names):
    return all(not gap for name, gap in gaps.items() if name not in names)


@pytest.mark.parametrize("value", [None, 0.0, 50.0])
@pytest.mark.parametrize("start", [3000, 8001])
def test_a_force_that_is_stuck_is_named_and_left_out(value, start):
    damaged = rec.edited(rec.healthy(), rec.held(start, 2000, value), ["force"])
    found, gaps = checked(damaged)
    assert found == [("run_1.uff", "force", Check.STUCK)]
    assert gaps["force"] == ((start, start + 2000),)
    assert others_without_gaps(gaps, "force")


@pytest.mark.parametrize("name", ["A02", "REF"])
@pytest.mark.parametrize(("start", "n"), [(5003, 500), (0, 500), (rec.N - 150, 150)])
def test_a_sensor_that_is_stuck_is_left_out_alone(name, start, n):
    damaged = rec.edited(rec.healthy(), rec.held(start, n), [name])
    found, gaps = checked(damaged)
    assert found == [("run_1.uff", name, Check.STUCK)]
    assert gaps[name] == ((start, start + n),)
    assert others_without_gaps(gaps, name)


def test_a_flipped_bit_does_not_hide_that_a_sensor_is_stuck():
    def change(samples):
        samples = rec.held(5003, 500)(samples.astype(float))
        samples[0] = 1e200
        return samples

    found, gaps = checked(rec.edited(rec.healthy(), change, ["A02"]))
    assert ("run_1.uff", "A02", Check.STUCK) in found
    assert (5003, 5503) in gaps["A02"]


def test_the_place_of_a_sensor_goes_with_its_finding():
    _, (finding,) = without_damage([rec.edited(rec.healthy(), rec.held(5000, 500), ["A03"])])
    assert finding.position_deg == 60.0


def test_a_recorder_that_stood_still_is_one_finding():
    found, gaps = checked(rec.edited(rec.healthy(), rec.held(5000, 1000)))
    assert found == [("run_1.uff", "", Check.STUCK)]
    assert all(gap == ((5000, 6000),) for gap in gaps.values())


def test_averages_with_a_stuck_force_do_not_count():
    run = rec.healthy()
    damaged = rec.edited(run, rec.held(4000, 2000), ["force"])
    frf = ema.estimate_frf(systems.campaign_of(damaged, block_seconds=1.0, window="boxcar"))
    blind = rec.edited(run, rec.held(4000, 2000, np.nan), ["force"])
    expected = ema.estimate_frf(systems.campaign_of(blind, block_seconds=1.0, window="boxcar"))
    np.testing.assert_array_equal(frf.values, expected.values)
    np.testing.assert_allclose(frf.missing, 2 / 16, atol=1e-12)
    assert [finding.check for finding in frf.findings] == [Check.STUCK]


@pytest.mark.parametrize(
    ("change", "gap"),
    [
        pytest.param(rec.copied(2000, 2000, 9000), (9000, 11_000), id="2 s written again later"),
        pytest.param(rec.doubled(7000, 200), (7200, 7400), id="0.2 s doubled"),
        pytest.param(rec.doubled(7001, 100), (7101, 7201), id="100 lines doubled"),
        pytest.param(rec.copied(12_000, 2000, 14_000), (14_000, 16_000), id="at the end"),
        pytest.param(rec.doubled(0, 300), (300, 600), id="at the start"),
    ],
)
@pytest.mark.parametrize("bits", [None, 12])
def test_what_repeats_to_the_last_bit_is_left_out(change, gap, bits):
    run = rec.healthy() if bits is None else rec.in_steps(rec.healthy(), bits)
    found, gaps = checked(rec.edited(run, change))
    assert found == [("run_1.uff", "", Check.REPEATED)]
    (only,) = set(gaps.values())
    ((start, stop),) = only
    assert abs(start - gap[0]) <= 3 and abs(stop - gap[1]) <= 3  # steps may agree a little beyond


def test_several_repetitions_are_all_found():
    damaged = rec.edited(rec.edited(rec.healthy(), rec.doubled(3000, 400)), rec.doubled(9000, 250))
    assert checked(damaged)[0] == [("run_1.uff", "", Check.REPEATED)] * 2


def test_a_force_that_repeats_alone_is_left_out_both_times():
    damaged = rec.edited(rec.healthy(), rec.copied(2000, 2000, 9000), ["force"])
    found, gaps = checked(damaged)
    assert found == [("run_1.uff", "force", Check.REPEATED)]
    assert gaps["force"] == ((2000, 4000), (9000, 11_000))
    assert others_without_gaps(gaps, "force")


def test_a_file_appended_to_itself_is_named_and_no_other():
    runs = [rec.healthy(seed, name=f"run_{seed}.uff") for seed in range(1, 7)]
    runs[0] = rec.edited(runs[0], lambda samples: np.tile(samples, 2))
    found, gaps = checked(*runs)
    assert found == [("run_1.uff", "", Check.REPEATED)]
    assert set(gaps.values()) == {((rec.N, 2 * rec.N),)}
    frf = ema.estimate_frf(systems.campaign_of(*runs))
    whole = ema.estimate_frf(systems.campaign_of(rec.healthy(1), *runs[1:]))
    np.testing.assert_allclose(frf.values, whole.values, rtol=1e-9)


@pytest.mark.parametrize(
    ("counts", "gap"),
    [
        pytest.param(np.r_[0:5000, 5007 : rec.N + 7], (5000, 5001), id="gap"),
        pytest.param(np.r_[0:5000, 4900 : rec.N - 100], (5000, 5100), id="back"),
        pytest.param(np.r_[0:5000, 4999 : rec.N - 1], (5000, 5001), id="twice"),
    ],
)
def test_a_counter_that_jumps_is_named_and_its_joint_left_out(counts, gap):
    found, gaps = checked(rec.with_counter(rec.healthy(), counts))
    assert found == [("run_1.uff", "", Check.COUNTER)]
    assert set(gaps.values()) == {(gap,)}


@pytest.mark.parametrize(
    "counts",
    [
        np.arange(rec.N),
        np.arange(rec.N) % 256,
        np.arange(rec.N) * 2 + 7,
        np.arange(rec.N) % 360,  # an angle, not a register
        np.minimum(np.arange(rec.N), 100),
        TIMES_S,
        np.zeros(rec.N),
    ],
)
def test_counters_that_count_and_other_ramps_are_in_order(counts):
    assert checked(rec.with_counter(rec.healthy(), counts))[0] == []


def burst(on=0.5, noise=0.0):
    force = rec.shaker_noise() - 50
    return force * (2 * on > TIMES_S % 2) + noise * systems.white(rec.N, 5)


def hits(noise=0.0, every=2000, first=500):
    force = np.zeros(rec.N)
    for number, start in enumerate(range(first, rec.N - 200, every)):
        start += 37 * number % 100
        force[start : start + 8] = 100 * (1 + 0.1 * (number % 3)) * np.hanning(10)[1:-1]
    return force + noise * systems.white(rec.N, 5)


def equal_hits():
    force = np.zeros(rec.N)
    for start in (300, 6100, 12_500):
        force[start : start + 8] = 100 * np.hanning(10)[1:-1]
    return force


FORCES = {
    "random": rec.shaker_noise(),
    "pseudo-random": np.tile(rec.shaker_noise(2000), 8),
    "pseudo-random, a clock of its own": np.interp(
        np.arange(rec.N) * 0.9997 % 2000, np.arange(2001), np.append(rec.shaker_noise(2000), 50)
    ),
    "two periods": np.tile(rec.shaker_noise(rec.N // 2), 2),
    "repeated sweep": np.tile(10 * chirp(TIMES_S[:4000], 10, 4, 400), 4),
    "sweep": 10 * chirp(TIMES_S, 10, 16, 400),
    "slow sweep from 1 Hz": 10 * chirp(TIMES_S, 1, 16, 200),
    "sweep with pauses": np.tile(10 * chirp(TIMES_S[:2000], 10, 2, 400) * (TIMES_S[:2000] < 1), 8),
    "burst": burst(),
    "one burst": burst() * (TIMES_S < 6),
    "burst with noise": burst(noise=0.01),
    "the same burst": np.tile(burst()[:2000], 8),
    "hammer": hits(),
    "hammer with noise": hits(0.05),
    "one hit": hits(every=rec.N),
    "hits that are equal": equal_hits(),
    "clipped": np.clip(rec.shaker_noise(), 40, 60),
    "a tone": 10 * np.sin(2 * np.pi * 80 * TIMES_S),
}


@pytest.mark.parametrize("bits", [None, 12, 8])
@pytest.mark.parametrize("noise", [0.0, 1e-4, 0.02])
@pytest.mark.parametrize("kind", FORCES)
def test_a_healthy_recording_has_no_finding(kind, noise, bits):
    run = rec.run(FORCES[kind], rec.answers(FORCES[kind], noise=noise))
    run = run if bits is None else rec.in_steps(run, bits, headroom=10)
    frf = ema.estimate_frf(systems.campaign_of(run))
    assert frf.findings == ()


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_runs_of_one_computed_force_are_healthy(noise):
    force = rec.shaker_noise()
    runs = [rec.run(force, rec.answers(force, seed, noise), f"run_{seed}.uff") for seed in (3, 4)]
    assert checked(*runs)[0] == []


@pytest.mark.parametrize("seed", range(5))
def test_a_periodic_force_that_starts_at_rest_is_healthy(seed):
    force = np.tile(rec.shaker_noise(2000, seed) - 50, 8)
    padded = systems.responses_to(
        np.append(force, np.zeros(rec.N)), rec.RATE_HZ, rec.POLES, rec.RESIDUES
    )
    assert checked(rec.run(force, padded[:, : rec.N]))[0] == []


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda samples: np.full_like(samples, 2.5), id="nothing but an offset"),
        pytest.param(lambda samples: np.clip(samples, -samples.std(), samples.std()), id="clipped"),
        pytest.param(lambda samples: np.round(samples / samples.std() / 2), id="three levels"),
        pytest.param(rec.held(4000, 300, np.nan), id="missing"),
        pytest.param(rec.held(4000, 8), id="eight equal samples"),
    ],
)
def test_other_faults_of_a_sensor_are_not_taken_for_these(change):
    assert checked(rec.edited(rec.healthy(), change, ["A02"]))[0] == []


def test_a_run_padded_with_zeros_is_not_stuck():
    run = rec.edited(rec.healthy(), rec.held(15_000, 1000, 0.0))
    assert checked(run)[0] == []


def test_a_single_sensor_can_be_judged_too():
    force = rec.shaker_noise()
    run = systems.run_of(force, rec.answers(force)[:1], rec.RATE_HZ)
    sensor = run.responses[0].channel
    stuck = rec.held(5000, 500, 2 * sensor.samples.std())(sensor.samples.copy())
    broken = replace(sensor, samples=stuck)
    damaged = replace(run, responses=(replace(run.responses[0], channel=broken),))
    assert checked(run)[0] == []
    assert checked(damaged)[0] == [("run_1.uff", "A01", Check.STUCK)]


def test_a_force_stuck_in_every_block_is_refused():
    run = rec.healthy()
    for start in range(1000, rec.N, 2000):
        run = rec.edited(run, rec.held(start, 500), ["force"])
    with pytest.raises(InputError, match=r"run_1.uff, channel 'force'"):
        ema.estimate_frf(systems.campaign_of(run, block_seconds=2.0, window="boxcar"))


@pytest.mark.parametrize("value", [0.1, 0.3, 1e5 / 3])
def test_a_constant_whose_deviation_is_a_rounding_error_is_looked_at(value):
    look = _look(Channel("A01", ACCELERATION, "m/s^2", np.full(10_001, value)), 100)
    assert look.rms < 1e-9 * value


def swept(bits, limit):
    """Share of a swept force of 12 or 16 bits that is seen on its limits, cut off at one or not."""
    force = np.clip(10 * chirp(TIMES_S, 20, TIMES_S[-1], 200), -limit, limit)
    level = 10 / 2 ** (bits - 1)
    built = rec.run(np.round(force / level) * level, rec.answers(force))
    return ema.estimate_frf(systems.campaign_of(built, block_seconds=1.0)).force_clipped.max()


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_the_round_crests_of_a_swept_force_are_not_clipped(bits):
    assert swept(bits, 10.0) == 0.0
    assert swept(bits, 9.8) == pytest.approx(2 / np.pi * np.arccos(0.98), rel=0.3)
