"""The verdict on a result as a whole, and what a parameter set rests on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, get_args

import numpy as np

from ema.checks.sensor_mass import percent_per_gram
from ema.circumference.orders import PURE
from ema.core.display import counted, number
from ema.core.errors import InputError
from ema.core.finding import Check, Finding, Verdict
from ema.core.modes import Flag, Mode
from model.coefficients import PressureLoad
from model.identifiability import AT_BOUND, NOT_IDENTIFIED
from model.parameters import DAMPING_NAMES, RING_NAMES
from model.verdict import Reason, RingVerdict, State
from pipelines.results.result import Result

#: The state in words, and a sign that can be told without its colour.
WORDS = {State.GOOD: "Good", State.DOUBTFUL: "Usable with care", State.BAD: "Not usable as it is"}
SIGNS = {State.GOOD: "✓", State.DOUBTFUL: "!", State.BAD: "×"}
# Loss of about 4 % of the pressure, or 5 to 10 °C: the runs are of one tyre in different states.
_BAD_DRIFT_PERCENT = 1.0
_USUAL_SENSOR_G = 5.0  # a small accelerometer with wax or magnet
_HEAVY_PERCENT = 1.0  # a shift of the frequencies by that sensor, as large as that of a bad drift
# What every radial test tells; the others matter in one order, or in orders that few tests reach.
_ESSENTIAL = ("mass_per_area_kg_m2", "radial_stiffness_n_m3")
_BAD_EXCLUDED = 0.1  # share of the positions: more than one sensor in ten calls for a new test
_MOST_PLACES = 2  # that are named
_POOR_FRAC = 0.9  # median, below which the modes do not explain the FRFs
# Findings that come first among those of one state, by what they put in doubt.
_FIRST = (
    *(Check.CHANGED, Check.POSITIONS, Check.PLAUSIBILITY, Check.SAMPLING_RATE, Check.AMPLITUDE),
    *(Check.MASS, Check.DRIVE_POINT, Check.DRIFT, Check.REFERENCE, Check.GAIN, Check.WITHIN_RUN),
    *(Check.INCONSISTENT, Check.CORRECTIONS_WITHHELD),
)
SECTIONS = ("model", "verdict", "covariance", "measured")


@dataclass(frozen=True)
class Remark:
    """Something that the reader of a result should know.

    A remark whose state is good is no fault: a limit of what such a test can tell.
    """

    state: State  # what it makes of the result
    text: str  # sentences
    section: str  # anchor of the section of the report that has the details
    brief: str = ""  # in a few words, for the line


@dataclass(frozen=True)
class Overall:
    """The verdict on a result: the worst state of its remarks."""

    state: State
    line: str
    remarks: tuple[Remark, ...]  # the most important first


def judge(result: Result) -> Overall:
    """The verdict on a result as a whole."""
    found = sorted(_remarks(result), key=lambda each: -list(State).index(each.state))
    state = found[0].state if found else State.GOOD  # the worst
    limits, doubts, faults = (
        [each.brief for each in found if each.state == wanted and each.brief] for wanted in State
    )
    line = "; ".join(faults or [*doubts, *_content(result), *limits])
    return Overall(state, f"{WORDS[state]}: {line}.", tuple(found))


def orders_in_doubt(result: Result) -> bool:
    """Whether the angles of the sensors are, so that orders, shapes and ring are withheld."""
    return any(each.check == Check.POSITIONS and not each.is_ok for each in result.findings)


def ring_is_usable(result: Result) -> bool:
    """Whether ring parameters may be shown: not after a bad drift, nor with many faulty sensors."""
    doubt = orders_in_doubt(result) or drift_percent(result) > _BAD_DRIFT_PERCENT
    sound = result.tuning is not None and result.tuning.verdict.state != State.BAD
    return sound and not doubt and share_out(result) <= _BAD_EXCLUDED


def share_out(result: Result) -> float:
    """Share of the measured positions that is left out."""
    return 1 - result.frf.n_positions / result.measured.n_positions


def drift_percent(result: Result) -> float:
    """Largest change of a natural frequency between the runs."""
    model = result.modal_model
    if not (model.drift.run and model.modes):
        return 0.0
    return float(np.max(np.abs(model.drift.at(model.frequencies_hz[:, None]))))


def order_is_mixed(mode: Mode) -> bool:
    """Whether a mode's shape has so little of its order that it is withheld."""
    return mode.order is not None and mode.order_purity < PURE


