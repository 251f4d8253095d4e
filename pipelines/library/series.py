"""Parameters of a tyre over inflation pressure, with straight lines fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, nan, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.core.errors import InputError, unknown
from model.identifiability import GIVEN, IDENTIFIED
from pipelines.library.version import Version, recordings, values_of
from pipelines.results.parameter_set import DAMPING_NAMES, RING_NAMES

PRESSURE = "inflation_pressure_pa"
UNITS_PA = {"bar": 1e5, "kPa": 1e3, "Pa": 1.0, "psi": 6894.757293168}


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
    return Series(versions[0].tyre, trends, tuple(_notes(versions, used, missing)))


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
