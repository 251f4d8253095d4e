"""Edits: they do what they say to the modes they name, to no others, and the same each time."""

import threading
from dataclasses import replace

import numpy as np
import pytest
import systems
from threadpoolctl import threadpool_limits

from ema.checks.corrections import DecidedBy
from ema.core.edits import ChannelName, Edit, EditKind, PoleName, shorthand
from ema.core.errors import FitError, InputError, SupersededError
from ema.core.finding import Check, Verdict
from ema.core.modes import Chosen, Pair
from ema.identify import identify_modes
from ema.refit import edit_cost, refit_modes
from pipelines.simulate.truth import truth_modes

BAND_HZ, FEW_HZ = (60.0, 260.0), (60.0, 160.0)
SPLITS = ((0.2, 0), (0.7, 1), (1.0, 2), (2.0, 3))  # percent, and the seed of the noise


def name(mode):
    return PoleName(mode.frequency_hz, mode.damping_ratio)


def edit(kind, mode=None, **more):
    return Edit(kind, None if mode is None else name(mode), **more)


def numbers(mode):
    return mode.pole, mode.frequency_std_hz, mode.damping_std, mode.order


def state(found):
    """Everything of the modes, to the last bit."""
    model = found.model
    modes = [(*numbers(mode), mode.member, mode.pair, mode.chosen) for mode in model.modes]
    residues = b"".join(mode.residues.tobytes() for mode in model.modes)
    known = model.covariance.tobytes(), model.misfit, model.notes, found.opinions
    return repr((modes, residues, known))


@pytest.fixture(scope="module", params=SPLITS, ids=lambda param: f"{param[0]} %")
def split(request):
    percent, seed = request.param
    return identify_modes(systems.campaign_frf(truth_modes(split_percent=percent), 34, seed=seed))


@pytest.fixture(scope="module")
def found():
    """Orders that show two members, and orders that do not."""
    return identify_modes(systems.campaign_frf(truth_modes(split_percent=0.3), 26, seed=0))


@pytest.fixture(scope="module")
def single(found):
    return next(mode for mode in found.model.modes if mode.order and not mode.member)


def beside(found, mode):
    """A pole of the diagram near a mode and damped like it, but not it."""
    diagram = found.diagram
    away = np.abs(diagram.frequency_hz / mode.frequency_hz - 1)
    rows = np.flatnonzero((away > 0.003) & (away < 0.02))
    row = rows[np.argmin(np.abs(diagram.damping_ratio[rows] - mode.damping_ratio))]
    place = diagram.frequency_hz[row], diagram.damping_ratio[row]
    return PoleName(*map(float, place), "lsce", int(diagram.model_order[row]))


@pytest.mark.parametrize("by_damping", [True, False])
def test_every_mode_is_set_aside_alone_and_the_others_stay_as_they_are(split, by_damping):
    modes = split.model.modes
    for mode in modes:
        named = name(mode) if by_damping else PoleName(mode.frequency_hz)
        left = refit_modes(split, [Edit(EditKind.SET_ASIDE, named)]).model.modes
        assert [numbers(each) for each in left] == [numbers(m) for m in modes if m is not mode]
        for partner in left:
            if mode.member and partner.order == mode.order:
                assert (partner.member, partner.pair) == ("", Pair.ONE_SEEN)


def test_a_result_s_own_list_can_be_pinned(split):
    modes = split.model.modes
    again = refit_modes(split, shorthand([mode.frequency_hz for mode in modes])).model.modes
    assert [(m.order, m.member, m.pair) for m in again] == [
        (m.order, m.member, m.pair) for m in modes
    ]
    for mode, pinned in zip(modes, again, strict=True):
        away = abs(mode.frequency_hz - pinned.frequency_hz)
        assert away < 1e-6 * mode.frequency_std_hz
        assert pinned.chosen is Chosen.KEPT


def test_the_report_of_an_order_says_that_its_other_member_was_set_aside(found):
    member = next(mode for mode in found.model.modes if mode.member == "b")
    left = refit_modes(found, [edit(EditKind.SET_ASIDE, member)]).model
    verdict = next(each.pair.verdict for each in left.orders if each.order == member.order)
    assert verdict is Pair.ONE_SEEN
    both = [mode for mode in found.model.modes if mode.order == member.order]
    left = refit_modes(found, [edit(EditKind.SET_ASIDE, mode) for mode in both]).model
    assert member.order not in {each.order for each in left.orders}


