"""A tyre that changes within a run or with level is noticed, one that does not is left alone."""

from dataclasses import replace

import numpy as np
import pytest
import systems

from ema.checks.steady_runs import steadiness_findings, without_changes_within_runs
from ema.core.finding import Check, Verdict
from ema.core.modes import ModalModel, Mode, OrderReport, Pair, PairVerdict, ResidualTerms
from ema.signals.steadiness import Estimate, ModeChange, Steadiness, run_steadiness, steadiness_of

POLES = systems.pole(systems.TABLE_3_HZ, systems.TABLE_3_DAMPING)
ANGLES_DEG = np.array([0.0, 30.0, 60.0, 90.0])
RESIDUES = systems.tyre_residues(ANGLES_DEG, POLES)
RATE_HZ, DURATION_S = 4000.0, 12.0


def model():
    n = ANGLES_DEG.size
    modes = [
        Mode(pole, 0.01, 1e-4, row, 1e-9 * np.ones(n), order=order)
        for order, (pole, row) in enumerate(zip(POLES, RESIDUES.T, strict=True), 1)
    ]
    return ModalModel(
        modes=tuple(modes),
        guard_modes=(),
        residual_terms=ResidualTerms(np.zeros(n), np.zeros(n)),
        band_hz=(20.0, 260.0),
        fit_band_hz=(20.0, 260.0),
        covariance=np.zeros((14, 14)),
        frac=np.ones(n),
        misfit=1.0,
        node=np.arange(1, n + 1),
        position_deg=ANGLES_DEG,
    )


FRF = systems.noise_free_frf(
    np.arange(1.0, 300.0), np.ones((4, 299), dtype=complex), position_deg=ANGLES_DEG
)


def changing(force, factor):
    """Responses of poles that are multiplied by `factor`, sample by sample (and mode by mode)."""
    step, state = 1 / RATE_HZ, np.zeros(POLES.size, dtype=complex)
    states = np.empty((force.size, POLES.size), dtype=complex)
    factor = np.broadcast_to(factor if np.ndim(factor) > 1 else factor[:, None], states.shape)
    for k in range(force.size):
        before = force[k - 1] if k else 0.0
        growth = np.exp(POLES * factor[k] * step)
        state = growth * (state + before * step / 2) + force[k] * step / 2
        states[k] = state
    poles = POLES * factor
    direct = 2 * (RESIDUES @ poles.T).real * force
    return direct + 2 * (RESIDUES @ (poles**2 * states).T).real


def run_with(force, factor, seed=0):
    found = changing(force, factor)
    found += 0.01 * found.std() * systems.white(found.shape[1], seed, len(found))
    return systems.run_of(force, found, RATE_HZ, position_deg=ANGLES_DEG)


def by_check(findings):
    return {each.check: each for each in findings}


@pytest.fixture(scope="module")
def force():
    return systems.white(int(RATE_HZ * DURATION_S), 1)


def test_a_change_within_a_run_is_measured_and_named(force):
    run = run_with(force, 1 + np.linspace(-0.005, 0.005, force.size))
    change = run_steadiness(run, FRF, model()).over_time
    assert change.value == pytest.approx(0.01, abs=max(4 * change.std, 1e-3))
    found = by_check(steadiness_findings(steadiness_of([run], FRF, model()), model()))
    assert (found[Check.WITHIN_RUN].verdict, found[Check.WITHIN_RUN].run) == (
        Verdict.WARNING,
        run.name,
    )
    assert found[Check.LEVEL_DEPENDENCE].verdict == Verdict.OK


def test_the_damping_that_a_change_adds_is_taken_off(force):
    run = run_with(force, 1 + np.linspace(-0.005, 0.005, force.size))
    plain = model()
    of_pair = PairVerdict(3, Pair.ONE_SEEN, 0.0, "")
    third = OrderReport(of_pair, plain.frequencies_hz[2], 0.01, plain.damping_ratios[2], 1e-4)
    plain = replace(plain, orders=(third,))
    changed = without_changes_within_runs(plain, steadiness_of([run], FRF, plain))
    assert changed.orders[0].damping_ratio == pytest.approx(changed.damping_ratios[2], rel=1e-6)
    assert changed.orders[0].damping_std == pytest.approx(changed.modes[2].damping_std)
    # Of one pole fitted to all lines, and to the peak alone.
    least, most = (share * 0.01**2 / (12 * plain.damping_ratios) for share in (1.0, 2.0))
    taken = plain.damping_ratios - changed.damping_ratios
    std = np.array([mode.damping_std for mode in changed.modes])
    assert np.all((taken > 0.8 * least) & (taken < 1.1 * most))
    assert np.all((std > 0.1 * taken) & (std < np.hypot(1e-4, 0.5 * taken)))
    assert np.diag(changed.covariance)[1::2] == pytest.approx(std**2 - 1e-8, rel=1e-6)
    for mine, theirs in zip(
        changed.poles_and_residues(as_measured=True), plain.poles_and_residues(), strict=True
    ):
        assert mine == pytest.approx(theirs, rel=1e-4)
    steady = run_with(force, np.ones(force.size))
    assert without_changes_within_runs(plain, steadiness_of([steady], FRF, plain)) is plain


