"""Corrections as data: applied, combined, and left to the user."""

from dataclasses import replace

import numpy as np
import systems

from ema.checks.corrections import Correction, corrected, followed_by, kept_rows
from ema.core.finding import Check, Verdict
from ema.core.settings import CheckSettings
from ema.identify import identify_modes
from pipelines.simulate.truth import truth_modes

FRF = systems.campaign_frf(truth_modes(), 34)


def change(row, *, factor=1.0, source=None, excluded=False):
    source = row if source is None else source
    return Correction(row, "", "", None, "", factor, source, excluded)


def test_rows_are_scaled_exchanged_and_left_out():
    swap = change(3, source=9), change(9, source=3)
    found = corrected(FRF, (change(1, factor=-2.0), *swap, change(5, excluded=True)))
    np.testing.assert_array_equal(found.values[1], -2.0 * FRF.values[1])
    np.testing.assert_array_equal(found.std[1], 2.0 * FRF.std[1])
    np.testing.assert_array_equal(found.values[[3, 8]], FRF.values[[9, 3]])
    np.testing.assert_array_equal(found.position_deg, np.delete(FRF.position_deg, 5))


def test_corrections_of_what_others_left_are_the_same_in_one():
    first = (change(0, excluded=True), change(6, factor=-1.0), change(8, factor=0.5))
    then = (
        change(5, source=11),  # measured rows 6 and 12
        change(11, source=5),
        change(7, factor=4.0),
        change(20, excluded=True),
    )
    both = followed_by(FRF, first, then)
    assert [each.row for each in both] == [0, 6, 8, 12, 21]
    expected = corrected(corrected(FRF, first), then)
    np.testing.assert_array_equal(corrected(FRF, both).values, expected.values)
    np.testing.assert_array_equal(corrected(FRF, both).position_deg, expected.position_deg)
    assert kept_rows(FRF, both).size == 70


def faulty():
    """A dead sensor, a flipped one and one that reads half."""
    values = np.array(FRF.values)
    values[10] *= 1e-6
    values[25] *= -1.0
    values[40] *= 0.5
    return replace(FRF, values=values)


def test_the_identification_keeps_what_was_measured():
    frf = faulty()
    found = identify_modes(frf)
    assert found.measured is frf
    np.testing.assert_array_equal(found.frf.values, corrected(frf, found.corrections).values)
    dead, flipped, scaled = found.corrections
    assert (dead.row, dead.excluded, dead.gain) == (10, True, None)
    assert (flipped.row, flipped.check, flipped.factor) == (25, Check.FLIPPED, -1.0)
    assert (scaled.row, scaled.check, scaled.channel) == (40, Check.SCALED, frf.channel[40])
    assert abs(scaled.gain - 0.5) < 4 * scaled.gain_std < 0.2
    assert abs(scaled.factor * scaled.gain - 1) < 1e-12
    assert scaled.mismatch_std < 3.5


def test_a_user_may_leave_all_sensors_as_they_are():
    frf = faulty()
    found = identify_modes(frf, (60.0, 160.0), checks=CheckSettings(correct_sensors=False))
    assert [each.row for each in found.corrections] == [10]
    np.testing.assert_array_equal(found.frf.values, np.delete(frf.values, 10, axis=0))
    named = {(f.position_deg, f.verdict) for f in found.findings if "correct_sensors" in f.detail}
    assert named == {(125.0, Verdict.WARNING), (200.0, Verdict.WARNING)}
    assert [f.position_deg for f in found.findings if f.verdict == Verdict.EXCLUDED] == [50.0]
