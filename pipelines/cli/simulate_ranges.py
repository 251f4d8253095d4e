"""Numbers as options write them: one, several, or a range with both ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import InputError

# What a simulation of one line or instant keeps and a screen shows: seconds, and below 200 MB.
MOST_VALUES = 100_000
MOST_ORDERS = 2000  # as many harmonics as are ever summed


def values_of(option: str, text: str, most: int = MOST_VALUES) -> NDArray[np.float64]:
    """Numbers from ``A``, ``A,B,C``, ``START:STOP`` or ``START:STOP:STEP``.

    Parameters
    ----------
    option : str
        Name of the option, for messages.
    text : str
        What the user wrote. A range has a step of 1 unless it gives one, and holds its end where a
        whole number of steps leads there.
    most : int
        How many there may be.

    Returns
    -------
    ndarray, shape (n_values,)

    Raises
    ------
    InputError
        For anything else, for a range that runs backwards, or for more values than may be.
    """
    try:
        parts = [float(part) for part in text.replace(":", ",").split(",")]
    except ValueError as error:
        raise _not_understood(option, text) from error
    if not np.all(np.isfinite(parts)):
        raise _not_understood(option, text)
    if ":" not in text:
        return np.array(parts)
    if "," in text or len(parts) > 3:
        raise _not_understood(option, text)
    return _range(option, text, most, *(*parts, 1.0)[:3])


def orders_of(option: str, text: str) -> NDArray[np.int_]:
    """Whole numbers from the same notation.

    Raises
    ------
    InputError
        As `values_of`, and for numbers that are not whole.
    """
    values = values_of(option, text, MOST_ORDERS)
    whole = np.rint(values)
    if np.any(whole != values):
        raise InputError(
            option, repr(text), "circumferential orders are whole numbers", "Write e.g. 1:7"
        )
    return whole.astype(int)


def _range(
    option: str, text: str, most: int, start: float, stop: float, step: float
) -> NDArray[np.float64]:
    """START:STOP:STEP with both ends."""
    if not (step > 0 and stop >= start):
        raise InputError(
            option, repr(text), "a range runs upwards in steps above zero", "Write e.g. 0:100:0.5"
        )
    steps = (stop - start) / step
    if not steps < most:
        raise InputError(
            option,
            f"{text!r}, {steps:.3g} values",
            f"at most {most} values",
            "Widen the step or narrow the range",
        )
    count = int(steps + 1e-6) + 1
    return np.asarray(np.round(start + step * np.arange(count), 12))


def _not_understood(option: str, text: str) -> InputError:
    return InputError(
        option,
        repr(text),
        "it must be numbers separated by commas, or START:STOP:STEP",
        "Write e.g. 67.3, or 1,2,5, or 0:100:0.5",
    )
