"""Frequencies and ring against what tyres have: a wrong sampling rate shows."""

import re
from dataclasses import replace

import numpy as np
import pytest
from results import ring_modes

from ema.core.finding import Check, Verdict
from pipelines.process.run import process
from pipelines.process.validate import plausibility_finding, ring_orders
from pipelines.results.options import Options
from pipelines.simulate.campaign import simulate_campaign
from pipelines.simulate.truth import truth_modes


def orders_of_a_tyre(factor):
    """Orders 1 to 7 of a car tyre, all frequencies multiplied."""
    model = ring_modes(np.arange(72) * 5.0)
    modes = tuple(replace(mode, pole=factor * mode.pole) for mode in model.modes)
    return ring_orders(replace(model, modes=modes))


@pytest.mark.parametrize("mass", [8.0, 12.0, 19.7, 35.0, 55.0, None])
def test_tyres_raise_no_doubt(mass):
    assert plausibility_finding(orders_of_a_tyre(1.0), mass).verdict == Verdict.OK


def test_a_truck_tyre_may_be_slower_than_a_car_tyre():
    slow = orders_of_a_tyre(0.4)
    assert plausibility_finding(slow, 35.7, 0.5).verdict == Verdict.OK
    assert plausibility_finding(slow, 35.7, 0.33).verdict == Verdict.WARNING


@pytest.mark.parametrize("factor", [2.0, 0.5, 4.0, 0.25, 10.0, 0.1, 2.56, 1000.0])
def test_a_wrong_rate_is_the_first_cause_that_is_named(factor):
    found = plausibility_finding(orders_of_a_tyre(factor), 19.7 / factor**2)
    assert found.verdict == Verdict.WARNING
    size = f"{max(factor, 1 / factor):.4g}"
    assert re.search(
        rf"sampling rate is too {'high' if factor > 1 else 'low'}.* {size} ", found.detail
    )


def test_a_wrong_pressure_leaves_the_frequencies_alone():
    found = plausibility_finding(orders_of_a_tyre(1.0), 19.7 * 6894.757 / 1e5)
    assert found.verdict == Verdict.WARNING
    assert "pressure" in found.detail
    assert "sampling" not in found.detail


def test_without_orders_and_mass_there_is_nothing_to_compare():
    assert plausibility_finding((), None) is None


@pytest.mark.parametrize("factor", [2, 0.5])
def test_a_campaign_whose_files_state_a_wrong_rate(tmp_path, factor):
    """Simulated at 2 kHz and rewritten as if it were `factor` times as fast."""
    campaign = simulate_campaign(tmp_path / "campaign", duration_s=8, file_format="csv")
    for path in campaign.glob("*.csv"):
        lines = path.read_text().splitlines()
        first = next(k for k, line in enumerate(lines) if re.match(r"[-\d]", line))
        for k in range(first, len(lines)):
            time, rest = lines[k].split(",", 1)
            lines[k] = f"{float(time) / factor:.10g},{rest}"
        path.write_text("\n".join(lines) + "\n")
    manifest = campaign / "campaign.toml"
    stated = f"sampling_rate_hz = {2000 * factor:g}"
    manifest.write_text(manifest.read_text().replace("sampling_rate_hz = 2000.0", stated))
    result = process(campaign, Options())
    (found,) = (f for f in result.findings if f.check == Check.PLAUSIBILITY)
    first_hz = min(mode.frequency_hz for mode in truth_modes() if mode.order == 1)
    assert result.modal_model.frequencies_hz[0] == pytest.approx(factor * first_hz, rel=1e-3)
    assert found.verdict == Verdict.WARNING
    assert "sampling rate" in found.detail
    blamed = [f for f in result.findings if f.check == "amplitude" and f.verdict == Verdict.WARNING]
    assert blamed == []