def findings_by_check(result: Result) -> dict[Check, list[Finding]]:
    """Findings that are not ok, the most important checks first."""
    found: dict[Check, list[Finding]] = {}
    for each in result.findings:
        if not each.is_ok:
            found.setdefault(each.check, []).append(each)
    rank = {check: place for place, check in enumerate(_FIRST)}
    return dict(sorted(found.items(), key=lambda pair: rank.get(pair[0], len(rank))))


def in_words(findings: list[Finding]) -> str:
    """Findings of one check in a line: the last one, as the largest, and how many there are."""
    last = findings[0 if findings[0].check == Check.POSITIONS else -1]
    place = (last.run, last.channel if last.channel != last.check else "")
    where = " ".join(filter(None, place))
    text = f"{where}: {last.detail}" if where else last.detail
    return text if len(findings) == 1 else f"{text} (and {len(findings) - 1} more)"


def _content(result: Result) -> list[str]:
    """What was found, where nothing speaks against it."""
    modes, tuning = result.modal_model.modes, result.tuning
    orders = sorted({mode.order for mode in modes if mode.order is not None})
    of_orders = f" of {_runs(orders)}" if orders else ""
    parts = [f"{counted(len(modes), 'mode')}{of_orders}"]
    if tuning is not None and result.validation is not None:
        worst = np.abs(result.validation.error_percent).max()
        parts.append(f"ring model within {worst:.2g} %")
    return parts


def _runs(orders: list[int]) -> str:
    """Orders as "order 3", "orders 1 to 9" or "orders 1, 2, 4"."""
    if len(orders) == 1:
        return f"order {orders[0]}"
    closed = len(orders) > 2 and orders == list(range(orders[0], orders[-1] + 1))
    return "orders " + (f"{orders[0]} to {orders[-1]}" if closed else ", ".join(map(str, orders)))


def _remarks(result: Result) -> Iterator[Remark]:
    if not result.modal_model.modes:
        brief = "no mode was found in the band"
        yield Remark(State.BAD, "No mode was found in the band.", "stability", brief)
    yield from _of_ring(result)
    yield from _of_findings(result)
    yield from _of_modes(result)
    yield from _of_parameters(result)
    yield from _of_sensor_mass(result)


def _of_findings(result: Result) -> Iterator[Remark]:
    excluded = {(e.run, e.channel): e for e in result.findings if e.verdict == Verdict.EXCLUDED}
    checks = findings_by_check(result)
    checks.pop(Check.RING, None)  # the verdict on the ring has them
    if Check.DRIFT in checks and result.modal_model.drift.run:
        checks.pop(Check.DRIFT)
        yield _drift(result)
    for check, findings in checks.items():
        state, brief = State.DOUBTFUL, ""
        if check == Check.POSITIONS:
            state, brief = State.BAD, "the angles of the sensors are in doubt"
        # Other warnings of a channel that is left out concern nobody.
        if others := [each for each in findings if (each.run, each.channel) not in excluded]:
            text = f"{check.value.capitalize()}: {in_words(others).rstrip('.')}."
            yield Remark(state, text, "quality", brief)
    if excluded:
        yield _excluded(result, list(excluded.values()))


