"""Differences between parameter sets, and the history of a tyre."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, isnan, nan, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.core.display import signed
from ema.core.errors import InputError, unknown
from model.identifiability import GIVEN, IDENTIFIED
from pipelines.compare.significance import ParameterChange, parameter_changes
from pipelines.library.library import NamedSet
from pipelines.library.version import (
    ApprovalState,
    LibraryTyre,
    Version,
    read_approvals,
    recordings,
    values_of,
)
from pipelines.results.options import UNITS_PA
from pipelines.results.parameter_set import DAMPING_NAMES, RING_NAMES, ParameterSet
from pipelines.storage.checksums import DamagedFile

PRESSURE = "inflation_pressure_pa"


@dataclass(frozen=True)
class Line:
    """A straight line, value + slope · (x − centre), with uncorrelated value and slope."""

    centre: float  # weighted mean of x
    # at the centre; the standard deviation is NaN where unknown
    value: float
    value_std: float
    slope: float
    slope_std: float
    # root of χ² per degree of freedom, by which the standard deviations are raised where it exceeds
    # 1; NaN without degrees of freedom, or where σ of a point is unknown
    scatter: float

    def at(self, x: ArrayLike) -> NDArray[np.float64]:
        """Value of the line."""
        return np.asarray(self.value + self.slope * (np.asarray(x) - self.centre))

    def std_at(self, x: ArrayLike) -> NDArray[np.float64]:
        """Standard deviation of the line's value."""
        return np.hypot(self.value_std, self.slope_std * (np.asarray(x) - self.centre))


@dataclass(frozen=True, eq=False)
class Trend:
    """One parameter over pressure: arrays of shape (n_points,), the std NaN where unknown."""

    name: str
    pressure_pa: NDArray[np.float64]
    value: NDArray[np.float64]
    std: NDArray[np.float64]
    version: tuple[int, ...]
    line: Line


@dataclass(frozen=True)
class Series:
    """Identified parameters of one tyre over pressure; notes say what was left out or changed."""

    tyre: str
    trends: tuple[Trend, ...]
    notes: tuple[str, ...]
    versions: tuple[Version, ...]  # used


def pressure_series(versions: Sequence[Version], names: Sequence[str] = ()) -> Series:
    """Parameters over pressure from versions of one tyre.

    Only identified values are used, and of several versions from the same recordings the newest.
    Default: all parameters that were identified at two pressures or more.
    """
    known = (*RING_NAMES, *DAMPING_NAMES)
    for name in names:
        if name not in known:
            raise unknown("--parameter", name, "unknown parameter", known)
    used = _independent(versions)
    found = {name: _trend(name, used) for name in names or known}
    trends = tuple(trend for trend in found.values() if trend is not None)
    missing = [name for name, trend in found.items() if trend is None]
    if not trends or (names and missing):
        pressures = sorted({each.parameters.conditions[PRESSURE] for each in used})
        bar = ", ".join(f"{pressure / UNITS_PA['bar']:g}" for pressure in pressures)
        sought = ", ".join(missing if names else []) or "any parameter"
        rule = f"a series needs {sought} identified at two different pressures"
        remedy = "Add results measured at other pressures"
        raise InputError(versions[0].tyre, f"recordings at {bar} bar", rule, remedy)
    return Series(versions[0].tyre, trends, tuple(_notes(versions, used, missing)), tuple(used))


def fit_line(x: ArrayLike, y: ArrayLike, std: ArrayLike) -> Line:
    """Straight line by least squares, weighted with 1/σ² where σ is known of all points.

    Standard deviations follow from σ, raised where the points scatter more; without σ they follow
    from the scatter about the line, and are NaN where there is none. Two different x are needed.
    """
    x, y, std = (np.asarray(each, dtype=float) for each in (x, y, std))
    weighted = bool(np.all(np.isfinite(std) & (std > 0)))
    weight = std**-2 if weighted else np.ones_like(x)
    centre = float(weight @ x / weight.sum())
    first = float(y[0])  # then equal values give a χ² of exactly 0
    fitted, covariance = np.polyfit(x - centre, y - first, 1, w=np.sqrt(weight), cov="unscaled")
    residuals = y - first - np.polyval(fitted, x - centre)
    freedom, chi_square = x.size - 2, float(weight @ residuals**2)
    scatter = sqrt(chi_square / freedom) if freedom > 0 and (weighted or chi_square > 0) else nan
    factor = max(1.0, scatter if isfinite(scatter) else 0.0) if weighted else scatter
    slope_std, value_std = (factor * np.sqrt(np.diag(covariance))).tolist()
    slope, value = fitted.tolist()
    return Line(centre, first + value, value_std, slope, slope_std, scatter if weighted else nan)


