"""Pairs that two forces drive, with known answers: poles, directions, ±, and equal poles."""

from dataclasses import replace

import numpy as np
import pytest

import ringmodal as rm
from ema.core.edits import ChannelName, Edit, EditKind, PoleName
from ema.core.errors import InputError
from ema.core.frf import FRF
from ema.core.modes import Pair
from ema.refit import edit_cost, refit_modes
from pipelines.simulate.truth import TruthMode, modal_sum

LINES_HZ = np.arange(1, 1201) / 4
FORCES_DEG = (0.0, 13.0)
BESIDE_THE_BAND = (("a", 166.0, 9.0), ("b", 170.0, 27.0))  # of order 5
RING = ((1, 79.0, 0.03), (2, 100.0, 0.028), (3, 121.0, 0.024), (4, 145.0, 0.022))


def truth(split_percent):
    """Pairs of orders 1 to 4, each turned elsewhere; the lower member first."""
    modes = [
        TruthMode(
            order, member, hz * (1 + sign * split_percent / 200), ratio, 4.0, 17.0 * order + turn
        )
        for order, hz, ratio in RING
        for member, sign, turn in (("a", -1, 0.0), ("b", 1, 90.0 / order))
    ]
    far = [TruthMode(n, "", 145.0 + 26 * (n - 4), 0.02, 4.0, 0.0) for n in (5, 6, 7)]
    return modes, (*modes, *far)


def frf_at(force_deg, modes, *, std=1e-3, seed=0):
    angles = np.arange(0.0, 360.0, 15.0)
    system = modal_sum(modes, angles, force_deg)
    omega = 2 * np.pi * LINES_HZ
    exact = np.array([system.inertance(row, omega) for row in range(angles.size)])
    rng = np.random.default_rng([seed, int(force_deg)])
    noise = rng.standard_normal((2, *exact.shape)) * std
    values = exact + noise[0] + 1j * noise[1]
    deviation = np.full(values.shape, std)
    frf = FRF.from_arrays(LINES_HZ, values, angles_deg=angles, std=deviation)
    return replace(frf, excitation_deg=force_deg)


def identified(split_percent, **how):
    pairs, modes = truth(split_percent)
    frfs = [frf_at(angle, modes, **how) for angle in FORCES_DEG]
    return pairs, rm.identify_modes(frfs, band_hz=(60.0, 160.0))


@pytest.mark.parametrize(("split_percent", "std"), [(0.3, 1e-3), (2.5, 5e-3)])
def test_both_members_of_each_order_come_back(split_percent, std):
    pairs, found = identified(split_percent, std=std)
    members = {(mode.order, mode.member): mode for mode in found.model.modes}
    for each in pairs:
        mode = members[each.order, each.member]
        away_hz = mode.frequency_hz - each.frequency_hz
        away = mode.damping_ratio - each.damping_ratio
        assert abs(away_hz) < 2e-4 * each.frequency_hz
        assert abs(away) < 0.01 * each.damping_ratio
        assert abs(away_hz) < 4 * mode.frequency_std_hz
        assert abs(away) < 4 * mode.damping_std
        assert mode.pair is Pair.RESOLVED
    for report in found.model.orders:
        step = 180.0 / report.order
        turned = next(p for p in pairs if p.order == report.order).orientation_deg
        away = (report.antinode_deg - turned + step / 2) % step - step / 2
        assert abs(away) < 4 * report.antinode_std_deg < 0.2 * step


def test_an_order_that_one_force_resolves_leaves_the_std_of_the_others_alone():
    beyond = [TruthMode(5, m, hz, 0.02, 4.0, turn) for m, hz, turn in BESIDE_THE_BAND]
    _, modes = truth(0.3)
    modes = [*(each for each in modes if each.order != 5), *beyond]
    gains = 1 + 0.02 * np.random.default_rng(1).standard_normal((24, 1))
    frfs = [frf_at(angle, modes) for angle in FORCES_DEG]
    frfs = [replace(frf, values=gains * frf.values) for frf in frfs]
    found = rm.identify_modes(frfs, band_hz=(60.0, 160.0))
    ring = found.references[0].basis.fit.curve.ring
    assert [(each.is_resolved, each.jointly) for each in ring if each.order == 5] == [(True, False)]
    assert max(mode.frequency_std_hz / mode.frequency_hz for mode in found.model.modes) < 5e-4