def _drift(result: Result) -> Remark:
    largest = drift_percent(result)
    state = State.BAD if largest > _BAD_DRIFT_PERCENT else State.DOUBTFUL
    brief = f"frequencies drift by {largest:.2g} % between the runs"
    text = f"Drift: the natural frequencies change by up to {largest:.2g} % between the runs"
    return Remark(state, f"{text}; modes are given in the state of the first.", "quality", brief)


def _excluded(result: Result, out: list[Finding]) -> Remark:
    checks = list(dict.fromkeys(each.check for each in out))
    n_measured = result.measured.n_positions
    n_out = n_measured - result.frf.n_positions
    state = State.BAD if share_out(result) > _BAD_EXCLUDED else State.DOUBTFUL
    brief = f"{n_out} of {n_measured} positions are excluded" if n_out else "excluded"
    why = ", ".join(
        f"{check} ({_places([each for each in out if each.check == check])})" for check in checks
    )
    return Remark(state, f"{brief.capitalize()}: {why}.", "quality", brief)


def _places(findings: list[Finding]) -> str:
    """Where findings are, the first of many."""
    named = [" ".join(filter(None, (each.run, each.channel))) for each in findings]
    more = len(named) - _MOST_PLACES
    return ", ".join(named[:_MOST_PLACES]) + (f" and {more} more" if more > 0 else "")


def _of_ring(result: Result) -> Iterator[Remark]:
    wanted = result.tyre is not None and result.provenance.get("options", {}).get("tune", True)
    if result.tuning is None and wanted and result.notes:
        yield Remark(State.DOUBTFUL, result.notes[-1], "parameters")  # the reason, see `tune`
    if result.tuning is None or orders_in_doubt(result):
        return
    for each in result.tuning.verdict.evidence:
        meaning, state = each.reason.meaning, each.reason.state
        brief = f"no ring parameters ({meaning})" if state == State.BAD else meaning
        yield Remark(state, f"Ring model: {meaning} ({each.detail}).", "parameters", brief)


def _of_modes(result: Result) -> Iterator[Remark]:
    model = result.modal_model
    if impure := [mode for mode in model.modes if order_is_mixed(mode)]:
        text = f"{counted(len(impure), 'mode')} of mixed order: the purity is below {PURE}."
        yield Remark(State.DOUBTFUL, text, "modes")
    doubtful = Counter(mode.status for mode in model.modes if mode.doubtful)
    for status, count in doubtful.items():
        # Air and rim have modes in the band of most tyres.
        state = State.GOOD if status == Flag.NOT_RING_MODE else State.DOUBTFUL
        yield Remark(state, f"{counted(count, 'mode')}: {status}.", "modes")
    if model.modes and np.median(model.frac) < _POOR_FRAC:
        text = f"The modes explain the FRFs poorly: median FRAC {np.median(model.frac):.2f}."
        yield Remark(State.DOUBTFUL, text, "frf")
    yield from _of_second_estimator(result)


def _of_second_estimator(result: Result) -> Iterator[Remark]:
    modes = result.modal_model.modes
    apart = [isfinite(each.mode_hz) for each in result.opinions if not each.agrees]
    disputed, further = apart.count(True), apart.count(False)
    if further >= max(len(modes), 1):
        brief = f"a second estimator finds {further} poles beside the {counted(len(modes), 'mode')}"
        yield Remark(State.BAD, f"{brief[0].upper()}{brief[1:]}.", "modes", brief)
    elif disputed:
        brief = f"a second estimator disagrees on {disputed} of {counted(len(modes), 'mode')}"
        more = f" and finds {counted(further, 'further pole')}" if further else ""
        text = f"{brief[0].upper()}{brief[1:]}{more}."
        yield Remark(State.DOUBTFUL, text, "modes", brief)
    elif further:
        beside = counted(further, "further pole")
        text = f"A second estimator contradicts no mode and finds {beside}."
        yield Remark(State.GOOD, text, "modes")


