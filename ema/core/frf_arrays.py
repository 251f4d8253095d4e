"""FRFs from arrays: what they must be, and their conversion to inertance."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ema.core.errors import InputError
from ema.core.numerics import constant
from ema.core.recording import DERIVATIVES
from ema.core.units import parse_ratio

_UNEVEN = 1e-3  # of a step, by which frequencies may leave even steps: four digits after rounding
_COHERENCE_LINES = 31  # dips at antiresonances do not end a band …
_GAP = 0.02  # … nor do gaps narrower than this share of the lines
# Ends of a band below this share of the median level are what filters of the analyser leave.
_FILTERED = 0.01
_FEWEST_IN_RADIANS = 8  # this many angles within 2π degrees are no tyre's


def refuse(where: str, found: str, rule: str, remedy: str) -> InputError:
    """The error for an array of FRFs."""
    return InputError(f"FRF, {where}", found, rule, remedy)


def as_numbers(name: str, values: ArrayLike, kind: type = float) -> NDArray[Any]:
    """Values as an array of numbers; NaN is refused."""
    try:
        array = np.asarray(values)
        if kind is float and np.iscomplexobj(array):
            raise TypeError("they are complex")
        array = array.astype(kind)
    except (TypeError, ValueError) as error:
        raise refuse(name, str(error), "numbers are needed", "Convert them first") from error
    if not np.all(np.isfinite(array)):
        found = f"{np.count_nonzero(~np.isfinite(array))} of {array.size} not finite"
        raise refuse(name, found, "every number must be finite", "Leave out those lines or rows")
    return array


def lines_of(frequency_hz: ArrayLike) -> NDArray[np.float64]:
    """Frequency lines, which must rise from zero or above in even steps."""
    lines = as_numbers("frequency_hz", frequency_hz)
    if lines.ndim != 1 or lines.size < 2:
        found = f"array of shape {lines.shape}"
        raise refuse("frequency_hz", found, "it must be a row of at least 2 lines", "Use ravel()")
    steps = np.diff(lines)
    step = (lines[-1] - lines[0]) / (lines.size - 1)
    if lines[0] < 0 or step <= 0 or np.max(np.abs(steps - step)) > _UNEVEN * step:
        found = f"{lines[0]:g} to {lines[-1]:g} Hz, steps of {steps.min():g} to {steps.max():g} Hz"
        rule = "lines must be ≥ 0 and rise in even steps"
        raise refuse("frequency_hz", found, rule, "Sort them, or interpolate to even steps")
    return lines


def inertances_of(
    values: ArrayLike, frequency_hz: NDArray[np.float64], unit: str
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Rows of complex inertances in SI, and the factor of each line that made them so."""
    rows = np.atleast_2d(as_numbers("values", values, complex))
    if rows.ndim != 2 or rows.shape[1] != frequency_hz.size:
        turned = rows.ndim == 2 and rows.shape[0] == frequency_hz.size
        found = f"shape {rows.shape} for {frequency_hz.size} frequencies"
        remedy = "Pass values.T" if turned else "Pass one row for each position"
        raise refuse("values", found, "it must be (n_positions, n_frequencies)", remedy)
    if not np.any(rows.imag):
        rule = "FRFs are complex; a magnitude alone has no poles"
        raise refuse("values", "real numbers only", rule, "Pass magnitude * exp(1j * phase)")
    ratio = parse_ratio(str(unit))
    if ratio is None or ratio[0].quantity not in DERIVATIVES:
        rule = "it must be motion over force"
        remedy = "Write e.g. '(m/s^2)/N', 'g/N', '(mm/s)/N' or 'mm/kN'"
        raise refuse("unit", repr(unit), rule, remedy)
    motion, force = ratio
    power = DERIVATIVES[motion.quantity]
    factor = motion.factor / force.factor * np.power(2j * np.pi * frequency_hz, power)
    return np.asarray(rows * factor), np.asarray(factor)


def places_of(
    angles_deg: ArrayLike | None, nodes: ArrayLike | None, n_rows: int
) -> tuple[NDArray[np.float64], NDArray[np.int_]]:
    """Angles and node numbers, NaN and −1 where there are none."""
    angles, numbers = np.full(n_rows, np.nan), np.full(n_rows, -1)
    if angles_deg is not None:
        angles = _one_each("angles_deg", as_numbers("angles_deg", angles_deg), n_rows)
        if n_rows >= _FEWEST_IN_RADIANS and np.ptp(angles) <= 2 * np.pi:
            found = f"{n_rows} angles from {angles.min():g} to {angles.max():g}"
            raise refuse("angles_deg", found, "angles are in degrees", "Use numpy.degrees")
        if np.unique(np.round(angles % 360, 9)).size < n_rows:
            rule = "each angle, modulo 360, may appear once"
            raise refuse("angles_deg", "an angle twice", rule, "Average these rows or drop one")
    if nodes is not None:
        given = _one_each("nodes", as_numbers("nodes", nodes), n_rows)
        numbers = np.rint(given).astype(int)
        if np.any(numbers != given) or np.unique(numbers).size < n_rows:
            rule = "node numbers must be whole and different"
            raise refuse("nodes", f"{given.tolist()[:8]}", rule, "Number the rows 1, 2, 3, …")
    elif angles_deg is None:
        numbers = np.arange(1, n_rows + 1)
    return angles, numbers


