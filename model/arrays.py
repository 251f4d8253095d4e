"""Read-only arrays for frozen data, and the checks every array argument passes."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import ParameterError


def readonly(values: ArrayLike, dtype: Any = float) -> NDArray[Any]:
    """Copy `values` into a new array of type `dtype` that cannot be written to."""
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def finite_array(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Take `values` as floats; refuse NaN and infinity."""
    array = np.asarray(values, dtype=float)
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
        raise ParameterError(
            "orders", f"{bad:g}", "a circumferential order is a whole number", "Round it"
        )
    return whole.astype(int)


def require_positive(name: str, values: NDArray[np.float64]) -> None:
    """Refuse values that are not greater than zero."""
    if np.any(values <= 0):
        raise ParameterError(
            name, f"{values.min():g}", "every value must be greater than zero", "Correct the value"
        )


def require_one_each(name: str, orders: NDArray[np.int_], values: NDArray[np.float64]) -> None:
    """Refuse orders that are negative or repeat, and values that are not one per order."""
    if orders.ndim != 1 or values.shape != orders.shape:
        raise ParameterError(
            name,
            f"shape {values.shape} for orders of shape {orders.shape}",
            "one value per order is needed",
            "Give two lists of the same length",
        )
    if np.any(orders < 0) or np.unique(orders).size != orders.size:
        raise ParameterError(
            "orders",
            f"{orders.tolist()}",
            "each order, zero or more, may appear once",
            "Average the two members of a pair, or pick one",
        )


def require_order_limit(highest_order: int) -> None:
    """Refuse a highest order that is not a whole number of at least one."""
    if int(highest_order) != highest_order or highest_order < 1:
        raise ParameterError(
            "highest_order", f"{highest_order}", "a whole number, one at least", "Raise it"
        )
