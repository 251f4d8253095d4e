"""Split tyres through the whole identification: pairs resolved, or said not to be."""

from dataclasses import replace

import numpy as np
import pytest
import systems

from ema.core.modes import Pair
from ema.fitting.run_states import in_states
from ema.identify import identify_modes
from pipelines.simulate.truth import truth_modes

SPLIT = truth_modes(split_percent=2.5)


def own(model, orders=range(1, 8)):
    return [mode for mode in model.modes if mode.order in orders]


@pytest.fixture(scope="module", params=[0, 1])
def split(request):
    return identify_modes(systems.campaign_frf(SPLIT, 34, seed=request.param)).model


def test_both_members_of_every_driven_pair_hold_their_bounds(split):
    systems.assert_modes(split, systems.of_orders(SPLIT), frequency=5e-4, damping=0.02)


def test_a_force_5_degrees_from_its_stated_place_moves_no_order():
    truth = truth_modes(split_percent=0.4)
    frf = systems.campaign_frf(truth, 50)
    model = identify_modes(replace(frf, excitation_deg=frf.excitation_deg + 5)).model
    for order in (4, 5):
        expected = [mode.frequency_hz for mode in systems.of_orders(truth, (order,))]
        found = [mode.frequency_hz for mode in own(model, [order])]
        assert found == pytest.approx(expected, rel=2e-4)


def test_members_have_their_letters_and_the_verdict(split):
    modes = own(split)
    assert [mode.member for mode in modes] == ["a", "b"] * 7
    assert {mode.pair for mode in modes} == {Pair.RESOLVED}
    assert [report.pair.verdict for report in split.orders] == [Pair.RESOLVED] * len(split.orders)
    assert all(report.pair.chance < 1e-4 for report in split.orders)


def test_members_stand_a_quarter_wave_apart(split):
    """cos n(θ − ψ): the antinodes of the two members lie 90°/n from each other."""
    modes = own(split)
    for lower, upper in zip(modes[::2], modes[1::2], strict=True):
        wave = np.exp(1j * lower.order * np.deg2rad(split.position_deg))
        turns = [np.angle(np.sum(mode.shape.real * wave)) for mode in (lower, upper)]
        away = np.rad2deg(np.abs(turns[0] - turns[1])) % 180
        assert away == pytest.approx(90, abs=1)


def test_each_order_by_itself_says_the_same(split):
    modes = own(split)
    for report in split.orders[:7]:
        low, high = [mode for mode in modes if mode.order == report.order]
        assert low.frequency_hz < report.frequency_hz < high.frequency_hz
        assert report.damping_ratio == pytest.approx(low.damping_ratio, rel=0.04)
        assert report.frequency_std_hz > 0
        assert report.damping_std > 0


@pytest.mark.parametrize(
    ("split_percent", "verdict"), [(1.5, Pair.NOT_SEPARABLE), (4.0, Pair.RESOLVED)]
)
def test_members_damped_unlike_are_told_apart_where_each_has_a_peak(split_percent, verdict):
    """Within a half-width, an error of the FRFs looks the same; the ± then hold both members."""
    unlike = {"a": 1.1, "b": 0.9}
    truth = [
        replace(mode, damping_ratio=unlike.get(mode.member, 1.0) * mode.damping_ratio)
        for mode in truth_modes(split_percent=split_percent)
    ]
    model = identify_modes(systems.campaign_frf(truth, 60), (130.0, 185.0)).model
    modes = own(model, [4, 5])
    assert {mode.pair for mode in modes} == {verdict}
    for true in systems.of_orders(truth, (4, 5)):
        mode = min(modes, key=lambda each: abs(each.frequency_hz - true.frequency_hz))
        assert mode.order == true.order
        assert abs(mode.damping_ratio - true.damping_ratio) < 2 * mode.damping_std


@pytest.fixture(scope="module")
def curve():
    """Of two poles as strong as each other, noise says which one stands for the order."""
    frf = systems.campaign_frf(truth_modes(split_percent=3.0), 50)
    return identify_modes(frf, band_hz=(20.0, 260.0)).basis.fit.curve


