"""Channels that cannot be used: named with the right verdict, left out, and no harm done."""

from dataclasses import replace

import numpy as np
import pytest
import systems

from ema.checks.corrections import screen
from ema.core.errors import InputError
from ema.core.finding import Verdict
from pipelines.simulate.truth import truth_modes

BAND_HZ = (20.0, 260.0)
ROW = 10


@pytest.fixture(scope="module")
def healthy():
    return systems.campaign_frf(truth_modes(), 30, frequency_hz=np.arange(20, 560) / 2)


def named(findings):
    return [(f.run, f.channel, f.check, f.verdict) for f in findings]


def at(frf, row):
    return frf.run[row], frf.channel[row]


def test_healthy_channels_pass_untouched(healthy):
    usable, findings, _ = screen(healthy, BAND_HZ)
    assert findings == []
    np.testing.assert_array_equal(usable.values, healthy.values)


def test_a_constant_channel_is_dead(healthy):
    frf = systems.edited(healthy, ROW, values=0, coherence=0, std=0)
    usable, findings, _ = screen(frf, BAND_HZ)
    assert named(findings) == [(*at(frf, ROW), "dead", Verdict.EXCLUDED)]
    assert "constant" in findings[0].detail
    assert findings[0].position_deg == 50.0
    assert 50.0 not in usable.position_deg
    assert usable.n_positions == 71


@pytest.mark.parametrize(("level_db", "dead"), [(-80, True), (-55, True), (-45, False)])
def test_a_channel_far_below_the_others_is_dead(healthy, level_db, dead):
    level = 10 ** (level_db / 20) * np.sqrt(np.mean(np.abs(healthy.values) ** 2))
    usable, findings, _ = screen(systems.edited(healthy, ROW, values=level), BAND_HZ)
    assert (usable.n_positions == 71) is dead
    assert [finding.check for finding in findings] == ["dead"] * dead


@pytest.mark.parametrize(
    ("share", "verdict"),
    [(0.02, Verdict.EXCLUDED), (2e-3, Verdict.EXCLUDED), (3e-4, Verdict.WARNING), (5e-5, None)],
)
def test_clipping_is_judged_by_how_many_samples_it_hits(healthy, share, verdict):
    usable, findings, _ = screen(systems.edited(healthy, ROW, clipped=share), BAND_HZ)
    expected = [] if verdict is None else [(*at(healthy, ROW), "clipped", verdict)]
    assert named(findings) == expected
    assert usable.n_positions == 72 - (verdict == Verdict.EXCLUDED)


def test_a_channel_that_sees_something_else_is_incoherent(healthy):
    usable, findings, _ = screen(systems.edited(healthy, ROW, coherence=0.05), BAND_HZ)
    assert named(findings) == [(*at(healthy, ROW), "incoherent", Verdict.EXCLUDED)]
    assert "0.05, where the other channels have 1.00" in findings[0].detail
    assert usable.n_positions == 71


def test_a_few_clipped_samples_do_not_save_an_incoherent_channel(healthy):
    """A dead sensor behind a coarse converter has few levels, and some samples on the last one."""
    doubtful = systems.edited(healthy, ROW, coherence=0.05, clipped=2e-4)
    usable, findings, _ = screen(doubtful, BAND_HZ)
    assert named(findings) == [(*at(healthy, ROW), "incoherent", Verdict.EXCLUDED)]
    assert usable.n_positions == 71


def test_low_coherence_everywhere_is_noise_and_no_fault(healthy):
    quiet = replace(healthy, coherence=np.full(healthy.coherence.shape, 0.2))
    usable, findings, _ = screen(systems.edited(quiet, ROW, coherence=0.15), BAND_HZ)
    assert findings == []
    assert usable.n_positions == 72


def test_unknown_coherence_accuses_nobody(healthy):
    unknown = replace(healthy, coherence=np.full(healthy.coherence.shape, np.nan))
    assert screen(unknown, BAND_HZ)[1] == []