def _independent(versions: Sequence[Version]) -> list[Version]:
    """The newest version of each set of recordings, or of each file that was added."""
    taken: set[str] = set()
    kept = []
    for version in sorted(versions, key=lambda each: -each.number):
        own = recordings(version.parameters) or {version.entry.source_sha256}
        if not own & taken:
            kept.append(version)
        taken |= own
    return kept[::-1]


def _trend(name: str, versions: Sequence[Version]) -> Trend | None:
    points = [
        (version.parameters.conditions[PRESSURE], own.value, own.std, version.number)
        for version in versions
        if (own := values_of(version.parameters).get(name)) and own.how == IDENTIFIED
    ]
    if len({pressure for pressure, *_ in points}) < 2:
        return None
    points.sort(key=lambda point: (point[0], point[3]))
    pressure_pa, value = (np.array([point[i] for point in points], dtype=float) for i in (0, 1))
    std = np.array([nan if point[2] is None else point[2] for point in points])
    numbers = tuple(point[3] for point in points)
    return Trend(name, pressure_pa, value, std, numbers, fit_line(pressure_pa, value, std))


def _notes(
    versions: Sequence[Version], used: Sequence[Version], missing: Sequence[str]
) -> list[str]:
    notes = []
    left_out = [str(each.number) for each in versions if each not in used]
    if left_out:
        which = f"version{'s' * (len(left_out) > 1)} {', '.join(left_out)}"
        notes.append(f"Left out: {which}, from the same recordings as a newer version.")
    sets = [each.parameters for each in used]
    sought = {name for each in sets for name, own in values_of(each).items() if own.how != GIVEN}
    never = [name for name in missing if name in sought]
    if never:
        notes.append(f"Not identified at two pressures: {', '.join(never)}.")
    notes += [
        f"Version {each.number}: verdict {each.parameters.basis.verdict.text()}."
        for each in used
        if each.parameters.basis.verdict and each.parameters.basis.is_in_doubt
    ]
    if len({each.basis.pressure_load for each in sets}) > 1:
        notes.append("Dead and follower pressure loads are mixed: k_θ and k_r do not compare.")
    names = dict.fromkeys(name for each in sets for name in each.conditions if name != PRESSURE)
    notes += [
        f"Besides the pressure, {name} changes from version to version."
        for name in names
        if len({str(each.conditions.get(name)) for each in sets}) > 1
    ]
    return notes


@dataclass(frozen=True)
class SetDifference:
    """Differences between two parameter sets, second minus first."""

    first: NamedSet
    second: NamedSet
    changes: tuple[ParameterChange, ...]  # every parameter that both have
    # name, first and second value of each condition that differs; None where not stated
    conditions: tuple[tuple[str, Any, Any], ...]
    notes: tuple[str, ...]  # caveats
    independent: bool  # whether the sets share no recording; otherwise nothing is tested

    @property
    def largest_change(self) -> ParameterChange | None:
        """The most significant change, or the largest in percent where nothing was tested."""
        changed = [change for change in self.changes if change.difference.value]
        tested = [each for each in changed if each.is_tested and not isnan(each.difference.z)]
        if tested:
            return max(tested, key=lambda change: abs(change.difference.z))
        return max(changed, key=lambda change: abs(change.difference.percent), default=None)