def test_a_name_between_two_members_is_refused_with_both(found):
    lower, upper = (m for m in found.model.modes if m.order == 7)
    between = PoleName((lower.frequency_hz + upper.frequency_hz) / 2)
    with pytest.raises(FitError) as refused:
        refit_modes(found, [Edit(EditKind.NOTE), Edit(EditKind.SET_ASIDE, between)])
    for text in ("edit 2", f"{lower.frequency_hz:.2f} Hz", f"{upper.frequency_hz:.2f} Hz"):
        assert text in str(refused.value)


@pytest.mark.parametrize("kind", [EditKind.SET_ASIDE, EditKind.START, EditKind.LOCK])
def test_a_name_of_nothing_is_refused(found, kind):
    with pytest.raises(FitError, match="no mode within 1 %"):
        refit_modes(found, [Edit(kind, PoleName(110.0))])


def test_nothing_left_is_refused(found):
    with pytest.raises(FitError, match="no mode is left"):
        refit_modes(found, [Edit(EditKind.ONLY_KEPT)])


def test_two_names_for_one_mode_are_refused(found, single):
    hz = single.frequency_hz
    with pytest.raises(FitError, match="edit 1 means the same mode"):
        refit_modes(found, shorthand([hz, hz * 1.001]))


def test_of_two_decisions_on_a_mode_the_last_one_counts(found, single):
    keep, aside = edit(EditKind.KEEP, single), edit(EditKind.SET_ASIDE, single)
    for edits, listed in ((keep, aside), False), ((aside, keep), True):
        model = refit_modes(found, edits).model
        assert (single.order in {mode.order for mode in model.modes}) is listed
        assert any("Edit 2 overrules edit 1" in note for note in model.notes)


def test_a_pick_beside_the_one_mode_of_an_order_gives_it_two_members(found, single):
    picked = refit_modes(found, [Edit(EditKind.PICK, beside(found, single))])
    members = [mode for mode in picked.model.modes if mode.order == single.order]
    assert [mode.member for mode in members] == ["a", "b"]
    assert sorted(mode.chosen for mode in members) == [Chosen.AUTOMATIC, Chosen.PICKED]
    now, before = (
        [mode for mode in each.model.modes if mode.order != single.order]
        for each in (picked, found)
    )
    for mode, other in zip(now, before, strict=True):
        assert abs(mode.frequency_hz - other.frequency_hz) < other.frequency_std_hz


def test_a_pick_of_a_mode_that_is_there_keeps_it(found, single):
    row = int(np.argmin(np.abs(found.diagram.poles - single.pole)))
    order = int(found.diagram.model_order[row])
    place = found.diagram.frequency_hz[row], found.diagram.damping_ratio[row]
    kept = refit_modes(found, [Edit(EditKind.PICK, PoleName(*map(float, place), None, order))])
    assert len(kept.model.modes) == len(found.model.modes)


def test_a_pole_picked_where_there_is_no_mode_is_fitted_and_listed():
    """A weak mode beside the ring, whose column is not kept."""
    frf = systems.campaign_frf(truth_modes(), 34, seed=3)
    weak = systems.pole(134.0, 0.01)
    wave = 0.01 * systems.residue(np.array([weak])) * np.cos(np.deg2rad(9 * frf.position_deg))
    added = systems.inertance(frf.frequency_hz, np.array([weak]), wave[:, None])
    frf = replace(frf, values=frf.values + added)
    diagram = identify_modes(frf, BAND_HZ).diagram
    kept = [replace(c, kept=c.kept and abs(c.frequency_hz - 134) > 2) for c in diagram.clusters]
    with pytest.MonkeyPatch.context() as patch:
        shown = replace(diagram, clusters=tuple(kept))
        patch.setattr("ema.automatic.build_stability", lambda *_, **__: shown)
        without = identify_modes(frf, BAND_HZ)
        edits = [Edit(EditKind.PICK, PoleName(134.0, 0.01))]
        again = identify_modes(frf, BAND_HZ, edits=edits)
    assert len(again.model.modes) == len(without.model.modes) + 1
    picked = next(mode for mode in again.model.modes if mode.chosen is Chosen.PICKED)
    assert picked.order == 9
    assert abs(picked.frequency_hz - 134) < 4 * picked.frequency_std_hz < 0.1
    live = refit_modes(without, edits, live=True)
    assert live.is_preview
    assert state(refit_modes(live, edits)) == state(again)
    alone = refit_modes(again, [*edits, edit(EditKind.SET_ASIDE, picked)]).model
    assert len(alone.modes) == len(without.model.modes)


