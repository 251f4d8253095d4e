"""What an expert would have looked at: pairs, drift, sensors, mass, foreign modes."""

from dataclasses import replace

import numpy as np
import pytest
import systems

import ema
from ema.circumference.ring_modes import family
from ema.core.frf import FRF
from ema.core.modes import Flag, Pair
from ema.identify import SensorMass
from pipelines.simulate.truth import TruthMode, truth_modes

ORDERS = [1, 2, 3, 4, 5, 6, 7]
SIX_RUNS = tuple(f"run_{number}" for number in range(1, 7))


def identified(frf, **options):
    return ema.identify_modes(frf, (20.0, 260.0), **options)


def of_orders(found, orders=ORDERS):
    return [mode for mode in found.model.modes if mode.order in orders]


def errors_percent(modes, truth):
    """Frequency and damping errors against the truth's nearest mode of the same order."""
    pairs = []
    for mode in modes:
        near = min(
            (t for t in truth if t.order == mode.order),
            key=lambda t: abs(t.frequency_hz - mode.frequency_hz),
        )
        pairs.append(
            (
                100 * (mode.frequency_hz / near.frequency_hz - 1),
                100 * (mode.damping_ratio / near.damping_ratio - 1),
            )
        )
    return np.abs(np.array(pairs)).max(axis=0)


@pytest.fixture(scope="module")
def quiet():
    return systems.campaign_frf(truth_modes(), 30, seed=3)


@pytest.mark.parametrize(
    ("snr_db", "seed", "frequency", "damping"),
    [(40, 0, 0.02, 1.0), (40, 1, 0.02, 1.0), (8, 2, 0.05, 2.0), (8, 3, 0.05, 2.0)],
)
def test_modes_of_a_whole_campaign(snr_db, seed, frequency, damping):
    found = identified(systems.campaign_frf(truth_modes(), snr_db, seed=seed))
    inside = [mode for mode in found.model.modes if mode.frequency_hz < 240]
    assert [mode.order for mode in inside] == ORDERS
    error = errors_percent(inside, truth_modes())
    assert error[0] < frequency
    assert error[1] < damping


def test_both_members_of_a_split_pair():
    truth = truth_modes(split_percent=2.5)
    found = identified(systems.campaign_frf(truth, 34, seed=1))
    modes = of_orders(found)
    assert [(mode.order, mode.member) for mode in modes] == [(n, m) for n in ORDERS for m in "ab"]
    assert {mode.pair for mode in modes} == {Pair.RESOLVED}
    error = errors_percent(modes, truth)
    assert error[0] < 0.05
    assert error[1] < 2.0


def test_a_pair_with_one_member_driven_is_said_to_be_unresolved():
    truth = truth_modes(split_percent=2.5, shaker_between=0.0)
    found = identified(systems.campaign_frf(truth, 34, seed=1))
    modes = of_orders(found)
    assert [mode.order for mode in modes] == ORDERS
    assert Pair.RESOLVED not in {mode.pair for mode in modes}
    assert {mode.member for mode in modes} == {""}
    assert errors_percent(modes, truth)[1] < 2.0
    assert Pair.RESOLVED not in {report.pair.verdict for report in found.model.orders}


def test_each_order_by_itself_agrees_with_the_global_fit(quiet):
    model = identified(quiet).model
    for report in model.orders:
        mode = next(m for m in model.modes if m.order == report.order)
        assert report.frequency_hz == pytest.approx(mode.frequency_hz, rel=2e-4)
        assert report.damping_ratio == pytest.approx(mode.damping_ratio, rel=0.01)


def test_a_drift_over_the_runs():
    drift = np.linspace(0, 0.3, 6)
    found = identified(systems.campaign_frf(truth_modes(), 26, seed=2, drift_percent=drift))
    modes = of_orders(found)
    assert [mode.order for mode in modes] == ORDERS
    error = errors_percent(modes, truth_modes())
    assert error[0] < 0.05
    assert error[1] < 2.0
    assert found.model.drift.applied
    assert np.abs(found.model.drift.percent - drift).max() < 0.05


def warmer(mode, percent):
    """All frequencies up, damping down by 6 % where they rise by 0.9 %."""
    scale = 1 - 0.06 * percent / 0.9
    hz = mode.frequency_hz * (1 + percent / 100)
    return replace(mode, frequency_hz=hz, damping_ratio=mode.damping_ratio * scale)


def pumped(mode, percent):
    """More tension: order 1 stays, high orders rise."""
    share = 1 - (78.7 / max(mode.frequency_hz, 78.7)) ** 2
    return replace(mode, frequency_hz=mode.frequency_hz * (1 + share * percent / 100))


