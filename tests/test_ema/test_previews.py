"""Numbers at once after an edit: a preview is near the end that follows."""

from dataclasses import replace

import numpy as np
import systems

from ema.core.edits import Edit, EditKind
from ema.identify import identify_modes
from ema.io.campaign.read import read_campaign
from ema.refit import refit_modes
from ema.signals.frf_estimation import estimate_frf
from pipelines.simulate.campaign import simulate_campaign
from pipelines.simulate.truth import truth_modes


def shifts_std(preview, end):
    """Changes from a preview to the end, in standard deviations."""
    pairs = zip(preview.model.modes, end.model.modes, strict=True)
    return [
        [
            (a.frequency_hz - b.frequency_hz) / b.frequency_std_hz,
            (a.damping_ratio - b.damping_ratio) / b.damping_std,
        ]
        for a, b in pairs
    ]


def test_a_preview_is_near_the_end_where_one_pole_stood_for_pairs(tmp_path):
    """The runs see pairs differently: what looks like a drift at first is none."""
    frf = estimate_frf(
        read_campaign(simulate_campaign(tmp_path / "c", duration_s=20.0, split_percent=0.7))
    )
    found = identify_modes(frf, (20.0, 260.0))
    edits = [Edit(EditKind.RUN_OUT, run=frf.run_names[2])]
    preview = refit_modes(found, edits, live=True)
    assert np.max(np.abs(shifts_std(preview, refit_modes(preview, edits)))) < 0.05


def test_a_preview_may_use_more_lines_than_the_fit_before(short_campaign):
    """The noise of the run left out made a line of the margin useless."""
    frf = estimate_frf(read_campaign(short_campaign))
    frf = frf.rows(np.arange(72))
    run = frf.run_names[2]
    noisy = [k for k, name in enumerate(frf.run) if name in frf.run_names[2:5]] + [0, 1]
    std = np.array(frf.std)
    std[np.ix_(noisy, frf.frequency_hz > 215.0)] *= 1e3
    frf = replace(frf, std=std)
    found = identify_modes(frf, (60.0, 210.0))
    edits = [Edit(EditKind.RUN_OUT, run=run)]
    preview = refit_modes(found, edits, live=True)
    lines = [each.basis.fit.curve.lines.frequency_hz.size for each in (found, preview)]
    assert lines[0] < lines[1]
    assert np.max(np.abs(shifts_std(preview, refit_modes(preview, edits)))) < 0.5


def test_live_numbers_of_runs_that_drift_are_those_of_the_end():
    """Rounds end where pairs and states agree, and the same poles hold them with or without a run.

    Before, the end was more than a standard deviation away.
    """
    drift = np.linspace(0, 1.5, systems.N_RUNS)
    frf = systems.campaign_frf(truth_modes(split_percent=1.0), 34, drift_percent=drift)
    automatic = identify_modes(frf, (20.0, 260.0))
    out = [Edit(EditKind.RUN_OUT, run="run_2")]
    live, final = (refit_modes(automatic, out, live=each) for each in (True, False))
    assert final.model.drift.applied
    for one, other in zip(live.model.modes, final.model.modes, strict=True):
        assert (one.order, one.member) == (other.order, other.member)
        assert abs(one.frequency_hz - other.frequency_hz) < 0.5 * other.frequency_std_hz
        assert abs(one.damping_ratio - other.damping_ratio) < 0.5 * other.damping_std