def test_equal_poles_give_both_shapes():
    _, found = identified(0.0)
    angles = np.deg2rad(found.model.position_deg)
    for order, hz, ratio in RING:
        modes = [mode for mode in found.model.modes if mode.order == order]
        assert [mode.member for mode in modes] == ["a", "b"]
        plane = np.linalg.qr(np.stack([np.cos(order * angles), np.sin(order * angles)], 1))[0]
        shapes = np.linalg.qr(np.stack([mode.shape for mode in modes], 1))[0]
        assert np.linalg.svd(plane.T @ shapes, compute_uv=False).min() ** 2 > 0.999
        for mode in modes:
            assert abs(mode.frequency_hz - hz) < min(2e-4 * hz, 4 * mode.frequency_std_hz)
            assert abs(mode.damping_ratio / ratio - 1) < 0.01


@pytest.fixture(scope="module")
def two_forces():
    _, modes = truth(1.0)
    frfs = [frf_at(angle, modes) for angle in FORCES_DEG]
    return frfs, rm.identify_modes(frfs, band_hz=(60.0, 160.0))


def test_each_force_has_the_residues_of_its_own(two_forces):
    frfs, found = two_forces
    for frf, each in zip(frfs, found.references, strict=True):
        near = (frf.frequency_hz > 70) & (frf.frequency_hz < 155)
        fitted = each.model.synthesise(frf.frequency_hz[near])
        assert rm.frac(frf.values[:, near], fitted).min() > 0.999


def test_one_force_in_a_sequence_is_that_force():
    _, modes = truth(1.0)
    frf = frf_at(0.0, modes)
    alone, listed = (rm.identify_modes(each, band_hz=(60.0, 160.0)) for each in (frf, [frf]))
    assert [m.pole for m in listed.model.modes] == [m.pole for m in alone.model.modes]
    assert not listed.references


def poles_of(found):
    return [[mode.pole for mode in each.model.modes] for each in found.references]


def test_a_member_set_aside_is_missing_against_each_force(two_forces):
    _, found = two_forces
    lower = found.model.modes[2]
    aside = Edit(EditKind.SET_ASIDE, PoleName(lower.frequency_hz, lower.damping_ratio))
    again = refit_modes(found, [aside])
    before, after = poles_of(found), poles_of(again)
    assert after == [each[:2] + each[3:] for each in before]
    assert edit_cost(found, [aside]).misfit_after > 100 * found.model.misfit


def test_decisions_on_several_forces_are_replayed_to_the_bit(two_forces):
    frfs, found = two_forces
    edits = [
        Edit(EditKind.NO_PARTNERS),
        Edit(EditKind.LOCK, PoleName(121.0)),
        Edit(EditKind.SET_ASIDE, PoleName(145.5)),
    ]
    preview = refit_modes(found, edits, live=True)
    again = refit_modes(preview, edits)
    assert preview.is_preview
    assert not again.is_preview
    assert poles_of(again) == poles_of(rm.identify_modes(frfs, band_hz=(60.0, 160.0), edits=edits))
    assert [mode.order for mode in again.model.modes] == [1, 2, 3]
    assert poles_of(refit_modes(again, [])) == poles_of(found)


@pytest.mark.parametrize(("reference", "used"), [(None, [23, 23]), (2, [24, 23])])
def test_a_channel_is_left_out_against_all_forces_or_one(two_forces, reference, used):
    frfs = [replace(frf, channel=tuple(f"A{k}" for k in range(24))) for frf in two_forces[0]]
    out = Edit(EditKind.CHANNEL_OUT, channel=ChannelName("A7", reference=reference))
    found = rm.identify_modes(frfs, band_hz=(60.0, 160.0), edits=[out])
    assert [each.frf.n_positions for each in found.references] == used
    for mode, before in zip(found.model.modes, two_forces[1].model.modes, strict=True):
        assert abs(mode.frequency_hz - before.frequency_hz) < 4 * before.frequency_std_hz
    unknown = Edit(EditKind.CHANNEL_OUT, channel=ChannelName("A7", reference=3))
    with pytest.raises(InputError, match="reference = 3"):
        rm.identify_modes(frfs, band_hz=(60.0, 160.0), edits=[unknown])


def test_both_members_are_found_without_a_circle_too():
    """The same FRFs at nodes that nobody calls a circle."""
    _, modes = truth(1.0)
    frfs = [frf_at(angle, modes) for angle in FORCES_DEG]
    nodes, nowhere = np.arange(1, 25), np.full(24, np.nan)
    frfs = [replace(frf, node=nodes, position_deg=nowhere) for frf in frfs]
    found = rm.identify_modes(frfs, band_hz=(60.0, 160.0))
    assert all(mode.order is None for mode in found.model.modes)
    inside = sorted(mode.frequency_hz for mode in modes if 60.0 < mode.frequency_hz < 160.0)
    assert np.allclose(found.model.frequencies_hz, inside, rtol=2e-4)