def beside(
    name: str, values: ArrayLike | None, shape: tuple[int, ...], highest: float = np.inf
) -> NDArray[np.float64]:
    """Coherence or deviations of the shape of the FRFs, between 0 and `highest`; NaN if unknown."""
    if values is None:
        return constant(np.nan, shape)
    array = np.atleast_2d(as_numbers(name, values))
    if array.shape != shape:
        rule = "it must have the shape of the values"
        raise refuse(
            name, f"shape {array.shape} for values of {shape}", rule, "Transpose or cut it"
        )
    if array.min() < 0 or array.max() > highest:
        rule = "it must be ≥ 0" + (f" and ≤ {highest:g}" if np.isfinite(highest) else "")
        raise refuse(
            name, f"{array.min():g} to {array.max():g}", rule, "Correct it or leave it out"
        )
    return array


def require_shapes(frf: Any) -> None:
    """Refuse an `FRF` whose arrays do not fit together."""
    shape = frf.values.shape
    if frf.frequency_hz.ndim != 1 or len(shape) != 2 or shape[1] != frf.frequency_hz.size:
        found = f"values of shape {shape} for frequencies of shape {frf.frequency_hz.shape}"
        rule = "values must be (n_positions, n_frequencies)"
        raise refuse("values", found, rule, "Use FRF.from_arrays")
    wanted = {"coherence": shape, "std": shape, "node": shape[:1], "position_deg": shape[:1]}
    for name, expected in wanted.items():
        if getattr(frf, name).shape != expected:
            found = f"shape {getattr(frf, name).shape} for values of {shape}"
            raise refuse(name, found, f"it must be {expected}", "Use FRF.from_arrays")
    if len(frf.run) != shape[0]:
        found = f"{len(frf.run)} names for {shape[0]} rows"
        raise refuse("run", found, "each row needs the name of its run", "Use FRF.from_arrays")


def band_of(band_hz: Any) -> tuple[float, float]:
    """A band as two rising numbers in Hz."""
    try:
        low, high = (float(end) for end in band_hz)
    except (TypeError, ValueError):
        low = high = float("nan")
    if not 0 <= low < high < np.inf:
        rule = "it must be two numbers in Hz, the lower one first"
        raise InputError("band_hz", f"{band_hz!r:.60}", rule, "Write e.g. (20, 300)")
    return low, high


def frequencies_of(name: str, values: ArrayLike) -> tuple[float, ...]:
    """Frequencies in Hz that a user gives, one or several."""
    try:
        found = np.atleast_1d(np.asarray(values, dtype=float)).ravel()
    except (TypeError, ValueError):
        found = np.zeros(0)
    if not found.size or not np.all(np.isfinite(found) & (found > 0)):
        rule = "they must be numbers > 0 in Hz"
        raise InputError(name, f"{values!r:.60}", rule, "Write e.g. [78.7, 100.3]")
    return tuple(found.tolist())


def one_angle(value: float | None) -> float:
    """The angle of the force; NaN where unknown."""
    try:
        return float("nan") if value is None else float(value)
    except (TypeError, ValueError) as error:
        rule = "it must be a number in degrees"
        raise refuse("excitation_deg", repr(value), rule, "Write 0.0, or leave it out") from error


def _one_each(name: str, array: NDArray[Any], n_rows: int) -> NDArray[Any]:
    flat = np.atleast_1d(array)
    if flat.shape != (n_rows,):
        found = f"shape {flat.shape} for {n_rows} FRFs"
        raise refuse(name, found, "one for each row of the values is needed", "Count the rows")
    return flat


def coherent_lines(
    coherence: NDArray[np.float64], levels: NDArray[np.float64], good: float
) -> NDArray[np.bool_]:
    """Lines of good coherence (where it is known), without ends that filters have taken away.

    Parameters
    ----------
    coherence, levels : ndarray, shape (n_frequencies,)
        Median coherence and RMS inertance of the positions.
    good : float
    """
    mean = np.full(_COHERENCE_LINES, 1 / _COHERENCE_LINES)
    smooth = scipy.ndimage.correlate1d(np.nan_to_num(coherence, nan=1.0), mean, mode="nearest")
    gap = 2 * int(_GAP / 2 * smooth.size) + 1
    closed = scipy.ndimage.binary_closing(np.pad(smooth >= good, gap), np.ones(gap))[gap:-gap]
    passed = levels > _FILTERED * np.median(levels)
    return np.asarray(
        closed & np.logical_or.accumulate(passed) & np.logical_or.accumulate(passed[::-1])[::-1]
    )
