"""Whether the ring describes the tyre: the verdict on a tuning, with its evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from scipy.special import chdtrc, fdtri  # scipy.stats has the same, and takes 0.5 s to load

from model.arguments import Array
from model.identifiability import degrees_of_freedom
from model.parameters import RING_NAMES
from model.tuning_prior import ModalMasses
from model.tuning_problem import CIRCUMFERENTIAL, MASS, RADIAL, Search, TuningProblem, plan_search


class State(StrEnum):
    """How far a tuned ring may be relied upon."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    BAD = "bad"


class Reason(StrEnum):
    """What speaks against the ring: the name in ``tyre.toml``, its `meaning` and its `state`."""

    meaning: str
    state: State

    def __new__(cls, name: str, meaning: str, state: State) -> Reason:
        """Make the member that equals its name."""
        member = str.__new__(cls, name)
        member._value_, member.meaning, member.state = name, meaning, state
        return member

    RIM = "rim moves", "two modes of order 1: the rim or its fixture moves", State.BAD
    TURNING = "rim turns", "two torsions: the rim turns on its fixture", State.DOUBTFUL
    SHIFTED = "orders shifted", "the ring fits better with all orders moved by one", State.BAD
    MISFIT = "misfit", "no ring has these frequencies", State.BAD
    ORDER = "order", "one order does not belong to the ring of the others", State.DOUBTFUL
    DEVIATION = "deviation", "the ring deviates more than rings do from tyres", State.DOUBTFUL
    MASSES = "modal masses", "modal masses contradict the frequencies", State.DOUBTFUL
    TORSION = "torsion", "the torsion contradicts the frequencies", State.DOUBTFUL
    UNTESTED = "untested", "no more orders than unknowns: nothing tests the ring", State.DOUBTFUL
    BOUND = "at bound", "a parameter ended on a limit", State.DOUBTFUL


@dataclass(frozen=True)
class Evidence:
    """One reason against a tuned ring.

    Parameters
    ----------
    reason : Reason
    detail : str
        What was found and the limit, in words.
    order : int or None
        Circumferential order that it is about.
    """

    reason: Reason
    detail: str
    order: int | None = None


@dataclass(frozen=True)
class RingVerdict:
    """Verdict on a tuned ring.

    Parameters
    ----------
    evidence : tuple of Evidence
        What speaks against the ring; empty where nothing does.
    chi2 : float or None
        Sum of squared deviations of the frequencies over their own variance and that of the model
        form; None where it has no degrees of freedom.
    degrees_of_freedom : int
        Number of frequencies less the free parameters they determine.
    orders_used, orders_left_out : tuple of int
        Circumferential orders that the ring was tuned on, and measured ones it was not.
    """

    evidence: tuple[Evidence, ...]
    chi2: float | None
    degrees_of_freedom: int
    orders_used: tuple[int, ...]
    orders_left_out: tuple[int, ...] = ()

    @property
    def state(self) -> State:
        """The worst state that a piece of evidence implies."""
        states = {each.reason.state for each in self.evidence}
        return next((each for each in (State.BAD, State.DOUBTFUL) if each in states), State.GOOD)

    @property
    def is_good(self) -> bool:
        """Whether nothing speaks against the ring."""
        return not self.evidence

    def text(self) -> str:
        """The verdict in a sentence."""
        return f"{self.state}: " + (
            "; ".join(e.detail for e in self.evidence) or "nothing doubtful"
        )


_MASSES, _TORSION = "masses", "torsion_hz"  # fields of a tuning problem
_STARTS = 2  # of a tuning that another is compared with
_LEAST_P = 1e-3  # probability of χ² from which on a deviation is one of the model
_MISFIT = 4.0  # standard deviations of the model form, rms, from which no ring fits
_OUTLIER = 4.0  # the same for one order against the ring of the others
_TELLING = (MASS, RADIAL, CIRCUMFERENTIAL)  # parameters that a tyre does not have near a limit
_SHIFT_P = 0.01  # probability of residuals so much smaller by chance with every order moved
_SHIFT_GAIN = 25.0  # χ² by which moved orders must fit frequencies and modal masses better
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
        listed = _listed(problem.torsion_hz[0], rim_torsion_hz)
        problem = replace(problem, torsion_hz=None)
        detail = f"torsions at {listed} Hz: the rim turns on its fixture; they are not used"
        evidence.append(Evidence(Reason.TURNING, detail))
    search = plan_search(problem)
    values, starts = search.run()
    for known in (_MASSES, _TORSION):
        search, values, found = _without_contradiction(search, values, known)
        evidence += found
    all_orders = search, values
    # A wrong unit of the modal masses moves no order: their scale is left open.
    whole = replace(problem, torsion_hz=search.problem.torsion_hz, belt_width_m=None)
    search, values, found = _without_wrong_order(search, values)
    for each in found:
        whole = _without_order(whole, each.order or 0)
    evidence += [
        *found,
        *_misfit(search, values),
        *_shifted(search, values, whole, all_orders),
        *_at_bound(search, values),
    ]
    problem = search.problem
    spare = degrees_of_freedom(search)
    if spare <= 0:
        n_orders = int(problem.used.sum())
        detail = f"{n_orders} frequencies for {n_orders - spare} unknowns: no test of the ring"
        evidence.append(Evidence(Reason.UNTESTED, detail))
    verdict = RingVerdict(
        tuple(evidence),
        _chi2(search, values) if spare > 0 else None,
        max(spare, 0),
        tuple(problem.orders[problem.used].tolist()),
        tuple(problem.orders[~problem.used].tolist()),
    )
    return search, values, starts, verdict


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