def test_modes_that_change_by_different_amounts_are_told_apart(force):
    shares = np.linspace(0.0, 1.0, POLES.size)
    even = np.linspace(-0.005, 0.005, force.size)
    found = changing(force, 1 + even[:, None] * shares)
    run = systems.run_of(force, found, RATE_HZ, position_deg=ANGLES_DEG)
    seen = run_steadiness(run, FRF, model()).of_modes
    assert [each.value for each in seen] == pytest.approx(0.01 * shares, abs=1e-3)


def test_a_mode_that_hardly_shows_is_taken_to_change_as_the_others_do():
    plain = model()
    hz = plain.frequencies_hz
    others = tuple(ModeChange(each, 0.003, 1e-5) for each in hz[1:])
    wild = ModeChange(hz[0], 0.2, 0.1)
    change = Estimate(0.003, 1e-5, 50.0)
    changed = without_changes_within_runs(plain, [Steadiness("1", change, None, (wild, *others))])
    assert changed.damping_ratios == pytest.approx(plain.damping_ratios, rel=0.01)


def test_a_tyre_that_is_softer_at_higher_level_is_named(force):
    louder = np.arange(force.size) // int(RATE_HZ) % 2
    run = run_with(force * (1 + louder), 1 - 0.01 * louder)
    change = run_steadiness(run, FRF, model()).over_level
    assert change.value == pytest.approx(-0.01, rel=0.5)
    found = by_check(steadiness_findings(steadiness_of([run], FRF, model()), model()))
    assert found[Check.LEVEL_DEPENDENCE].verdict == Verdict.WARNING
    assert found[Check.WITHIN_RUN].verdict == Verdict.OK


def test_gain_and_sign_are_no_change(force):
    run = run_with(force, np.ones(force.size))
    other = replace(
        model(), modes=tuple(replace(m, residues=-2 * m.residues) for m in model().modes)
    )
    for each in (model(), other):
        assert all(
            f.verdict == Verdict.OK
            for f in steadiness_findings(steadiness_of([run], FRF, each), each)
        )


def test_false_alarms_are_as_rare_as_stated():
    rate_hz, n = 1000.0, 8000
    p_values = []
    for seed in range(120):
        force = systems.white(n, [seed, 1])
        found = systems.responses_to(force, rate_hz, POLES, RESIDUES)
        found += 0.02 * found.std() * systems.white(n, [seed, 2], len(found))
        run = systems.run_of(force, found, rate_hz, position_deg=ANGLES_DEG)
        seen = run_steadiness(run, FRF, model())
        p_values.append((seen.over_time.p_value, seen.over_level.p_value))
    for p in np.array(p_values).T:
        assert np.count_nonzero(p < 0.05) <= 14  # 6 expected; more than 14 once in 1000
        assert np.count_nonzero(p < 0.5) >= 40  # neither are they rarer
        assert p.min() > 1e-5


def test_a_sweep_says_nothing_about_level():
    time = np.arange(20000) / 1000.0
    force = np.sin(2 * np.pi * (10 + 14.5 * time) * time)
    found = systems.responses_to(force, 1000.0, POLES, RESIDUES)
    run = systems.run_of(force, found, 1000.0, position_deg=ANGLES_DEG)
    assert run_steadiness(run, FRF, model()).over_level is None


def test_a_run_of_other_places_or_too_short_says_nothing(force):
    run = run_with(force[:3000], np.ones(3000))
    assert run_steadiness(run, FRF, model()) is None
    elsewhere = replace(FRF, position_deg=ANGLES_DEG + 1)
    assert steadiness_findings(steadiness_of([run], elsewhere, model()), model()) == []
