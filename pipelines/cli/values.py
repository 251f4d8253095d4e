"""Values of options: parsed, checked, and completed by the shell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import InputError, unknown
from model.tuning_problem import PARAMETERS
from pipelines.library.library import numbers_of
from pipelines.storage.atomic import require_free_file

ESTIMATORS = ("H1", "H2", "Hv")
METHODS = ("lsce", "plscf")
OBJECTIVES = ("frequency", "paper")
WINDOWS = (  # completed by the shell; any other window of scipy is accepted as well
    *("boxcar", "hann", "hamming", "blackman", "blackmanharris", "flattop"),
    *("bartlett", "bohman", "cosine", "nuttall", "parzen", "triang", "tukey"),
)
TABLE_ENDINGS = (".csv", ".parquet")
FIGURE_ENDINGS = (".png", ".svg")
# A simulation of one line or instant takes seconds and less than 200 MB for this many values.
MOST_VALUES = 100_000
MOST_ORDERS = 2000  # as many harmonics as are ever summed


def completing(values: Sequence[str]) -> Callable[[str], list[str]]:
    """Completions of an option that takes one of some values."""
    return lambda incomplete: [value for value in values if value.startswith(incomplete)]


def choice(option: str, value: str, known: Sequence[str]) -> str:
    """The known value, in whatever case it was typed."""
    for each in known:
        if each.casefold() == value.casefold():
            return each
    raise unknown(option, value, f"it must be one of {', '.join(known)}", known)


def numbers(option: str, texts: Sequence[str] | None) -> tuple[float, ...]:
    """Numbers of a comma-separated option that may be repeated."""
    text = ",".join(texts or ())
    try:
        return tuple(float(part) for part in text.split(",") if part.strip())
    except ValueError as error:
        rule = "it must be numbers separated by commas"
        raise InputError(option, repr(text), rule, "Write e.g. 78.7,100.3") from error


def ring_parameters(option: str, texts: Sequence[str] | None) -> dict[str, float]:
    """Values of a repeated NAME=VALUE option, by the names of ring parameters."""
    given = numbers_of(option, texts or (), "mass_per_area_kg_m2=19.7")
    return {choice(option, name, PARAMETERS): number for name, number in given.items()}


def values_of(option: str, text: str, most: int = MOST_VALUES) -> NDArray[np.float64]:
    """Numbers from ``A``, ``A,B,C``, ``START:STOP`` or ``START:STOP:STEP``; at most `most`.

    A range has a step of 1 unless it gives one, and includes its end where a whole number of steps
    leads there.
    """
    try:
        parts = [float(part) for part in text.replace(":", ",").split(",")]
    except ValueError:
        parts = []
    is_range = ":" in text
    if not (parts and np.all(np.isfinite(parts))) or (is_range and ("," in text or len(parts) > 3)):
        rule = "it must be numbers separated by commas, or START:STOP:STEP"
        raise InputError(option, repr(text), rule, "Write e.g. 67.3, or 1,2,5, or 0:100:0.5")
    if not is_range:
        return np.array(parts)
    start, stop, step = (*parts, 1.0)[:3]
    if not (step > 0 and stop >= start):
        rule = "the step must be > 0 and the end must not be below the start"
        raise InputError(option, repr(text), rule, "Write e.g. 0:100:0.5")
    steps = (stop - start) / step
    if not steps < most:
        found, remedy = f"{text!r}, {steps:.3g} values", "Use a larger step or a narrower range"
        raise InputError(option, found, f"at most {most} values are accepted", remedy)
    return np.asarray(np.round(start + step * np.arange(int(steps + 1e-6) + 1), 12))


def orders_of(option: str, text: str) -> NDArray[np.int_]:
    """Whole numbers in the same notation."""
    values = values_of(option, text, MOST_ORDERS)
    whole = np.rint(values)
    if np.any(whole != values):
        rule = "circumferential orders must be whole numbers"
        raise InputError(option, repr(text), rule, "Write e.g. 1:7")
    return whole.astype(int)


def require_target(path: Path, endings: tuple[str, ...]) -> Path:
    """Refuse a file that could not be written, before anything is computed."""
    if path.suffix.lower() not in endings:
        rule = f"it must be {' or '.join(endings)}"
        raise InputError(str(path), f"the ending {path.suffix!r}", rule, "Choose another name")
    require_free_file(path, force=True)
    return path