CORRECTIONS = {"flipped", "scaled", "swapped", "inconsistent"}


@pytest.mark.parametrize("in_state", [warmer, pumped])
@pytest.mark.parametrize("percent", [0.1, 0.3, 0.6, 0.9])
def test_a_drift_makes_no_sensor_look_faulty(percent, in_state):
    drift = np.linspace(0, percent, 6)
    truth = truth_modes(split_percent=0.1)
    frf = systems.campaign_frf(truth, 40, seed=4, drift_percent=drift, in_state=in_state)
    found = identified(frf)
    assert not CORRECTIONS & {finding.check for finding in found.findings}
    np.testing.assert_array_equal(found.frf.values, frf.values)
    if in_state is warmer:
        assert sorted({mode.order for mode in found.model.modes}) == [*ORDERS, 8]


def test_faulty_sensors_are_found_beside_a_drift():
    drift, noise = np.linspace(0, 0.6, 6), np.random.default_rng(9)
    frf = systems.campaign_frf(
        truth_modes(split_percent=0.1), 40, seed=4, drift_percent=drift, in_state=warmer
    )
    faint = 1e-6 * noise.standard_normal(frf.frequency_hz.size)
    for row, change in (
        (25, {"values": -frf.values[25]}),
        (33, {"values": 0.1 * frf.values[33], "std": 0.1 * frf.std[33]}),
        ([12, 30], {"values": frf.values[[30, 12]], "std": frf.std[[30, 12]]}),
        (10, {"values": faint, "coherence": 0.01}),
        (50, {"clipped": 0.02, "values": 0.7 * frf.values[50]}),
    ):
        frf = systems.edited(frf, row, **change)
    found = identified(frf)
    named = {
        (finding.check, round(finding.position_deg / 5))
        for finding in found.findings
        if finding.position_deg is not None and finding.verdict != "ok"
    }
    assert named == {
        *(("flipped", 25), ("scaled", 33), ("swapped", 12), ("swapped", 30)),
        *(("dead", 10), ("clipped", 50)),
    }
    assert sorted({mode.order for mode in found.model.modes}) == [*ORDERS, 8]


def test_no_drift_is_said_where_there_is_none(quiet):
    drift = identified(quiet).model.drift
    assert not drift.applied
    assert drift.chance > 1e-4
    assert np.abs(drift.percent).max() < 0.02


@pytest.mark.parametrize("options", [{}, {"split_percent": 1e-6, "shaker_between": 0.0}])
def test_the_mass_of_the_sensors_is_taken_off(options):
    """Where only driven members take part, and where both members of each pair do."""
    truth = truth_modes(**options)
    frf = systems.campaign_frf(truth, 40, seed=1, sensor_mass_kg=0.004)
    turned = np.arange(12) * 30.0 + np.arange(6)[:, None] * 5.0
    seats = np.column_stack([turned, frf.reference.position_deg])
    sensors = dict(zip(SIX_RUNS, seats, strict=True))
    loaded, bare = identified(frf), identified(frf, sensor_mass=SensorMass(0.004, sensors))
    assert [mode.order for mode in of_orders(bare)] == ORDERS
    assert errors_percent(of_orders(bare), truth)[0] < 0.03
    assert errors_percent(of_orders(loaded), truth)[0] > 0.15


def altered(frf, row, values=None, std=None, **changes):
    """FRFs with one row changed."""
    new_values, new_std = np.array(frf.values), np.array(frf.std)
    if values is not None:
        new_values[row] = values
    if std is not None:
        new_std[row] = std
    return replace(frf, values=new_values, std=new_std, **changes)


def named(found, check):
    return {(f.run, f.position_deg): f.verdict for f in found.findings if f.check == check}


def keeps_its_accuracy(found):
    modes = of_orders(found)
    error = errors_percent(modes, truth_modes())
    return [mode.order for mode in modes] == ORDERS and error[0] < 0.05 and error[1] < 2.0


def test_a_flipped_sensor_is_turned(quiet):
    found = identified(altered(quiet, 20, -quiet.values[20]))
    assert named(found, "flipped") == {(quiet.run[20], 100.0): "warning"}
    assert keeps_its_accuracy(found)
    np.testing.assert_allclose(found.frf.values[20], quiet.values[20])


def test_a_wrongly_scaled_sensor_is_scaled(quiet):
    found = identified(altered(quiet, 7, 0.1 * quiet.values[7], 0.1 * quiet.std[7]))
    assert named(found, "scaled") == {(quiet.run[7], 35.0): "warning"}
    assert keeps_its_accuracy(found)
    np.testing.assert_allclose(found.frf.values[7], quiet.values[7], rtol=0.02)


