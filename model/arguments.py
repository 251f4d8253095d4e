"""Arguments of the ring model: their checks, and read-only arrays for frozen data."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import ParameterError

#: Array of real numbers.
Array = NDArray[np.float64]


def readonly(values: ArrayLike, dtype: Any = float) -> NDArray[Any]:
    """Copy `values` into a new array of type `dtype` that cannot be written to."""
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


class ReadonlyArrays:
    """Base of frozen data classes: their arrays become read-only copies."""

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            if isinstance(value, np.ndarray):
                object.__setattr__(self, name, readonly(value, value.dtype))


def finite_array(name: str, values: ArrayLike) -> Array:
    """Take `values` as floats; refuse NaN and infinity."""
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        rule = "numbers are needed"
        raise ParameterError(name, f"{values!r:.60}", rule, "Pass a list of numbers") from error
    if not np.all(np.isfinite(array)):
        bad = array[~np.isfinite(array)].flat[0]
        raise ParameterError(name, f"{bad}", "every value must be finite", "Correct the value")
    return array


def whole_orders(orders: ArrayLike) -> NDArray[np.int_]:
    """Take circumferential orders as integers; refuse anything between them."""
    array = finite_array("orders", orders)
    whole = np.rint(array)
    if np.any(whole != array):
        bad = array[whole != array].flat[0]
        raise ParameterError("orders", f"{bad:g}", "orders must be whole numbers", "Round it")
    return whole.astype(int)


def measured_orders(
    name: str, orders: ArrayLike, values: ArrayLike, std_name: str, std: ArrayLike | None
) -> tuple[NDArray[np.int_], Array, Array | None]:
    """Orders, one measured value > 0 for each, and their relative standard deviations if given."""
    numbers = np.atleast_1d(whole_orders(orders))
    measured = _one_each(name, numbers, values)
    if np.any(numbers < 0) or np.unique(numbers).size != numbers.size:
        remedy = "Average the two members of a pair, or pick one"
        rule = "each order must be ≥ 0 and may appear once"
        raise ParameterError("orders", f"{numbers.tolist()}", rule, remedy)
    return numbers, measured, None if std is None else _one_each(std_name, numbers, std) / measured


def _one_each(name: str, orders: NDArray[np.int_], values: ArrayLike) -> Array:
    array = np.atleast_1d(finite_array(name, values))
    if orders.ndim != 1 or array.shape != orders.shape or not array.size:
        found = f"shape {array.shape} for orders of shape {orders.shape}"
        rule = "one value per order is needed"
        raise ParameterError(name, found, rule, "Give two lists of the same length")
    require_number(name, float(array.min()))
    return array


def require_number(name: str, value: float | None, *, zero_allowed: bool = False) -> None:
    """Refuse a value that is infinite, negative or, unless allowed, zero; None passes."""
    number = isinstance(value, int | float | np.number) and math.isfinite(value)
    if value is None or (number and (value > 0 or (zero_allowed and value == 0))):
        return
    rule = f"must be a finite number {'≥' if zero_allowed else '>'} 0"
    found = f"{value:g}" if isinstance(value, int | float) else f"{value!r:.60}"
    raise ParameterError(name, found, rule, "Check its sign and its unit")


def require_type(name: str, value: Any, kind: type) -> None:
    """Refuse an argument of another type."""
    if not isinstance(value, kind):
        rule = f"must be of type {kind.__name__}"
        raise ParameterError(name, f"{type(value).__name__} {value!r:.60}", rule, "Pass one")


def require_inputs(
    given: Mapping[str, float], start: Mapping[str, float], bounds: Mapping[str, ArrayLike]
) -> None:
    """Refuse given values and starts that are no positive numbers, and bounds that are not two."""
    for name, value in given.items():
        require_number(name, value, zero_allowed=True)
    for name, value in start.items():
        require_number(f"start of {name}", value)
    for name, ends in bounds.items():
        if np.shape(finite_array(f"bounds of {name}", ends)) != (2,):
            found, rule = f"{ends!r}", "bounds are two numbers"
            raise ParameterError(f"bounds of {name}", found, rule, "Write (2.0, 20.0)")


def require_names(where: str, names: Iterable[str], known: Collection[str]) -> None:
    """Refuse names that are not among the known ones."""
    for name in names:
        require_one_of(where, name, known)


def require_one_of(name: str, value: str, known: Collection[str]) -> None:
    """Refuse a name that is not among the known ones."""
    if value not in known:
        raise ParameterError(name, f"{value!r}", f"known: {', '.join(known)}", "Choose one of them")


def require_order_limit(highest_order: int) -> None:
    """Refuse a highest order that is not a whole number of at least one."""
    if int(highest_order) != highest_order or highest_order < 1:
        rule = "must be a whole number ≥ 1"
        raise ParameterError("highest_order", f"{highest_order}", rule, "Raise it")
