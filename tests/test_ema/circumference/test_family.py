"""Which modes are the ring's own: the rising chain, its pairs, and what stands beside it."""

from dataclasses import replace

import numpy as np
import pytest
import systems
from hypothesis import given
from hypothesis import strategies as st

from ema.circumference.orders import drive, family, judged, why_foreign
from ema.core.modes import Flag, Mode, OrderReport, Pair, PairVerdict
from ema.identify import identify_modes
from pipelines.process.validate import ring_orders
from pipelines.simulate.truth import TruthMode, truth_modes

FULL_DEG = np.arange(72) * 5.0


def mode_of(order, frequency_hz, *, damping=0.02, mass_kg=4.0, purity=1.0, turned_deg=0.0):
    pole = complex(systems.pole(frequency_hz, damping))
    shape = np.cos(order * np.deg2rad(FULL_DEG - turned_deg))
    residues = shape * systems.residue(pole, mass_kg)
    return Mode(pole, 0.01, 1e-4, residues, np.zeros(72), order, "", purity)


def ring():
    return [mode_of(n, hz) for n, hz in enumerate(systems.TABLE_3_HZ, start=1)]


def report(order, verdict=Pair.ONE_SEEN):
    return OrderReport(PairVerdict(order, verdict, 0.5, ""))


@given(st.permutations(range(7)))
def test_a_ring_alone_is_its_own_family_in_any_sequence(places):
    modes = [ring()[k] for k in places]
    members = family(modes)
    assert sorted(members) == list(range(1, 8))
    assert all(modes[k].order == order for order, (k,) in members.items())


def test_orders_that_sidewalls_damp_alike_are_a_family():
    """Equal rates of decay: order 1 has three times the damping ratio of most."""
    hz = np.array([47.6, 78.5, 109.0, 140.6, 173.0, 206.0, 239.6, 273.6])
    modes = [mode_of(n, f, damping=2.74 / f) for n, f in enumerate(hz, start=1)]
    assert sorted(family(modes)) == list(range(1, 9))


@pytest.mark.parametrize(
    "stranger",
    [
        mode_of(1, 207.0, damping=0.003, mass_kg=80.0),  # cavity
        mode_of(1, 207.0, damping=0.003, mass_kg=5.0),
        mode_of(3, 60.0, mass_kg=40.0),  # wheel
        mode_of(2, 240.0, mass_kg=40.0),
        mode_of(0, 150.0),
        mode_of(4, 145.0, purity=0.4),
    ],
)
def test_strangers_stay_outside(stranger):
    modes = [*ring(), stranger]
    assert 7 not in [k for chosen in family(modes).values() for k in chosen]
    assert sorted(family(modes)) == list(range(1, 8))


def test_the_mode_that_the_force_drives_more_is_the_ring_s():
    """Two of one order fit into the chain; |A|ω is the inverse of the modal mass."""
    modes = [*ring(), mode_of(3, 110.0, mass_kg=12.0)]
    assert family(modes)[3] == [2]
    modes = [*ring(), mode_of(3, 110.0, mass_kg=1.5)]
    assert family(modes)[3] == [7]


def test_drive_is_the_inverse_of_modal_mass_whatever_the_frequency():
    drives = [drive(mode_of(n, hz, mass_kg=5.0)) for n, hz in ((1, 50.0), (3, 120.0), (7, 300.0))]
    np.testing.assert_allclose(drives, np.sqrt(1 / 2) / (2 * 5.0), rtol=1e-3)


def test_members_of_a_pair_belong_together_the_stronger_first():
    modes = [*ring(), mode_of(4, 147.5, mass_kg=9.0, turned_deg=22.5)]
    assert family(modes)[4] == [3, 7]


@pytest.mark.parametrize(
    ("frequency_hz", "damping"), [(135.0, 0.02), (156.0, 0.02), (147.0, 0.05), (147.0, 0.008)]
)
def test_what_lies_far_off_or_is_damped_otherwise_is_no_partner(frequency_hz, damping):
    modes = [*ring(), mode_of(4, frequency_hz, damping=damping, mass_kg=9.0)]
    assert family(modes)[4] == [3]


