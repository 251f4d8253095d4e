"""A channel that loses samples slips against the force; a tyre that drifts does not."""

import numpy as np
import pytest
import recordings as rec
import systems

import ema
from ema.core.errors import InputError
from ema.core.finding import Check, Verdict
from ema.identify import identify_modes
from pipelines.simulate.laboratory import Laboratory
from pipelines.simulate.laboratory_effects import Effects

BLOCKS = {"block_seconds": 1.0}


def estimated(*runs, **processing):
    return ema.estimate_frf(systems.campaign_of(*runs, **(processing or BLOCKS)))


def slips(frf):
    return [(finding.run, finding.channel, finding.check) for finding in frf.findings]


@pytest.mark.parametrize("n", [1, 2, 37])
@pytest.mark.parametrize("start", [4000, 9300, 12_000])
@pytest.mark.parametrize("name", ["A03", "REF"])
def test_a_channel_that_lost_samples_is_named_and_left_out_from_there_on(name, start, n):
    run = rec.healthy()
    frf = estimated(rec.edited(run, rec.lost(start, n), [name]))
    assert slips(frf) == [("run_1.uff", name, Check.LOST_SAMPLES)]
    (finding,) = frf.findings
    assert finding.verdict == Verdict.WARNING
    if name != "REF":
        share = 1 - start / rec.N
        assert share - 0.03 < frf.missing[2] < share + 0.25
        assert frf.missing[[0, 1, 3]].max() == 0


def test_what_is_left_of_the_channel_is_right():
    run = rec.healthy()
    frf = estimated(rec.edited(run, rec.lost(12_000), ["A03"]))
    whole = estimated(run)
    band = (whole.frequency_hz > 20) & (whole.frequency_hz < 400)
    error = np.abs(frf.values - whole.values)[2, band] / whole.std[2, band]
    assert np.sqrt(np.mean(error**2)) < 2


def test_a_slip_early_in_the_run_costs_the_whole_channel():
    frf = estimated(rec.edited(rec.healthy(), rec.lost(1000), ["A03"]))
    assert slips(frf) == [("run_1.uff", "A03", Check.LOST_SAMPLES)]
    np.testing.assert_allclose(frf.missing, [0, 0, 1, 0], atol=1e-12)


def test_a_force_that_lost_samples_is_blamed_itself():
    frf = estimated(rec.edited(rec.healthy(), rec.lost(9000), ["force"]))
    assert slips(frf) == [("run_1.uff", "force", Check.LOST_SAMPLES)]
    assert np.all(frf.missing > 0.4)


def test_of_two_channels_nobody_knows_which_one_slipped():
    force = rec.shaker_noise()
    motion = rec.lost(9000)(rec.answers(force)[0])
    frf = estimated(systems.run_of(force, motion[None], rec.RATE_HZ))
    assert slips(frf) == [("run_1.uff", "", Check.LOST_SAMPLES)]


def test_other_runs_are_not_touched():
    runs = [rec.healthy(seed, name=f"run_{seed}.uff") for seed in (1, 2, 3)]
    runs[1] = rec.edited(runs[1], rec.lost(8000), ["A01"])
    assert slips(estimated(*runs)) == [("run_2.uff", "A01", Check.LOST_SAMPLES)]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("noise", [0.02, 0.3, 1.0])
def test_noise_is_no_slip(seed, noise):
    force = rec.shaker_noise(seed=seed)
    assert estimated(rec.run(force, rec.answers(force, seed + 50, noise))).findings == ()


@pytest.mark.parametrize("percent", [0.2, 1.0, 3.0])
def test_a_tyre_that_warms_up_during_the_run_is_no_slip(percent):
    force = rec.shaker_noise()
    share = np.linspace(0, 1, rec.N)
    cold = systems.responses_to(force - 50, rec.RATE_HZ, rec.POLES, rec.RESIDUES)
    warm = systems.responses_to(
        force - 50, rec.RATE_HZ, rec.POLES * (1 - percent / 100), rec.RESIDUES
    )
    motion = (1 - share) * cold + share * warm
    motion += 0.02 * motion.std() * systems.white(rec.N, 3, rec.N_SENSORS)
    assert estimated(rec.run(force, motion)).findings == ()


@pytest.mark.parametrize("seed", [4, 6])
def test_a_tyre_that_is_softer_at_harder_hits_is_no_slip(seed):
    """At 4 kHz its phase at the resonances passes for a sample or two."""
    hits = Effects(
        seed=seed, sensors=8, runs=1, duration_s=20.0, sampling_rate_hz=4096.0, excitation="hammer",
        hits=6, softening=0.01, splice=0.01, stiffness_variation=0.01, snr_db=26.0,
    )  # fmt: skip
    assert ema.estimate_frf(Laboratory(hits).campaign()).findings == ()


@pytest.mark.parametrize("window", ["hann", "boxcar"])
@pytest.mark.parametrize("block_seconds", [0.1, 0.5, 2.0, 8.0, 16.0])
def test_any_blocks_find_a_healthy_run_healthy(block_seconds, window):
    assert estimated(rec.healthy(), block_seconds=block_seconds, window=window).findings == ()


def test_a_sensor_that_sees_nothing_does_not_slip():
    silent = rec.edited(
        rec.healthy(), lambda samples: systems.white(rec.N, 7).astype(np.float32), ["A02"]
    )
    assert estimated(silent).findings == ()


def test_a_force_that_slips_early_is_refused():
    run = rec.edited(rec.healthy(), rec.lost(1500), ["force"])
    with pytest.raises(InputError, match=r"run_1.uff, channel 'force'") as caught:
        estimated(run)
    assert caught.value.remedy


DAMAGES = {
    "stuck force": (rec.held(6000, 2000), ["force"]),
    "stuck sensor": (rec.held(6000, 500), ["A02"]),
    "repeated": (rec.copied(2000, 2000, 9000), None),
    "doubled": (rec.doubled(7000, 200), None),
    "lost": (rec.lost(9000), ["A02"]),
}


@pytest.mark.parametrize("kind", DAMAGES)
def test_modes_stay_within_their_standard_deviations(kind):
    change, names = DAMAGES[kind]
    frf = estimated(rec.edited(rec.healthy(), change, names))
    modes = identify_modes(frf, (40.0, 200.0), max_order=20).model.modes
    assert frf.findings
    for pole in rec.POLES:
        true_hz, damping = abs(pole) / 2 / np.pi, -pole.real / abs(pole)
        mode = min(modes, key=lambda each: abs(each.frequency_hz - true_hz))
        assert abs(mode.frequency_hz - true_hz) < 3.5 * mode.frequency_std_hz < 0.3
        assert abs(mode.damping_ratio - damping) < 3.5 * mode.damping_std < 0.004