def test_switches_do_one_thing_each(found):
    members = [mode for mode in found.model.modes if mode.member]
    plain = refit_modes(found, [Edit(EditKind.NO_PARTNERS)]).model
    assert len(plain.modes) == len(found.model.modes) - len(members) // 2
    assert {mode.member for mode in plain.modes} == {""}
    only = [Edit(EditKind.ONLY_KEPT), edit(EditKind.KEEP, members[0])]
    assert [numbers(m) for m in refit_modes(found, only).model.modes] == [numbers(members[0])]


def test_a_lock_leaves_the_error_bars_of_all_modes():
    """What an unknown window leaves open was taken from other modes and added to the locked one."""
    truth = [
        mode for mode in truth_modes(split_percent=2.0) if (mode.order, mode.member) != (3, "b")
    ]
    found = identify_modes(systems.campaign_frf(truth, 40, seed=3), (60.0, 160.0))
    alone = next(mode for mode in found.model.modes if mode.order == 3)
    locked = refit_modes(found, [Edit(EditKind.LOCK, name(alone))])
    before, after = ([m.damping_std for m in each.model.modes] for each in (found, locked))
    np.testing.assert_allclose(after, before, rtol=0.02)


def test_a_locked_pole_stays_and_one_that_starts_elsewhere_comes_back(found, single):
    locked = Edit(EditKind.LOCK, name(single))
    moved = Edit(EditKind.START, PoleName(single.frequency_hz * 1.002, single.damping_ratio))

    def after(*edits):
        modes = refit_modes(found, edits, live=True).model.modes
        return next(m for m in modes if m.order == single.order and not m.member)

    assert abs(after(locked).pole / single.pole - 1) < 1e-8
    assert abs(after(moved, locked).frequency_hz / (1.002 * single.frequency_hz) - 1) < 1e-8
    assert abs(after(moved).frequency_hz - single.frequency_hz) < 0.05 * single.frequency_std_hz
    member = next(mode for mode in found.model.modes if mode.member)
    with pytest.raises(FitError, match="no_partners"):
        refit_modes(found, [edit(EditKind.LOCK, member)])


def test_a_locked_pole_is_as_well_known_as_it_was_and_the_others_do_not_depend_on_it(found, single):
    locked = edit(EditKind.LOCK, single)
    moved = Edit(EditKind.START, PoleName(single.frequency_hz * 1.002, single.damping_ratio))
    for edits, away_hz in ([locked], 0.0), ([moved, locked], 0.002 * single.frequency_hz):
        model = refit_modes(found, edits).model
        at = next(k for k, m in enumerate(model.modes) if m.order == single.order and not m.member)
        own, mode = [2 * at, 2 * at + 1], model.modes[at]
        rest = np.delete(np.arange(2 * len(model.modes)), own)
        expected = np.hypot(single.frequency_std_hz, away_hz)
        np.testing.assert_allclose(mode.frequency_std_hz, expected, rtol=1e-6)
        np.testing.assert_allclose(mode.damping_std, single.damping_std, rtol=1e-6)
        assert not np.any(model.covariance[np.ix_(rest, own)])


def test_orders_that_an_edit_does_not_touch_keep_their_pairs(found, single):
    moved = Edit(EditKind.START, PoleName(single.frequency_hz * 1.002, single.damping_ratio))
    for live in (True, False):
        after = refit_modes(found, [moved], live=live).basis.shown.curve.ring
        kept = [a is b for a, b in zip(after, found.basis.fit.curve.ring, strict=True)]
        assert sum(kept) > len(kept) / 2


def test_a_run_that_is_averaged_with_another_cannot_be_left_out_by_itself(found):
    frf = found.measured
    names = [f"{run}+run_2" if run == "run_1" and k % 4 else run for k, run in enumerate(frf.run)]
    mixed = replace(frf, run=tuple(names), forces={})
    for run in ("run_1", "run_2"):
        edits = [Edit(EditKind.NOTE, reason="first"), Edit(EditKind.RUN_OUT, run=run)]
        with pytest.raises(InputError, match=r"edit 2, run_out: .* averaged"):
            identify_modes(mixed, edits=edits)


def test_an_order_that_a_person_gives_is_the_mode_s(found, single):
    told = refit_modes(found, [edit(EditKind.ORDER_IS, single, value=11)], live=True).model
    mode = min(told.modes, key=lambda each: abs(each.pole - single.pole))
    assert (mode.order, mode.is_ring_mode) == (11, False)
    assert mode.order_purity < 0.1


