"""Whether the ring describes the tyre: what speaks against a tuning, and what to leave out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from model.arguments import Array
from model.identifiability import (
    ORDER_1_STD,
    OUTLIER,
    WRONG_VALUE,
    order_1_is_tested,
    order_1_share,
)
from model.model_form import degrees_of_freedom, model_form, restarted, with_model_form
from model.parameters import RING_NAMES
from model.tuning_problem import CIRCUMFERENTIAL, MASS, RADIAL, Search, TuningProblem, plan_search
from model.verdict import Evidence, Reason, RingVerdict

_STARTS = 2  # of a tuning that another is compared with
_LEAST_P = 1e-3  # probability of χ² from which on a deviation is one of the model
_MISFIT = 4.0  # standard deviations of the model form, rms, from which no ring fits
_CLEAR = 4.0  # χ² by which this order explains the deviations better than any other: odds of 7
_MOST_LIKELY = 2  # orders named where one of them is wrong
_LEAST_SPARE = 3  # frequencies, from which on the others tell how close to a ring they are
_TELLING = (MASS, RADIAL, CIRCUMFERENTIAL)  # parameters that a tyre does not have near a limit
#: Probability of residuals so much smaller by chance with every order moved, were the residuals of
#: both rings independent; they are nearly the same, so that healthy rings stay far below.
_SHIFT_P = 0.05
_SHIFT_GAIN = 25.0  # χ² of frequencies and modal masses that decides between moved orders and these
_LEAST_ERROR = 1e-4  # relative error of a frequency below which none is compared


def judge_tuning(
    problem: TuningProblem, rim_hz: Sequence[float] = (), rim_torsion_hz: Sequence[float] = ()
) -> tuple[Search, Array, str, RingVerdict]:
    """Tune a ring, leave out what contradicts it, and judge the rest.

    Returns
    -------
    search, values, starts
        The search, its solution, and a note on its starting points.
    verdict : RingVerdict
    """
    evidence = []
    if rim_hz and 1 in problem.orders:
        problem, of_rim = _without_order_1(problem, rim_hz)
        evidence.append(of_rim)
    if rim_torsion_hz and problem.torsion_hz is not None:
        problem, of_rim = _without_torsion_on_a_rim(problem, rim_torsion_hz)
        evidence.append(of_rim)
    search = plan_search(problem)
    values, starts = search.run()
    search, values, starts, of_masses = _without_contradicting_masses(search, values, starts)
    all_orders = search, values
    # A wrong unit of the modal masses moves no order: their scale is left open.
    search, values, found = _without_wrong_value(search, values)
    if not found:
        search, values, found = _without_barely_tested(search, values)
    if of_masses and found:
        again = _with_masses_again(search, values, starts, problem, of_masses)
        search, values, starts, of_masses = again
    evidence += of_masses
    if search.problem.torsion_hz is None:
        all_orders = restarted(replace(all_orders[0].problem, torsion_hz=None), *all_orders)
    whole = replace(search.problem, masses=problem.masses, belt_width_m=None)
    for order in search.problem.left_out:
        whole = _without_order(whole, order)
    evidence += [
        *found,
        *_misfit(search, values),
        *_shifted(search, values, whole, all_orders),
        *_at_bound(search, values),
    ]
    evidence += _untested(search, values, of_order_1=any(each.order == 1 for each in evidence))
    problem = search.problem
    spare = degrees_of_freedom(search)
    verdict = RingVerdict(
        tuple(evidence),
        _chi2(search, values) if spare > 0 else None,
        max(spare, 0),
        tuple(problem.orders[problem.used].tolist()),
        tuple(problem.orders[~problem.used].tolist()),
    )
    return search, values, starts, verdict


def _untested(search: Search, values: Array, *, of_order_1: bool) -> list[Evidence]:
    """What no further order tests; order 1 where nothing is said `of_order_1` yet."""
    spare = degrees_of_freedom(search)
    if spare <= 0:
        n_orders = int(search.problem.used.sum())
        detail = f"{n_orders} frequencies for {n_orders - spare} unknowns: no test of the ring"
        return [Evidence(Reason.UNTESTED, detail)]
    if of_order_1 or order_1_is_tested(search, values):
        return []
    share = order_1_share(search, values)
    detail = (
        f"k_θ rests on order 1 alone: 1 % of order 1 moves k_θ by {share:.2g} %. Its ± allows "
        f"for {100 * ORDER_1_STD:g} %, that of the other parameters does not"
    )
    return [Evidence(Reason.ORDER_1, detail, 1)]


def _without_order_1(
    problem: TuningProblem, rim_hz: Sequence[float]
) -> tuple[TuningProblem, Evidence]:
    """Leave order 1 out where the rim moves: mass and support of the rim take both its modes."""
    own = float(problem.measured_hz[problem.orders == 1][0])
    detail = f"modes of order 1 at {_listed(own, rim_hz)} Hz: the rim or its fixture moves"
    if int(problem.used.sum()) > 2:
        problem = _without_order(problem, 1)
        detail += "; order 1 is left out"
    return problem, Evidence(Reason.RIM, detail, 1)


def _without_torsion_on_a_rim(
    problem: TuningProblem, rim_torsion_hz: Sequence[float]
) -> tuple[TuningProblem, Evidence]:
    """Leave the torsion out where the rim turns on its fixture."""
    assert problem.torsion_hz is not None
    listed = _listed(problem.torsion_hz[0], rim_torsion_hz)
    detail = f"torsions at {listed} Hz: the rim turns on its fixture; they are not used"
    return replace(problem, torsion_hz=None), Evidence(Reason.TURNING, detail)


def _listed(own_hz: float, others_hz: Sequence[float]) -> str:
    return ", ".join(f"{each:.1f}" for each in sorted((own_hz, *others_hz)))


def _without_order(problem: TuningProblem, order: int) -> TuningProblem:
    """The problem without one more order and its modal mass."""
    masses = problem.masses and problem.masses.without(order)
    return replace(problem, left_out=(*problem.left_out, order), masses=masses)


def _moved_orders(problem: TuningProblem, step: int) -> TuningProblem:
    """The problem with every order moved by `step`, those of the modal masses included."""
    masses = problem.masses and replace(problem.masses, orders=problem.masses.orders + step)
    left_out = tuple(order + step for order in problem.left_out)
    return replace(problem, orders=problem.orders + step, left_out=left_out, masses=masses)


def _chi2(search: Search, values: Array) -> float:
    problem = search.problem
    deviations = problem.relative_deviations(search.ring(values)) / problem.frequency_errors
    return float(np.sum(deviations[problem.used] ** 2))


def _without_contradicting_masses(
    search: Search, values: Array, starts: str
) -> tuple[Search, Array, str, list[Evidence]]:
    """Drop modal masses where the frequencies contradict them, however K may be."""
    masses = search.problem.masses
    if masses is None or search.problem.objective == "paper":
        return search, values, starts, []
    alone = plan_search(replace(search.problem, masses=None))
    found, _ = alone.run(_STARTS)
    rise = _cost(search, values) - _cost(alone, found)
    if scipy.special.chdtrc(masses.orders.size, max(rise, 0.0)) > _LEAST_P:
        return search, values, starts, []
    found, starts = alone.run()  # as without masses from the beginning
    compared = alone.ring(found) if search.problem.belt_width_m else search.ring(values)
    ratio = np.exp(-np.median(search.problem.mass_deviations(compared)))
    detail = f"modal masses are {ratio:.3g} times those of the ring (χ² +{rise:.0f}) and not used"
    return alone, found, starts, [Evidence(Reason.MASSES, detail)]


def _with_masses_again(
    search: Search, values: Array, starts: str, before: TuningProblem, doubt: list[Evidence]
) -> tuple[Search, Array, str, list[Evidence]]:
    """Take the modal masses back where only an order that is left out contradicted them."""
    masses = before.masses
    for order in search.problem.left_out:
        masses = masses and masses.without(order)
    whole = plan_search(replace(search.problem, masses=masses))
    again = _without_contradicting_masses(whole, *whole.run())
    return (search, values, starts, doubt) if again[-1] else again


def _without_wrong_value(search: Search, values: Array) -> tuple[Search, Array, list[Evidence]]:
    """Leave out the torsion or the one order without which the others fit.

    An order is tried with the error of a wrong one: order 1 far off is no excuse for order 2, whose
    error k_θ would absorb then. k_θ rests on order 1 and the torsion alone: where these contradict
    each other, the torsion is left out and order 1 named beside it, with that error.
    """
    problem, before = search.problem, _cost(search, values)
    if problem.objective == "paper" or before < OUTLIER**2:
        return search, values, []
    doubted: dict[int, tuple[Search, Array]] = {}
    for order in problem.orders[problem.used].tolist():
        doubted[order] = restarted(_with_doubted_order(problem, order), search, values)
    costs = {order: _cost(*found) for order, found in doubted.items()}
    best = min(costs, key=lambda order: costs[order])
    likely = [order for order, cost in costs.items() if cost - costs[best] < _CLEAR]
    if problem.torsion_hz is not None:
        alone, found = restarted(replace(problem, torsion_hz=None), search, values)
        gain, lead = before - _cost(alone, found), costs[best] - _cost(alone, found)
        if gain > OUTLIER**2 and lead > -_CLEAR:
            rival = best if lead < _CLEAR else None
            return _without_torsion(problem, alone, found, gain, rival)
    spare = degrees_of_freedom(search) + (problem.torsion_hz is not None) - len(likely)
    if spare < 1 or before - costs[best] < OUTLIER**2 or len(likely) > _MOST_LIKELY:
        return search, values, []
    changed = _without_order(problem, best)
    if len(likely) > 1:
        changed = problem
        for order in likely:
            changed = _with_doubted_order(changed, order)
    other, found = restarted(changed, *doubted[best])
    if scipy.special.chdtrc(spare, _chi2(other, found)) < _LEAST_P:
        return search, values, []
    if len(likely) > 1:
        names, error = " or ".join(map(str, likely)), f"{100 * WRONG_VALUE:g} %"
        detail = f"order {names} deviates from the ring of the others: both enter with ± {error}"
    else:
        percent = _error_percent(other, found, best)
        detail = f"order {best} deviates by {percent} % from the ring of the others: it is left out"
    return other, found, [Evidence(Reason.ORDER, detail, order) for order in likely]


def _without_barely_tested(search: Search, values: Array) -> tuple[Search, Array, list[Evidence]]:
    """Leave out order 1 or 2 where the others are closer to a ring than tyres are, and it is not.

    Of all orders they are tested least, as k_r and k_θ rest on them: only what the others leave of
    the model form may show it.
    """
    problem = search.problem
    if problem.objective == "paper" or degrees_of_freedom(search) < _LEAST_SPARE:
        return search, values, []
    for order in sorted({1, 2} & set(problem.orders[problem.used].tolist())):
        others, found = restarted(_without_order(problem, order), search, values)
        off = problem.relative_deviations(others.ring(found))[problem.orders == order][0]
        if abs(off) < OUTLIER * problem.priors.model_form_std:
            continue
        sharper = with_model_form(search, model_form(others, found).std)
        other, found, evidence = _without_wrong_value(*restarted(sharper.problem, sharper, values))
        if any(each.order == order for each in evidence):
            other = with_model_form(other, problem.priors.model_form_std)
            return *restarted(other.problem, other, found), evidence
    return search, values, []


def _without_torsion(
    problem: TuningProblem, alone: Search, found: Array, gain: float, rival: int | None
) -> tuple[Search, Array, list[Evidence]]:
    """The ring without the torsion, and with less trust in an order that may be wrong instead."""
    assert problem.torsion_hz is not None
    ratio = problem.torsion_hz[0] / max(float(problem.torsion_of(alone.ring(found))[0]), 1.0)
    detail = f"the torsion is {ratio:.3g} times that of the ring (χ² +{gain:.0f}) and not used"
    if rival is not None:
        detail += f"; order {rival} may be the wrong one"
        alone, found = restarted(_with_doubted_order(alone.problem, rival), alone, found)
    return alone, found, [Evidence(Reason.TORSION, detail, rival)]


def _with_doubted_order(problem: TuningProblem, order: int) -> TuningProblem:
    """The problem with the error of a wrong order for one."""
    own = np.zeros(problem.orders.size) if problem.relative_std is None else problem.relative_std
    return replace(problem, relative_std=np.where(problem.orders == order, WRONG_VALUE, own))


def _error_percent(search: Search, values: Array, order: int) -> str:
    """By how much a measured frequency deviates from that of the ring, percent."""
    problem = search.problem
    off = problem.relative_deviations(search.ring(values))[problem.orders == order][0]
    return f"{100 / (1 + off) - 100:+.1f}".replace("-", "−")


def _misfit(search: Search, values: Array) -> list[Evidence]:
    spare, value = degrees_of_freedom(search), _chi2(search, values)
    if spare <= 0 or scipy.special.chdtrc(spare, value) > _LEAST_P:
        return []
    worst = 100 * np.abs(search.problem.relative_deviations(search.ring(values)))
    worst = worst[search.problem.used].max()
    detail = f"χ² = {value:.3g} for {spare} degrees of freedom, largest deviation {worst:.2g} %"
    reason = Reason.MISFIT if value > _MISFIT**2 * spare else Reason.DEVIATION
    return [Evidence(reason, detail)]


def _shifted(
    search: Search, values: Array, problem: TuningProblem, all_orders: tuple[Search, Array]
) -> list[Evidence]:
    """Whether all orders moved by one fit better; `problem` still has every modal mass.

    A wrong ring may come within the model form of all frequencies. It is the worse one where the
    other leaves far smaller residuals (F test) and modal masses do not contradict, or where it
    fits modal masses that this one does not. An order left out is part of the F test: moved, it may
    belong to the ring.
    """
    spare = degrees_of_freedom(all_orders[0])
    if search.problem.objective == "paper" or spare <= 0:
        return []
    limit = scipy.special.fdtri(spare, spare, 1 - _SHIFT_P)
    own_cost, own = _cost(*restarted(problem, search, values)), _squares(*all_orders)
    rivals = []
    for step in (-1, 1):
        if problem.orders.min() + step < 1:
            continue
        alone = plan_search(_moved_orders(all_orders[0].problem, step))
        found, _ = alone.run(_STARTS)
        ratio = own / _squares(alone, found)
        gain = own_cost - _cost(*restarted(_moved_orders(problem, step), alone, found))
        if gain > _SHIFT_GAIN or (ratio > limit and gain > -_SHIFT_GAIN):
            detail = (
                f"with every order {step:+d} the residuals are {np.sqrt(ratio):.3g} times smaller "
                f"and χ² changes by {-gain:+.3g}"
            )
            return [Evidence(Reason.SHIFTED, detail.replace("-", "−"))]
        if ratio > 1 / limit and gain > -_SHIFT_GAIN:
            rivals.append(f"{step:+d}".replace("-", "−"))
    if not rivals:
        return []
    detail = f"with every order {' or '.join(rivals)} a ring fits these frequencies about as well"
    return [Evidence(Reason.NUMBERS, detail)]


def _cost(search: Search, values: Array) -> float:
    return float(np.sum(search.residual(values) ** 2))


def _squares(search: Search, values: Array) -> float:
    """Sum of squared relative deviations; not below what the frequencies' own errors leave."""
    problem = search.problem
    own = 0.0 if problem.relative_std is None else problem.relative_std[problem.used] ** 2
    deviations = problem.relative_deviations(search.ring(values))[problem.used]
    floor = degrees_of_freedom(search) * max(float(np.mean(own)), _LEAST_ERROR**2)
    return max(float(np.sum(deviations**2)), floor)


def _at_bound(search: Search, values: Array) -> list[Evidence]:
    """Bounds that say something: a belt may have hardly any bending stiffness."""
    held = zip(search.free, search.at_bound(values).tolist(), strict=True)
    names = [name for name, bound in held if bound and name in _TELLING]
    if not names:
        return []
    detail = f"{', '.join(RING_NAMES[name][1] for name in names)} ended on a limit"
    problem = search.problem
    alone = problem.torsion_hz is None and 1 in problem.orders[problem.used]
    if CIRCUMFERENTIAL in names and alone:
        return [Evidence(Reason.BOUND, f"{detail}: order 1, which decides on it, may be wrong", 1)]
    return [Evidence(Reason.BOUND, detail)]