def with_hum(frf, rows, tone_hz=50.0, factor=50):
    std = np.array(frf.std)
    std[np.ix_(np.atleast_1d(rows), frf.frequency_hz == tone_hz)] *= factor
    return replace(frf, std=std)


@pytest.mark.parametrize("tone_hz", [50.0, 60.0])
def test_one_humming_channel_is_named(healthy, tone_hz):
    usable, findings, _ = screen(with_hum(healthy, ROW, tone_hz), BAND_HZ)
    assert named(findings) == [(*at(healthy, ROW), "hum", Verdict.WARNING)]
    assert f"{tone_hz:g} Hz hum" in findings[0].detail
    assert usable.n_positions == 72


def test_hum_on_all_channels_is_one_remark(healthy):
    findings = screen(with_hum(healthy, np.arange(72)), BAND_HZ)[1]
    assert named(findings) == [("", "", "hum", Verdict.OK)]


def test_among_humming_channels_the_far_louder_one_is_named_too(healthy):
    frf = with_hum(with_hum(healthy, np.arange(72)), ROW, factor=40)
    checks = named(screen(frf, BAND_HZ)[1])
    assert checks == [("", "", "hum", Verdict.OK), (*at(frf, ROW), "hum", Verdict.WARNING)]


def test_a_clipped_force_spoils_its_run(healthy):
    rows = np.array(healthy.run) == "run_3"
    usable, findings, _ = screen(systems.edited(healthy, rows, force_clipped=0.01), BAND_HZ)
    assert named(findings) == [("run_3", "force", "clipped", Verdict.WARNING)]
    assert usable.n_positions == 72


def test_the_worst_fault_of_a_channel_counts(healthy):
    frf = systems.edited(healthy, ROW, values=0, coherence=0, clipped=1.0)
    assert named(screen(frf, BAND_HZ)[1]) == [(*at(frf, ROW), "dead", Verdict.EXCLUDED)]


def test_several_faults_are_all_named(healthy):
    frf = systems.edited(healthy, 3, values=0, coherence=0)
    frf = systems.edited(frf, 40, clipped=0.1)
    frf = systems.edited(frf, 41, coherence=0.01)
    usable, findings, _ = screen(frf, BAND_HZ)
    assert [finding.check for finding in findings] == ["dead", "clipped", "incoherent"]
    assert usable.n_positions == 69


def test_no_channel_left_is_an_error_with_a_remedy(healthy):
    with pytest.raises(InputError, match="all channels") as caught:
        screen(replace(healthy, clipped=np.full(72, 0.1)), BAND_HZ)
    assert "Check cables" in caught.value.remedy


def test_runs_that_contradict_each_other_where_they_are_averaged(healthy):
    usable, findings, _ = screen(systems.edited(healthy, ROW, disagreement=0.4), BAND_HZ)
    assert usable.n_positions == healthy.n_positions
    assert [(f.check, f.verdict) for f in findings] == [("averaged runs", Verdict.WARNING)]
    assert "differ by 40 % of their power" in findings[0].detail
    assert not screen(systems.edited(healthy, ROW, disagreement=0.05), BAND_HZ)[1]


def test_runs_that_contradict_each_other_everywhere_are_refused(healthy):
    turned = replace(healthy, disagreement=np.full(healthy.n_positions, 0.65))
    with pytest.raises(InputError, match="ringmodal init"):
        screen(turned, BAND_HZ)


def test_a_roving_force_taken_for_one_place_is_refused(healthy):
    one = replace(healthy.rows(np.array([0])), disagreement=np.array([0.98]))
    with pytest.raises(InputError, match="FORCE = degrees"):
        screen(replace(one, run=("hit_1+hit_2+hit_3",)), BAND_HZ)
    assert screen(replace(one, run=("hit_1+hit_2",)), BAND_HZ)[0].n_positions == 1
