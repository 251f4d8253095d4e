"""Another pole estimator on the same FRFs: agreeing, missing a mode, seeing one more."""

from dataclasses import replace

import numpy as np
import pytest
import systems

from ema import identify_modes
from ema.core.modes import Mode
from ema.poles.stability import OTHER, second_opinion
from pipelines.simulate.truth import truth_modes

BAND_HZ = (40.0, 235.0)
FRF = systems.tyre_frf(snr_db=30, positions=24, frequency_hz=np.arange(1, 700) / 2)


def mode_at(frequency_hz, damping_ratio):
    pole = complex(systems.pole(frequency_hz, damping_ratio))
    return Mode(pole, 0.01, 1e-4, np.ones(24), np.zeros(24))


def opinions_on(modes, frf=FRF):
    return second_opinion(frf, modes, BAND_HZ, "plscf", 40)


TABLE_3 = [mode_at(*pair) for pair in zip(systems.TABLE_3_HZ, systems.TABLE_3_DAMPING, strict=True)]


def test_each_method_has_another():
    assert all(OTHER[OTHER[method]] == method != OTHER[method] for method in OTHER)


def test_the_other_estimator_confirms_right_modes():
    opinions = opinions_on(TABLE_3)
    assert len(opinions) == 7
    for opinion, mode in zip(opinions, TABLE_3, strict=True):
        assert opinion.agrees
        assert (opinion.method, opinion.mode_hz) == ("plscf", mode.frequency_hz)
        assert opinion.frequency_hz == pytest.approx(mode.frequency_hz, rel=5e-3)
        assert opinion.damping_ratio == pytest.approx(mode.damping_ratio, rel=0.1)


def test_a_mode_that_it_does_not_see_is_told():
    opinion = opinions_on([*TABLE_3, mode_at(60.0, 0.02)])[7]
    assert not opinion.agrees
    assert opinion.mode_hz == pytest.approx(60.0)
    assert np.isnan(opinion.frequency_hz)
    assert np.isnan(opinion.damping_ratio)


def test_a_mode_that_only_it_sees_is_told():
    opinions = opinions_on([mode for mode in TABLE_3 if abs(mode.frequency_hz - 145.45) > 1])
    assert [opinion.agrees for opinion in opinions] == [True] * 6 + [False]
    assert np.isnan(opinions[6].mode_hz)
    assert opinions[6].frequency_hz == pytest.approx(145.45, rel=5e-3)


@pytest.mark.parametrize(("shift", "factor"), [(1.008, 1.0), (1.0, 1.3)])
def test_a_mode_that_it_sees_otherwise_is_no_agreement(shift, factor):
    modes = list(TABLE_3)
    modes[3] = mode_at(145.45 * shift, 0.022 * factor)
    opinions = opinions_on(modes)
    assert [opinion.agrees for opinion in opinions] == [True] * 3 + [False] + [True] * 3
    assert opinions[3].frequency_hz == pytest.approx(145.45, rel=5e-3)


def test_one_pole_confirms_one_mode_only():
    modes = [TABLE_3[3], mode_at(145.6, 0.022)]
    opinions = opinions_on(modes)[:2]
    assert [np.isnan(opinion.frequency_hz) for opinion in opinions] == [False, True]


def test_where_it_sees_nothing_at_all_it_says_so():
    rng = np.random.default_rng(0)
    noise = rng.standard_normal((12, 700, 2)) @ [1, 1j]
    frf = systems.noise_free_frf(np.arange(1, 701) / 2, noise)
    (opinion,) = opinions_on([TABLE_3[0]], frf)
    assert np.isnan(opinion.frequency_hz)


def test_what_it_errs_in_the_modes_own_frfs_too_is_no_contradiction():
    """Pairs of 1 % at 26 dB; a mode whose damping is 30 % off is told from them."""
    frf = systems.campaign_frf(truth_modes(split_percent=1.0), 26, seed=1)
    model = identify_modes(frf, (60.0, 200.0)).model
    asked = model.band_hz, "plscf", 40

    def disputed(model, *models):
        opinions = second_opinion(frf, model.modes, *asked, models=models)
        return [k for k in range(len(model.modes)) if not opinions[k].agrees]

    assert disputed(model)
    assert not disputed(model, model)
    main = model.modes[2]
    pole = complex(main.pole.real * 1.3, main.pole.imag)
    other = replace(model, modes=(*model.modes[:2], replace(main, pole=pole), *model.modes[3:]))
    assert 2 in disputed(other, other)