def test_undone_edits_leave_nothing_and_a_replay_is_the_session(found, single):
    """Random sessions with undo; after each step the result is that of a fresh identification."""
    rng = np.random.default_rng(5)
    modes = found.model.modes
    offered = [
        *(edit(EditKind.SET_ASIDE, mode) for mode in modes),
        *(edit(EditKind.KEEP, mode) for mode in modes),
        Edit(EditKind.PICK, beside(found, single)),
        Edit(EditKind.NOTE, reason="looks odd"),
        edit(EditKind.LOCK, single),
    ]
    session, shown, seen = [], found, {(): state(found)}
    for _ in range(12):
        if session and rng.random() < 0.4:
            session.pop()
        elif len(session) < 4:
            session.append(offered[rng.integers(len(offered))])
        try:
            shown = refit_modes(shown, session)
        except FitError:  # a lock on what became a pair
            session.pop()
            continue
        key = tuple(map(repr, session))
        assert seen.setdefault(key, state(shown)) == state(shown)
    assert state(refit_modes(shown, [])) == state(found)
    fresh = identify_modes(found.measured, edits=session)
    assert state(fresh) == state(refit_modes(shown, session))
    assert fresh.automatic.frequencies_hz.tolist() == found.model.frequencies_hz.tolist()


def test_edits_of_a_result_find_the_same_modes_in_other_recordings(found):
    member = next(mode for mode in found.model.modes if mode.member == "a")
    other = systems.campaign_frf(truth_modes(split_percent=0.3), 26, seed=9)
    automatic = identify_modes(other).model.modes
    left = identify_modes(other, edits=[edit(EditKind.SET_ASIDE, member)]).model.modes
    gone = [mode for mode in automatic if mode.pole not in {each.pole for each in left}]
    assert [mode.order for mode in gone] == [member.order]


def test_live_numbers_are_marked_and_close_and_what_needs_no_fit_is_final(found, single):
    assert not refit_modes(found, [edit(EditKind.SET_ASIDE, single)], live=True).is_preview
    out = Edit(EditKind.CHANNEL_OUT, channel=ChannelName("A03", "run_2"))
    for change in (edit(EditKind.LOCK, single), out):
        live, final = (refit_modes(found, [change], live=each) for each in (True, False))
        assert (live.is_preview, final.is_preview) == (True, False)
        assert live.frf.n_positions == final.frf.n_positions
        assert state(refit_modes(live, [change])) == state(final)
    assert state(final) == state(identify_modes(found.measured, edits=[out]))


def test_a_fit_that_is_not_wanted_any_more_ends_at_its_next_step(found, single):
    asked = []

    def stop():
        asked.append(True)
        return len(asked) == 4

    with pytest.raises(SupersededError):
        refit_modes(found, [edit(EditKind.LOCK, single)], stop=stop)
    assert len(asked) == 4


def test_refits_that_overlap_do_not_change_each_other(found, single):
    edits = [[edit(EditKind.LOCK, single)], [Edit(EditKind.PICK, beside(found, single))]]
    alone = [state(refit_modes(found, each)) for each in edits]
    together, start = {}, threading.Barrier(2)

    def refit(k):
        start.wait(30)
        together[k] = state(refit_modes(found, edits[k]))

    with threadpool_limits(2, user_api="blas"):
        threads = [threading.Thread(target=refit, args=(k,)) for k in (0, 1)]
        for each in threads:
            each.start()
        for each in threads:
            each.join()
    assert [together[0], together[1]] == alone


def test_an_edit_costs_what_the_frfs_say(found, single):
    weak = edit_cost(found, [Edit(EditKind.PICK, beside(found, single))])
    strong = edit_cost(found, [edit(EditKind.SET_ASIDE, single)])
    assert weak.change < 0 < strong.change
    assert strong.misfit_after > strong.misfit_before
    named = {(shift.order, shift.member) for shift in strong.shifts}
    assert (single.order, "") not in named
    assert len(named) == len(found.model.modes) - 1
    assert edit_cost(found, []).change == 0


@pytest.fixture(scope="module")
def faulty():
    """One dead channel, one of wrong sign."""
    frf = systems.campaign_frf(truth_modes(), 34, seed=3)
    return systems.edited(
        systems.edited(frf, [10], values=1e-4 * frf.values[10]), [20], values=-frf.values[20]
    )


@pytest.fixture(scope="module")
def mended(faulty):
    """What is done about these channels by itself; of four orders, to be quick."""
    return identify_modes(faulty, FEW_HZ)


def rows(found, channel, run):
    """Corrections and findings of a row."""
    place = channel, run
    return (
        [each for each in found.corrections if (each.channel, each.run) == place],
        [each for each in found.findings if (each.channel, each.run) == place],
    )