def difference(first: NamedSet, second: NamedSet) -> SetDifference:
    """Compare two parameter sets.

    Identified parameters are tested together, with independent errors. The errors of sets from the
    same recordings are dependent: nothing is tested then.
    """
    one, two = first.parameters, second.parameters
    a, b = values_of(one), values_of(two)
    independent = not recordings(one) & recordings(two)
    names = dict.fromkeys((*one.conditions, *two.conditions))
    stated = [(name, one.conditions.get(name), two.conditions.get(name)) for name in names]
    notes = []
    if one.designation != two.designation:
        notes.append(f"The tyres differ: {one.designation} and {two.designation}.")
    if not independent:
        notes.append(
            "Both come from the same recordings: their errors are dependent, and no difference is "
            "tested."
        )
    for which, own, other in (("first", a, b), ("second", b, a)):
        alone = [name for name in own if name not in other]
        if alone:
            notes.append(f"Only the {which} set has {', '.join(alone)}.")
    for each in (first, second):
        if each.parameters.basis.is_in_doubt:
            notes.append(f"{each.name}: verdict {verdict_text(each.parameters)}.")
    loads = {one.basis.pressure_load, two.basis.pressure_load}
    if None not in loads and len(loads) > 1:
        notes.append(
            f"The pressure is a {one.basis.pressure_load} load in the first set and a "
            f"{two.basis.pressure_load} load in the second: k_θ and k_r are not comparable."
        )
    changes = parameter_changes(a, b, independent=independent)
    conditions = tuple(each for each in stated if each[1] != each[2])
    return SetDifference(first, second, changes, conditions, tuple(notes), independent)


def verdict_text(parameters: ParameterSet) -> str:
    """The verdict on a set; that there is none, where it was identified without."""
    if (verdict := parameters.basis.verdict) is not None:
        return verdict.text()
    identified = any(each.how == IDENTIFIED for each in parameters.ring_and_damping.values())
    return "none: tuned before there were verdicts" if identified else "none: given values"


@dataclass(frozen=True)
class HistoryLine:
    """A version, its approval, and the main change against the version before."""

    version: Version
    approval: ApprovalState
    change: str


@dataclass(frozen=True)
class TyreHistory:
    """All readable versions of a tyre, ascending, and all damage found."""

    tyre: LibraryTyre
    lines: tuple[HistoryLine, ...]
    damage: tuple[DamagedFile, ...]

    @property
    def approved(self) -> Version | None:
        """The approved version; None where there is none, or it is damaged."""
        found = [each.version for each in self.lines if each.approval is ApprovalState.APPROVED]
        return found[0] if found else None

    @property
    def pressures_bar(self) -> list[float]:
        """Inflation pressures of the versions, ascending."""
        stated = {line.version.parameters.conditions[PRESSURE] for line in self.lines}
        return sorted(pressure_pa / UNITS_PA["bar"] for pressure_pa in stated)


def history_of(tyre: LibraryTyre) -> TyreHistory:
    """History of a tyre; damage is collected, not raised."""
    versions, damage = tyre.versions()
    approvals: dict[int, ApprovalState] = {}
    try:
        approved = tyre.approved()
        ever = read_approvals(tyre.path)
    except DamagedFile as error:
        if error.where not in {each.where for each in damage}:
            damage.append(error)
    else:
        approvals = {each.version: ApprovalState.EARLIER for each in ever}
        if approved:
            approvals[approved.number] = ApprovalState.APPROVED
    changes = ["", *map(_change, versions[:-1], versions[1:])]
    lines = tuple(
        HistoryLine(version, approvals.get(version.number, ApprovalState.NEVER), change)
        for version, change in zip(versions, changes, strict=False)
    )
    return TyreHistory(tyre, lines, tuple(damage))


def _change(before: Version, after: Version) -> str:
    found = difference(NamedSet("", before.parameters), NamedSet("", after.parameters))
    parts = [f"{name} {stated(one)} → {stated(two)}" for name, one, two in found.conditions]
    change = found.largest_change
    if change is not None:
        z = change.difference.z
        tested = f" (z = {z:+.1f})" if change.is_tested and not isnan(z) else ""
        parts.append(f"{change.name} {signed(change.difference.percent, 1)} %{tested}")
    return "; ".join(parts) or "nothing"


def stated(value: Any) -> str:
    """A condition as text."""
    if value is None:
        return "not stated"
    return f"{value:.10g}" if isinstance(value, int | float) else str(value)