@pytest.mark.parametrize(("damping", "chosen"), [(0.034, [3, 7]), (0.02, [3])])
def test_a_weak_member_may_lie_where_both_resonances_touch(damping, chosen):
    """At 8 dB it was fitted 6.4 % away, called another resonance, and its order one mode."""
    main, far_hz = mode_of(4, 144.0, damping=damping), 144.0 * 1.064
    modes = ring()
    modes[3] = main
    modes.append(mode_of(4, far_hz, damping=damping, mass_kg=30.0, turned_deg=22.5))
    assert family(modes)[4] == chosen


def test_a_missing_order_breaks_no_chain():
    modes = [mode for mode in ring() if mode.order != 4]
    assert sorted(family(modes)) == [1, 2, 3, 5, 6, 7]


def test_nothing_has_no_family():
    assert family([]) == {}
    assert family([mode_of(0, 50.0), mode_of(3, 90.0, purity=0.2)]) == {}


def test_each_reason_to_be_foreign_is_named():
    own = ring()
    cavity = mode_of(1, 207.0, damping=0.003)
    assert "purity 0.30" in why_foreign(mode_of(3, 90.0, purity=0.3), own)
    assert "order 0" in why_foreign(mode_of(0, 90.0), own)
    assert "elsewhere" in why_foreign(cavity, own)
    assert "6.7 times" in why_foreign(cavity, own)
    assert "times" not in why_foreign(mode_of(1, 207.0), own)


def test_resolved_pairs_get_letters_in_ascending_frequency():
    modes = sorted([*ring(), mode_of(4, 143.0, mass_kg=9.0)], key=lambda mode: mode.frequency_hz)
    reports = [report(n, Pair.RESOLVED if n == 4 else Pair.ONE_SEEN) for n in range(1, 8)]
    named = judged(modes, reports)
    assert [(m.frequency_hz < 144, m.member) for m in named if m.order == 4] == [
        (True, "a"),
        (False, "b"),
    ]
    assert {m.member for m in named if m.order != 4} == {""}


def test_a_pair_that_is_not_resolved_has_no_letters():
    modes = [*ring(), mode_of(4, 146.0, mass_kg=9.0)]
    named = judged(modes, [report(n) for n in range(1, 8)])
    assert {mode.member for mode in named} == {""}


def test_a_status_that_says_something_is_kept():
    modes = ring()
    modes[2] = replace(modes[2], flags=(Flag.AT_BOUND,))
    modes.append(replace(mode_of(1, 207.0), flags=(Flag.AT_BOUND,)))
    named = judged(modes, [report(n) for n in range(1, 8)])
    assert (named[2].pair, named[2].status) == (Pair.ONE_SEEN, "at bound")
    assert Flag.NOT_RING_MODE in named[7].flags
    assert named[7].status == "not a ring mode; at bound"
    assert named[7].doubtful


def test_without_a_circle_nothing_is_judged():
    modes = tuple(ring())
    assert judged(modes, []) == modes


LINES_HZ = np.arange(80, 1401) / 4
BAND_HZ = (20.0, 260.0)  # modes just above the last line cannot be told


@pytest.fixture(scope="module")
def alone():
    frf = systems.campaign_frf(truth_modes(), 34, frequency_hz=LINES_HZ, averages=62)
    return identify_modes(frf, BAND_HZ).model


@pytest.mark.parametrize("times_heavier", [1, 10])
def test_a_cavity_beside_order_6_is_left_out_of_the_ring(alone, times_heavier):
    """A lightly damped acoustic mode at 207 Hz with the shape of order 1."""
    first = next(mode for mode in truth_modes() if mode.order == 1)
    cavity = TruthMode(1, "", 207.0, 0.003, times_heavier * first.modal_mass_kg)
    modes = (*truth_modes(), cavity)
    frf = systems.campaign_frf(modes, 34, frequency_hz=LINES_HZ, averages=62)
    beside = identify_modes(frf, BAND_HZ).model
    systems.assert_modes(
        beside, [*systems.of_orders(truth_modes()), cavity], frequency=5e-4, damping=0.02
    )
    six = [next(mode for mode in model.modes if mode.order == 6) for model in (alone, beside)]
    assert six[1].frequency_hz == pytest.approx(six[0].frequency_hz, rel=5e-4)
    stranger = next(mode for mode in beside.modes if abs(mode.frequency_hz - 207) < 1)
    assert Flag.NOT_RING_MODE in stranger.flags
    used = ring_orders(beside)
    assert [order.order for order in used] == list(range(1, 9))
    assert used[0].frequency_hz == pytest.approx(78.73, rel=5e-4)