def test_a_dead_channel_can_be_brought_back(mended):
    place = mended.measured.channel[10], mended.measured.run[10]
    assert rows(mended, *place)[0][0].decided is DecidedBy.AUTOMATIC
    assert mended.frf.n_positions == 71
    back = refit_modes(mended, [Edit(EditKind.CHANNEL_IN, channel=ChannelName(*place))])
    assert back.frf.n_positions == 72
    (made,), told = rows(back, *place)
    assert (made.decided, made.excluded, made.factor) == (DecidedBy.BY_HAND, False, 1.0)
    assert {each.check for each in told} >= {Check.BY_HAND, Check.DEAD}
    assert Verdict.EXCLUDED not in {each.verdict for each in told}


def test_a_channel_that_measured_nothing_is_refused(faulty):
    """As an exact zero without noise it would outweigh all others."""
    nothing = systems.edited(faulty, [10], values=0 * faulty.values[10])
    back = Edit(EditKind.CHANNEL_IN, channel=ChannelName(faulty.channel[10], faulty.run[10]))
    with pytest.raises(InputError, match="edit 1, channel_in"):
        identify_modes(nothing, edits=[back])


def test_a_channel_flipped_by_hand_stays_flipped_and_the_finding_says_by_whom(faulty):
    place = faulty.channel[30], faulty.run[30]
    edits = [Edit(EditKind.FLIP, channel=ChannelName(*place))]
    flipped = identify_modes(faulty, FEW_HZ, edits=edits)
    (made,), told = rows(flipped, *place)
    assert (made.factor, made.is_by_hand, made.excluded) == (-1.0, True, False)
    assert told[0].check is Check.BY_HAND
    row = list(zip(flipped.frf.channel, flipped.frf.run, strict=True)).index(place)
    np.testing.assert_array_equal(flipped.frf.values[row], -faulty.values[30])
    np.testing.assert_array_equal(flipped.measured.values, faulty.values)
    (other,), _ = rows(flipped, faulty.channel[20], faulty.run[20])
    assert (other.factor, other.is_by_hand) == (-1.0, False)


def test_channels_and_runs_are_left_out_and_scaled_in_their_order(mended):
    edits = [
        Edit(EditKind.RUN_OUT, run="run_3"),
        Edit(EditKind.CHANNEL_IN, channel=ChannelName("A02", "run_3")),
        Edit(EditKind.GAIN, channel=ChannelName("A05", "run_1"), value=2.0),
        Edit(EditKind.FLIP, channel=ChannelName("A05", "run_1")),
        Edit(EditKind.CHANNEL_OUT, channel=ChannelName("A07")),
    ]
    found = refit_modes(mended, edits, live=True)
    kept = list(zip(found.frf.channel, found.frf.run, strict=True))
    assert [place for place in kept if place[1] == "run_3"] == [("A02", "run_3")]
    assert "A07" not in found.frf.channel
    (made,), _ = rows(found, "A05", "run_1")
    assert made.factor == -2.0


@pytest.mark.parametrize(
    "change",
    [
        Edit(EditKind.RUN_OUT, run="run_9"),
        Edit(EditKind.CHANNEL_OUT, channel=ChannelName("B01")),
        Edit(EditKind.FLIP, channel=ChannelName("A01", "run_9")),
    ],
)
def test_what_was_not_measured_is_refused(faulty, change):
    with pytest.raises(InputError):
        identify_modes(faulty, edits=[change])


def test_all_rows_left_out_is_refused(faulty):
    runs = [Edit(EditKind.RUN_OUT, run=run) for run in faulty.run_names]
    with pytest.raises(InputError, match="all rows are left out"):
        identify_modes(faulty, edits=runs)


@pytest.mark.parametrize("kind", [EditKind.KEEP, EditKind.FLIP, EditKind.RUN_OUT])
def test_an_edit_says_what_it_acts_on(kind):
    with pytest.raises(InputError):
        Edit(kind)


def test_pins_start_the_fit_where_the_diagram_shows_no_mode():
    frf = systems.campaign_frf(truth_modes(), 34, seed=3)
    diagram = identify_modes(frf, band_hz=(60.0, 160.0)).diagram
    nothing = replace(diagram, clusters=tuple(replace(c, kept=False) for c in diagram.clusters))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ema.automatic.build_stability", lambda *_, **__: nothing)
        with pytest.raises(FitError):
            identify_modes(frf, band_hz=(60.0, 160.0))
        found = identify_modes(frf, band_hz=(60.0, 160.0), pinned_hz=[100.3, 121.4])
        assert [mode.order for mode in found.model.modes] == [2, 3]