def test_no_state_of_a_run_makes_a_far_pole_grow(curve):
    """As carried on to it by a strong curvature: its response had no end."""
    far, curved = np.array([-4.0 + 57.0j]), np.array([0.0, 0.0, -0.15, 0.0])
    lever = curve.lines.lever(far)
    assert 1 + curved[2] * lever**2 < 0
    there = curve.lines.drifted(far, curved)
    assert there.real < 0 and there.imag > 0
    states = np.zeros((6, 4))
    states[1:, 2:] = 3.0, -1.0
    again = curve.in_new_states(in_states(curve.fit, states))
    assert np.all(np.isfinite(again.poles)) and np.all(again.poles.real < 0)
    again = curve.in_new_states(curve.fit)
    np.testing.assert_allclose(again.poles[:-2], curve.fit.poles[:-2], rtol=1e-4)


def test_orders_are_found_together_whichever_member_comes_first(curve):
    search, ring = curve.pair_search(), curve.ring
    turned = [replace(each, members=each.members[::-1]) for each in ring]
    one, other = search.orders_together(ring), search.orders_together(turned)
    for before, after in zip(one, other, strict=True):
        std = np.sqrt(np.diag(before.pair.covariance))
        np.testing.assert_array_less(np.abs(after.pair.numbers - before.pair.numbers), 0.05 * std)


def test_a_pair_counts_once_whichever_member_comes_first(curve):
    search, ring = curve.pair_search(), curve.ring
    beside = [each for each in ring if abs(each.pair.mean) > 2 * np.pi * 260]
    assert [len(each.members) for each in beside[:1]] == [2]
    known = []
    for orders in ring, [replace(each, members=each.members[::-1]) for each in ring]:
        search.resolve(orders)
        known.append([search.seen_of(each.order, list(each.members)).known for each in ring])
    for before, after in zip(*known, strict=True):
        assert len(before.beside) == len(after.beside)
        assert sum(after.beside_size) == pytest.approx(sum(before.beside_size), rel=0.01)


@pytest.mark.parametrize(("place", "member"), [(0.0, "a"), (1.0, "b")])
def test_a_pair_with_the_shaker_on_an_antinode_is_not_resolvable(place, member):
    truth = truth_modes(split_percent=2.5, shaker_between=place)
    model = identify_modes(systems.campaign_frf(truth, 34)).model
    systems.assert_modes(model, systems.of_orders(truth, member=member), frequency=5e-4)
    assert {mode.pair for mode in own(model)} <= {Pair.ONE_SEEN, Pair.NOT_SEPARABLE}
    assert {mode.member for mode in own(model)} == {""}
    assert Pair.RESOLVED not in {report.pair.verdict for report in model.orders}


def test_a_pair_that_is_not_split_is_one_mode():
    truth = truth_modes(split_percent=1e-6)
    model = identify_modes(systems.campaign_frf(truth, 34)).model
    systems.assert_modes(model, systems.of_orders(truth, member="a"), frequency=5e-4)
    assert {mode.member for mode in own(model)} == {""}
    assert Pair.RESOLVED not in {mode.pair for mode in own(model)}


@pytest.mark.parametrize(("split_percent", "snr_db"), [(0.1, 34), (0.1, 20), (0.2, 34)])
def test_a_small_split_is_never_one_mode_whose_damping_looks_certain(split_percent, snr_db):
    """No order is lost, and where one mode stands for two, its damping is that of both."""
    truth = truth_modes(split_percent=split_percent)
    model = identify_modes(systems.campaign_frf(truth, snr_db, seed=1)).model
    ratios = {mode.order: mode.damping_ratio for mode in truth}
    modes = [mode for mode in own(model) if mode.frequency_hz < 235]
    orders = [mode.order for mode in modes]
    assert set(orders) == set(range(1, 8))
    for mode in modes:
        assert (mode.member != "") == (mode.pair == Pair.RESOLVED)
        if orders.count(mode.order) == 1:
            assert abs(mode.damping_ratio - ratios[mode.order]) < 4 * mode.damping_std


def test_an_order_too_high_for_the_positions_does_not_pass_for_the_highest_told():
    # 15° apart, none from 180° to 210°: orders up to 6 are told, order 7 leaks into order 6.
    nodes = np.setdiff1d(np.arange(0, 72, 3), [36, 39, 42])
    truth = {mode.order: mode for mode in truth_modes()}
    model = identify_modes(systems.campaign_frf(truth_modes(), 34).rows(nodes)).model
    assert model.modes[-1].order is None
    report = model.orders[-1]
    assert report.order == 6
    away = report.frequency_hz - truth[6].frequency_hz
    assert abs(away) < 4 * report.frequency_std_hz
    assert abs(report.damping_ratio - truth[6].damping_ratio) < 4 * report.damping_std
