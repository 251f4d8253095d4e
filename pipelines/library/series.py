"""Parameters of one tyre over inflation pressure, each with a weighted straight line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, nan, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.core.errors import InputError, unknown
from model.identifiability import GIVEN, IDENTIFIED
from pipelines.library.diff import recordings, values_of
from pipelines.library.version import Version
from pipelines.results.parameter_set import DAMPING_NAMES, RING_NAMES

PRESSURE = "inflation_pressure_pa"
UNITS_PA = {"bar": 1e5, "kPa": 1e3, "Pa": 1.0, "psi": 6894.757293168}


@dataclass(frozen=True)
class Line:
    """A straight line, value + slope · (x − centre), with uncorrelated value and slope.

    Parameters
    ----------
    centre : float
        Weighted mean of x.
    value, value_std : float
        At the centre; the standard deviation is NaN where nothing tells it.
    slope, slope_std : float
    scatter : float
        Root of chi-square per degree of freedom, by which the standard deviations were raised
        where it exceeds 1; NaN where no points are left over, or σ is not known of all.
    """

    centre: float
    value: float
    value_std: float
    slope: float
    slope_std: float
    scatter: float

    def at(self, x: ArrayLike) -> NDArray[np.float64]:
        """Value of the line."""
        return np.asarray(self.value + self.slope * (np.asarray(x) - self.centre))

    def std_at(self, x: ArrayLike) -> NDArray[np.float64]:
        """Standard deviation of the line's value."""
        return np.hypot(self.value_std, self.slope_std * (np.asarray(x) - self.centre))


@dataclass(frozen=True, eq=False)
class Trend:
    """One parameter over pressure.

    Parameters
    ----------
    name : str
    pressure_pa, value, std : ndarray, shape (n_points,)
        The std is NaN where unknown.
    version : tuple of int
        Where each point comes from.
    line : Line
    """

    name: str
    pressure_pa: NDArray[np.float64]
    value: NDArray[np.float64]
    std: NDArray[np.float64]
    version: tuple[int, ...]
    line: Line


@dataclass(frozen=True)
class Series:
    """Identified parameters of one tyre over pressure.

    Parameters
    ----------
    tyre : str
    trends : tuple of Trend
    notes : tuple of str
        What was left out, and what else changed besides the pressure.
    """

    tyre: str
    trends: tuple[Trend, ...]
    notes: tuple[str, ...]


def pressure_series(versions: Sequence[Version], names: Sequence[str] = ()) -> Series:
    """Parameters over pressure.

    Only identified values count, and of several versions from the same recordings the newest.

    Parameters
    ----------
    versions : sequence of Version
        Of one tyre, at least one.
    names : sequence of str
        Parameters; default: all that were identified at two pressures or more.

    Raises
    ------
    InputError
        If there is no such parameter, or no two pressures at which it was identified.
    """
    known = (*RING_NAMES, *DAMPING_NAMES)
    for name in names:
        if name not in known:
            raise unknown("--parameter", name, "there is no such parameter", known)
    used = _independent(versions)
    found = {name: _trend(name, used) for name in names or known}
    trends = tuple(trend for trend in found.values() if trend is not None)
    missing = [name for name, trend in found.items() if trend is None]
    if not trends or (names and missing):
        raise _no_series(used, versions[0].tyre, missing if names else [])
    return Series(versions[0].tyre, trends, tuple(_notes(versions, used, missing)))


def fit_line(x: ArrayLike, y: ArrayLike, std: ArrayLike) -> Line:
    """Straight line by least squares, weighted with 1/σ² where σ is known of all points.

    Parameters
    ----------
    x, y, std : array_like, shape (n_points,)
        Two different x at least.

    Returns
    -------
    Line
        Its standard deviations follow from σ, raised where the points scatter more than that;
        without σ they follow from the scatter about the line, and are NaN without any.
    """
    x, y, std = (np.asarray(each, dtype=float) for each in (x, y, std))
    weighted = bool(np.all(np.isfinite(std) & (std > 0)))
    weight = std**-2 if weighted else np.ones_like(x)
    total = weight.sum()
    centre = float(weight @ x / total)
    spread = float(weight @ (x - centre) ** 2)
    first = float(y[0])  # equal values then leave exactly nothing, where rounding would show
    y = y - first
    mean, slope = float(weight @ y / total), float(weight @ ((x - centre) * y) / spread)
    left_over = x.size - 2
    misfit = float(weight @ (y - mean - slope * (x - centre)) ** 2)
    tells = left_over > 0 and (weighted or misfit > 0)
    scatter = sqrt(misfit / left_over) if tells else nan
    factor = max(1.0, scatter if isfinite(scatter) else 0.0) if weighted else scatter
    std_of = factor / np.sqrt([total, spread])
    shown = scatter if weighted else nan
    return Line(centre, first + mean, float(std_of[0]), slope, float(std_of[1]), shown)


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


def _no_series(used: Sequence[Version], tyre: str, missing: Sequence[str]) -> InputError:
    pressures = sorted({each.parameters.conditions[PRESSURE] for each in used})
    told = ", ".join(f"{pressure / UNITS_PA['bar']:g}" for pressure in pressures)
    what = ", ".join(missing) or "any parameter"
    return InputError(
        tyre,
        f"recordings at {told} bar",
        f"a series needs {what} identified at two different pressures",
        "Add results measured at other pressures",
    )


def _notes(
    versions: Sequence[Version], used: Sequence[Version], missing: Sequence[str]
) -> list[str]:
    notes = []
    left_out = [str(each.number) for each in versions if each not in used]
    if left_out:
        notes.append(
            f"Left out: {_counted('version', left_out)}, from recordings that a newer version has."
        )
    never = [name for name in missing if any(_is_sought(name, each) for each in used)]
    if never:
        notes.append(f"Not identified at two pressures: {', '.join(never)}.")
    for name in _changing_conditions(used):
        notes.append(f"Besides the pressure, {name} changes from version to version.")
    return notes


def _is_sought(name: str, version: Version) -> bool:
    own = values_of(version.parameters).get(name)
    return own is not None and own.how != GIVEN


def _counted(noun: str, numbers: Sequence[str]) -> str:
    return f"{noun}{'s' if len(numbers) > 1 else ''} {', '.join(numbers)}"


def _changing_conditions(used: Sequence[Version]) -> list[str]:
    names: dict[str, set[Any]] = {}
    for version in used:
        for name in version.parameters.conditions:
            names.setdefault(name, set())
    for name, seen in names.items():
        seen |= {str(version.parameters.conditions.get(name)) for version in used}
    return [name for name, seen in names.items() if name != PRESSURE and len(seen) > 1]