def test_two_swapped_sensors_are_put_right(quiet):
    first, second = 8, 26
    assert quiet.run[first] == quiet.run[second]
    swapped = altered(quiet, [first, second], quiet.values[[second, first]])
    found = identified(swapped)
    assert set(named(found, "swapped")) == {(quiet.run[8], 40.0), (quiet.run[8], 130.0)}
    assert keeps_its_accuracy(found)


def test_a_dead_and_a_clipped_sensor_are_left_out(quiet):
    clipped = np.zeros(quiet.n_positions)
    clipped[40] = 0.05
    frf = altered(quiet, 12, np.zeros(quiet.frequency_hz.size), clipped=clipped)
    found = identified(frf)
    assert named(found, "dead") == {(quiet.run[12], 60.0): "excluded"}
    assert named(found, "clipped") == {(quiet.run[40], 200.0): "excluded"}
    assert found.frf.n_positions == quiet.n_positions - 2
    assert keeps_its_accuracy(found)


def test_a_sensor_that_sees_something_else_is_left_out(quiet):
    rng = np.random.default_rng(0)
    size = np.abs(quiet.values).mean()
    noise = size * rng.standard_normal(quiet.frequency_hz.size)
    coherence = np.array(quiet.coherence)
    coherence[30] = 0.02
    found = identified(altered(quiet, 30, noise, coherence=coherence))
    assert named(found, "incoherent") == {(quiet.run[30], 150.0): "excluded"}
    assert keeps_its_accuracy(found)


def test_hum_is_no_mode(quiet):
    line = int(np.argmin(np.abs(quiet.frequency_hz - 50)))
    values, std = np.array(quiet.values), np.array(quiet.std)
    values[:, line] += 30 * np.abs(values[:, line])
    std[:, line] *= 40
    found = identified(replace(quiet, values=values, std=std))
    assert all(abs(mode.frequency_hz - 50) > 3 for mode in found.model.modes)
    assert keeps_its_accuracy(found)
    assert any(finding.check == "hum" for finding in found.findings)


def test_a_cavity_mode_is_foreign_and_leaves_order_6_alone():
    cavity = TruthMode(1, "", 207.0, 0.003, 80.0)
    alone = identified(systems.campaign_frf(truth_modes(), 30, seed=4))
    found = identified(systems.campaign_frf((*truth_modes(), cavity), 30, seed=4))
    beside = next(mode for mode in found.model.modes if abs(mode.frequency_hz - 207) < 1)
    assert Flag.NOT_RING_MODE in beside.flags
    assert beside.frequency_hz == pytest.approx(207.0, rel=1e-4)
    sixth, before = (next(m for m in f.model.modes if m.order == 6) for f in (found, alone))
    assert sixth.frequency_hz == pytest.approx(before.frequency_hz, rel=5e-4)
    members = family(found.model.modes)
    assert found.model.modes.index(beside) not in [k for own in members.values() for k in own]


def test_a_second_estimator_agrees_on_a_good_measurement(quiet):
    opinions = identified(quiet).opinions
    assert {opinion.method for opinion in opinions} == {"plscf"}
    assert all(opinion.agrees for opinion in opinions)


def test_the_ends_of_the_band_matter_less_than_the_noise(quiet):
    for mode in of_orders(identified(quiet)):
        assert mode.frequency_band_shift_hz < mode.frequency_std_hz
        assert mode.damping_band_shift < mode.damping_std


def test_error_bars_hold_what_they_promise():
    """z scores of 20 campaigns of a reduced size; the full study is a benchmark."""
    lines = np.arange(1, 561) / 2
    scores = []
    for seed in range(20):
        frf = systems.campaign_frf(truth_modes(), 15, seed=seed, frequency_hz=lines, averages=30)
        model = ema.fit_modes(frf, ema.select_poles(ema.build_stability(frf, (40, 240))))
        for mode in model.modes[:7]:
            truth = next(t for t in truth_modes() if t.order == mode.order)
            scores.append((mode.frequency_hz - truth.frequency_hz) / mode.frequency_std_hz)
            scores.append((mode.damping_ratio - truth.damping_ratio) / mode.damping_std)
    assert 0.88 < np.mean(np.abs(scores) < 1.96) < 0.99


def test_what_is_no_circle_goes_through_without_orders(quiet):
    line = FRF(
        quiet.frequency_hz,
        quiet.values,
        quiet.coherence,
        quiet.std,
        np.arange(1, 73),
        np.full(72, np.nan),
        quiet.run,
    )
    found = identified(line)
    assert [mode.order for mode in found.model.modes if mode.frequency_hz < 240] == [None] * 7
    assert found.model.orders == ()
