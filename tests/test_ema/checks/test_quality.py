"""Checks on data: the reference sensor over the runs, coherence, the band that is excited."""

from dataclasses import replace

import numpy as np
import pytest
import systems

from ema.checks.quality import (
    averages_finding,
    check_reference,
    coherence_findings,
    reference_finding,
)
from ema.core.finding import Verdict

BAND_HZ = (20.0, 260.0)


def reference_frf(drift_percent=0.0, snr_db=20, seed=0, runs=6):
    """One sensor in several runs; frequencies rise by the same step from run to run."""
    still = systems.tyre_frf(snr_db, seed=seed, positions=runs)
    residues = systems.tyre_residues(np.full(runs, 2.5))
    clean = np.concatenate(
        [
            systems.inertance(
                still.frequency_hz,
                systems.table_3_poles() * (1 + drift_percent / 100 * number),
                residues[[number]],
            )
            for number in range(runs)
        ]
    )
    noise = np.random.default_rng(seed).standard_normal((*clean.shape, 2)) @ [1, 1j]
    names = tuple(f"run_{number}.uff" for number in range(runs))
    return replace(still, values=clean + still.std * noise, run=names)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("runs", [2, 6])
def test_runs_of_one_tyre_differ_by_their_noise(seed, runs):
    check = check_reference(reference_frf(seed=seed, runs=runs), BAND_HZ)
    assert check.ratio == pytest.approx(1, abs=0.08)
    assert check.consistent
    assert reference_finding(check).verdict == Verdict.OK


def test_a_tyre_that_drifts_is_noticed():
    check = check_reference(reference_frf(drift_percent=0.2), BAND_HZ)
    assert check.ratio > 1.5
    assert not check.consistent
    finding = reference_finding(check)
    assert finding.verdict == Verdict.WARNING
    assert f"{check.ratio:.2f} times its noise" in finding.detail


def test_a_change_too_small_to_matter_is_no_other_tyre():
    """What the compensation of masses leaves, seen by long recordings with little noise."""
    check = check_reference(reference_frf(drift_percent=0.01, snr_db=80), BAND_HZ)
    assert check.ratio > 1.5
    assert check.share < 0.01
    assert check.consistent


def test_the_ratio_grows_with_the_drift():
    ratios = [
        check_reference(reference_frf(drift_percent=drift), BAND_HZ).ratio
        for drift in (0.0, 0.1, 0.2, 0.4)
    ]
    assert np.all(np.diff(ratios) > 0)


def test_a_louder_noise_hides_the_drift():
    loud = reference_frf(drift_percent=0.05, snr_db=0)
    assert check_reference(loud, BAND_HZ).consistent


def test_the_check_keeps_the_lines_of_the_band_alone():
    check = check_reference(reference_frf(), BAND_HZ)
    assert (check.frequency_hz[0], check.frequency_hz[-1]) == BAND_HZ
    assert check.values.shape == check.std.shape == (6, check.frequency_hz.size)
    assert check.run[0] == "run_0.uff"


def test_without_known_noise_there_is_no_verdict():
    frf = reference_frf()
    check = check_reference(replace(frf, std=np.full(frf.std.shape, np.nan)), BAND_HZ)
    assert np.isnan(check.ratio)
    assert reference_finding(check).verdict == Verdict.WARNING
    assert "nan" not in reference_finding(check).detail


def test_one_run_has_nothing_to_differ_from():
    check = check_reference(reference_frf(runs=1), BAND_HZ)
    assert np.isnan(check.ratio)
    assert check.consistent


def test_each_position_gets_its_median_coherence():
    frf = systems.tyre_frf(positions=12)
    coherence = np.full(frf.values.shape, 0.99)
    coherence[3] = 0.31
    findings = coherence_findings(replace(frf, coherence=coherence), BAND_HZ)
    assert [finding.verdict for finding in findings] == [Verdict.OK] * 3 + [Verdict.WARNING] + [
        Verdict.OK
    ] * 8
    assert findings[3].position_deg == 90.0
    assert "0.310" in findings[3].detail
    assert "below 0.5" in findings[3].detail


def test_coherence_outside_the_band_does_not_count():
    frf = systems.tyre_frf(positions=3)
    outside = (frf.frequency_hz < BAND_HZ[0]) | (frf.frequency_hz > BAND_HZ[1])
    coherence = np.where(outside, 0.0, 0.9) * np.ones(frf.values.shape)
    findings = coherence_findings(replace(frf, coherence=coherence), BAND_HZ)
    assert {finding.verdict for finding in findings} == {Verdict.OK}


def test_unknown_coherence_is_no_finding():
    frf = systems.noise_free_frf(np.arange(1.0, 300), np.ones((2, 299)))
    assert coherence_findings(frf, BAND_HZ) == []


def test_a_position_without_angle_is_named_by_its_channel():
    frf = systems.noise_free_frf(np.arange(1.0, 300), np.ones((1, 299)))
    frf = replace(frf, coherence=np.full((1, 299), 0.2), channel=("A07",))
    (finding,) = coherence_findings(frf, BAND_HZ)
    assert (finding.channel, finding.position_deg, finding.verdict) == (
        "A07",
        None,
        Verdict.WARNING,
    )


@pytest.mark.parametrize(("n_effective", "count"), [(1.0, 1), (9.5, 0), (float("nan"), 0)])
def test_a_single_average_is_remarked(n_effective, count):
    frf = replace(systems.tyre_frf(positions=3), n_effective=n_effective)
    assert len(averages_finding(frf)) == count


def test_the_coherent_band_is_the_widest_one():
    frequency_hz = np.arange(1.0, 1001)
    coherence = np.full((3, 1000), 0.1)
    coherence[:, 100:300] = 0.95
    coherence[:, 400:900] = 0.9
    coherence[:, 650:652] = 0.0  # a dip at an antiresonance
    frf = systems.noise_free_frf(frequency_hz, np.ones((3, 1000)), coherence=coherence)
    low, high = frf.coherent_band_hz()
    assert low == pytest.approx(401, abs=16)
    assert high == pytest.approx(900, abs=16)


def test_a_short_gap_does_not_end_the_coherent_band_and_filtered_ends_do():
    frequency_hz = np.arange(0.0, 4000)
    coherence = np.full((3, 4000), 0.95)
    coherence[:, 1500:1560] = 0.3
    values = np.ones((3, 4000))
    values[:, :20], values[:, 3900:] = 1e-4, 1e-3
    frf = systems.noise_free_frf(frequency_hz, values, coherence=coherence)
    assert frf.coherent_band_hz() == (20.0, 3899.0)
    coherence = coherence.copy()
    coherence[:, 1500:1800] = 0.3
    low, high = replace(frf, coherence=coherence).coherent_band_hz()
    assert low == pytest.approx(1800, abs=16)
    assert high == 3899.0


@pytest.mark.parametrize("level", [np.nan, 0.2])
def test_without_a_coherent_band_all_lines_count(level):
    frequency_hz = np.arange(1.0, 101)
    frf = systems.noise_free_frf(
        frequency_hz, np.ones((2, 100)), coherence=np.full((2, 100), level)
    )
    assert frf.coherent_band_hz() == (1.0, 100.0)


def test_a_single_average_passes_no_check_of_its_coherence():
    frf = systems.tyre_frf(snr_db=20)
    assert coherence_findings(replace(frf, n_effective=1.0), BAND_HZ) == []
    assert len(coherence_findings(frf, BAND_HZ)) == frf.n_positions