def _of_parameters(result: Result) -> Iterator[Remark]:
    tuning, damping = result.tuning, result.damping
    if tuning is None or not ring_is_usable(result):
        return
    how = tuning.how | (damping.how if damping is not None else {})
    if missing := _named(how, NOT_IDENTIFIED):
        essential = any(how[name] == NOT_IDENTIFIED for name in _ESSENTIAL)
        symbols = ", ".join(each.rpartition(" ")[2] for each in missing)
        brief = f"not identified: {symbols}"
        text = (
            f"Not identified: {', '.join(missing)}; an error of half the value cannot be ruled out."
        )
        yield Remark(State.DOUBTFUL if essential else State.GOOD, text, "parameters", brief)
    if bound := _named(how, AT_BOUND):
        text = f"At a limit of the search: {', '.join(bound)}; the value is not an optimum."
        yield Remark(State.DOUBTFUL, text, "parameters")


def _of_sensor_mass(result: Result) -> Iterator[Remark]:
    """A sensor mass that is not compensated, where a gram shifts more than the ± says."""
    runs = Counter(name for names in result.measured.run for name in names.split("+"))
    if result.sensor_mass is not None or not runs:
        return
    # FRFs that were read do not state which sensors were on the tyre together: one at least.
    sensors = (
        max(runs.values()) + (result.reference_deg is not None) if result.measured.forces else 1
    )
    shift = percent_per_gram(result.modal_model, sensors, result.excitation_deg or 0.0)
    stds = [100 * mode.frequency_std_hz / mode.frequency_hz for mode in result.modal_model.modes]
    std = float(np.median(stds)) if stds else float("nan")
    if isfinite(shift) and shift > std:
        text = (
            f"Sensor mass not compensated: each gram per sensor lowers the frequencies by "
            f"{number(shift, 1)} %, their ± is {number(std, 1)} %; state mass_kg in [sensors]."
        )
        heavy = _USUAL_SENSOR_G * shift > _HEAVY_PERCENT
        brief = "sensor mass not compensated"
        yield Remark(State.DOUBTFUL if heavy else State.GOOD, text, "modes", brief)


def _named(how: dict[str, str], wanted: str) -> list[str]:
    """Name and symbol of the parameters that were obtained in a way."""
    names = RING_NAMES | DAMPING_NAMES
    return [" ".join(names[each][:2]) for each, found in how.items() if found == wanted]


@dataclass(frozen=True)
class Covariance:
    """Covariance of the parameters of a set, SI."""

    parameters: tuple[str, ...]  # rows and columns
    values: tuple[tuple[float, ...], ...]

    def without(self, name: str) -> Covariance:
        """That of the other parameters."""
        kept = [k for k, own in enumerate(self.parameters) if own != name]
        rows = tuple(tuple(self.values[k][j] for j in kept) for k in kept)
        return Covariance(tuple(self.parameters[k] for k in kept), rows)


@dataclass(frozen=True)
class MeasuredOrder:
    """Frequency and damping of one order as measured on the fixed rim; None where unknown."""

    order: int
    frequency_hz: float
    damping_ratio: float
    frequency_std_hz: float | None = None
    damping_ratio_std: float | None = None


@dataclass(frozen=True)
class Basis:
    """What a parameter set rests on.

    Parameters
    ----------
    pressure_load : {"dead", "follower"} or None
        Pressure model that the values belong to. Values of sets that do not state one are used as
        they are: with a dead load for waves, a follower load for torsion and free wheel.
    verdict : RingVerdict or None
        None for values that no tuning gave.
    warnings : tuple of str
        Doubtful findings of the campaign, as ``check: detail``.
    covariance : Covariance or None
    measured : tuple of MeasuredOrder
    """

    pressure_load: PressureLoad | None = None
    verdict: RingVerdict | None = None
    warnings: tuple[str, ...] = ()
    covariance: Covariance | None = None
    measured: tuple[MeasuredOrder, ...] = ()

    @property
    def state(self) -> State | None:
        """State of the verdict; None where there is none."""
        return None if self.verdict is None else self.verdict.state

    @property
    def is_in_doubt(self) -> bool:
        """Whether there is a verdict and it is not good."""
        return self.verdict is not None and not self.verdict.is_good

    @property
    def on_fixed_rim(self) -> dict[int, MeasuredOrder]:
        """Measured orders that belong to the ring: not order 1 where the rim moves."""
        doubted: set[int | None] = set()
        if self.verdict is not None:
            doubted |= {*self.verdict.orders_left_out}
            doubted |= {each.order for each in self.verdict.against if each.order is not None}
            if any(each.reason is Reason.RIM for each in self.verdict.against):
                doubted.add(1)
        return {each.order: each for each in self.measured if each.order not in doubted}