def _listed(own_hz: float, others_hz: Sequence[float]) -> str:
    return ", ".join(f"{each:.1f}" for each in sorted((own_hz, *others_hz)))


def _without_order(problem: TuningProblem, order: int) -> TuningProblem:
    """The problem without one more order and its modal mass."""
    masses = problem.masses
    if masses is not None:
        kept = masses.orders != order
        masses = ModalMasses(masses.orders[kept], masses.mass_kg[kept], masses.relative_std[kept])
    return replace(problem, left_out=(*problem.left_out, order), masses=masses)


def _moved_orders(problem: TuningProblem, step: int) -> TuningProblem:
    """The problem with every order moved by `step`, those of the modal masses included."""
    masses = problem.masses
    if masses is not None:
        masses = replace(masses, orders=masses.orders + step)
    left_out = tuple(order + step for order in problem.left_out)
    return replace(problem, orders=problem.orders + step, left_out=left_out, masses=masses)


def _chi2(search: Search, values: Array) -> float:
    problem = search.problem
    deviations = problem.relative_deviations(search.ring(values)) / problem.frequency_errors
    return float(np.sum(deviations[problem.used] ** 2))


def _without_contradiction(
    search: Search, values: Array, known: str
) -> tuple[Search, Array, list[Evidence]]:
    """Drop modal masses or the torsion where the frequencies contradict them, however K may be."""
    problem = search.problem
    if getattr(problem, known) is None or problem.objective == "paper":
        return search, values, []
    of_torsion = known == _TORSION
    changed = replace(problem, torsion_hz=None) if of_torsion else replace(problem, masses=None)
    alone = plan_search(changed)
    found, _ = alone.run(_STARTS)
    rise = _cost(search, values) - _cost(alone, found)
    n_data = 1 if problem.masses is None or of_torsion else problem.masses.orders.size
    if chdtrc(n_data, max(rise, 0.0)) > _LEAST_P:
        return search, values, []
    ring = alone.ring(found)
    if of_torsion and problem.torsion_hz is not None:
        ratio = problem.torsion_hz[0] / max(float(problem.torsion_of(ring)[0]), 1.0)
        reason, what = Reason.TORSION, f"the torsion is {ratio:.3g} times that"
    else:
        compared = ring if problem.belt_width_m else search.ring(values)
        ratio = np.exp(-np.median(problem.mass_deviations(compared)))
        reason, what = Reason.MASSES, f"modal masses are {ratio:.3g} times those"
    detail = f"{what} of the ring (χ² +{rise:.0f}) and not used"
    return alone, found, [Evidence(reason, detail)]


def _without_wrong_order(search: Search, values: Array) -> tuple[Search, Array, list[Evidence]]:
    """Leave out the one order without which the others fit; needs two spare frequencies."""
    spare, problem = degrees_of_freedom(search), search.problem
    before = _chi2(search, values)
    if spare < 2 or problem.objective == "paper" or chdtrc(spare, before) > _LEAST_P:
        return search, values, []
    tried = {}
    for order in problem.orders[problem.used].tolist():
        one_less, found = _restarted(_without_order(problem, order), search, values)
        tried[order] = one_less, found, _chi2(one_less, found)
    order, second = sorted(tried, key=lambda each: tried[each][2])[:2]
    one_less, found, after = tried[order]
    clear = before - after > _OUTLIER**2 and tried[second][2] - after > _OUTLIER**2 / 2.0
    if not clear or chdtrc(spare - 1, after) < _LEAST_P:
        return search, values, []
    off = one_less.problem.relative_deviations(one_less.ring(found))[problem.orders == order][0]
    percent = 100 / (1 + off) - 100
    detail = (
        f"order {order} deviates by {percent:+.1f} % from the ring of the others: it is left out"
    )
    return one_less, found, [Evidence(Reason.ORDER, detail.replace("-", "−"), order)]


def _misfit(search: Search, values: Array) -> list[Evidence]:
    spare, value = degrees_of_freedom(search), _chi2(search, values)
    if spare <= 0 or chdtrc(spare, value) > _LEAST_P:
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
    other leaves far smaller residuals (F test), or fits modal masses that it does not. An order
    left out is part of the F test: moved, it may belong to the ring.
    """
    spare = degrees_of_freedom(all_orders[0])
    if search.problem.objective == "paper" or spare <= 0:
        return []
    limit = fdtri(spare, spare, 1 - _SHIFT_P)
    own_cost, own = _cost(*_restarted(problem, search, values)), _squares(*all_orders)
    for step in (-1, 1):
        if problem.orders.min() + step < 1:
            continue
        alone = plan_search(_moved_orders(all_orders[0].problem, step))
        found, _ = alone.run(_STARTS)
        ratio = own / _squares(alone, found)
        gain = own_cost - _cost(*_restarted(_moved_orders(problem, step), alone, found))
        if ratio > limit or gain > _SHIFT_GAIN:
            detail = (
                f"with every order {step:+d} the residuals are {np.sqrt(ratio):.3g} times smaller "
                f"and χ² changes by {-gain:+.3g}"
            )
            return [Evidence(Reason.SHIFTED, detail.replace("-", "−"))]
    return []


def _restarted(problem: TuningProblem, search: Search, values: Array) -> tuple[Search, Array]:
    """Tune a similar problem from the solution of another."""
    other = plan_search(problem)
    start = dict(zip(search.free, values.tolist(), strict=True))
    near = [start.get(name, size) for name, size in zip(other.free, other.scale, strict=True)]
    return other, other.solution(np.array(near))


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