def accepted_verdict(name: str, basis: Basis, *, accept_warnings: bool) -> str:
    """The verdict on a set where it is not good; `InputError` unless that is accepted."""
    if basis.verdict is None or basis.verdict.is_good:
        return ""
    if not accept_warnings:
        rule = "what is handed on needs a good verdict, or the word that it is accepted"
        remedy = "Measure again, or accept it (--accept-warnings, accept_warnings=True)"
        raise InputError(name, f"verdict {basis.verdict.text()}", rule, remedy)
    return basis.verdict.text()


def basis_records(basis: Basis) -> dict[str, dict[str, Any]]:
    """Sections of a TOML file."""
    records: dict[str, dict[str, Any]] = {}
    if basis.pressure_load is not None:
        records["model"] = {"pressure_load": basis.pressure_load}
    if (verdict := basis.verdict) is not None:
        records["verdict"] = {**verdict.record, "warnings": list(basis.warnings)}
    if (covariance := basis.covariance) is not None:
        rows = [list(row) for row in covariance.values]
        records["covariance"] = {"parameters": list(covariance.parameters), "values": rows}
    if basis.measured:
        orders = [{k: v for k, v in vars(each).items() if v is not None} for each in basis.measured]
        records["measured"] = {"orders": orders}
    return records


def basis_of(path: Path, sections: dict[str, dict[str, Any]], known: tuple[str, ...]) -> Basis:
    """Basis from the sections of a TOML file; `known` are the names of parameters."""
    load = sections["model"].get("pressure_load")
    if load not in (None, *get_args(PressureLoad)):
        where, rule = f"{path.name}, [model] pressure_load", "it must be dead or follower"
        raise InputError(where, repr(load), rule, "Correct it")
    record, covariance = sections["verdict"], sections["covariance"]
    try:
        return Basis(
            load,
            RingVerdict.of_record(record) if record else None,
            tuple(map(str, record.get("warnings", ()))),
            _covariance(covariance, known) if covariance else None,
            tuple(map(_measured, sections["measured"].get("orders", ()))),
        )
    except (KeyError, TypeError, ValueError) as error:
        where, rule = f"{path.name}, [verdict], [covariance], [measured]", "they must be as written"
        raise InputError(where, str(error), rule, "Remove the sections or tune again") from error


def _measured(record: dict[str, Any]) -> MeasuredOrder:
    if not isinstance(record, dict):
        raise TypeError(f"order {record!r} is no table")
    values = {name: float(value) for name, value in record.items() if name != "order"}
    if not all(isfinite(value) and value > 0 for value in values.values()):
        raise ValueError(f"order {record['order']} with a value that is not > 0")
    return MeasuredOrder(int(record["order"]), **values)


def _covariance(record: dict[str, Any], known: tuple[str, ...]) -> Covariance:
    names = tuple(map(str, record["parameters"]))
    values = tuple(tuple(map(float, row)) for row in record["values"])
    if not set(names) <= set(known) or [len(row) for row in values] != [len(names)] * len(names):
        raise ValueError(f"{len(values)} rows for the parameters {', '.join(names)}")
    if not all(isfinite(value) for row in values for value in row):
        raise ValueError("a covariance that is not finite")
    return Covariance(names, values)
