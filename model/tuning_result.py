"""The outcome of a tuning: a ring, and how far each of its parameters can be trusted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from model.arrays import readonly
from model.display import table, value_with_std
from model.identifiability import GIVEN, IDENTIFIED, Correlation
from model.parameters import RING_NAMES, RingParameters, _parameters, _typed
from model.sensitivity import Sensitivity

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class TuningResult:
    """A ring tuned on measured natural frequencies.

    Parameters
    ----------
    ring : RingParameters
        The tuned ring.
    std : dict of str to float
        Standard deviation of each parameter in its unit; absent where unknown.
    how : dict of str to str
        ``"given"``, ``"identified"``, ``"not identified"`` or ``"at bound"``, per parameter.
    orders : ndarray of int, shape (n_orders,)
        Circumferential orders used.
    measured_hz, model_hz : ndarray, shape (n_orders,)
        Measured natural frequencies and those of the tuned ring at Ω = 0.
    relative_std : ndarray, shape (n_orders,)
        Relative standard deviation of each frequency that `std` rests on; NaN where none is known.
    correlation : Correlation
        Of the free parameters.
    sensitivity : Sensitivity
        d ln f / d ln parameter at the solution.
    objective : str
        ``"frequency"`` or ``"paper"``.
    notes : tuple of str
        What a reader must know, in sentences.

    Examples
    --------
    >>> import ringmodal as rm
    >>> tuned = rm.tune_ring(
    ...     [1, 2, 3, 4, 5],
    ...     [78.73, 100.31, 121.40, 145.45, 170.78],
    ...     mean_radius_m=0.33,
    ...     inflation_pressure_pa=2.2e5,
    ... )
    >>> tuned.how["radial_stiffness_n_m3"], tuned.how["axial_stiffness_n_m"]
    ('identified', 'not identified')
    """

    ring: RingParameters
    std: dict[str, float]
    how: dict[str, str]
    orders: NDArray[np.int_]
    measured_hz: NDArray[np.float64]
    model_hz: NDArray[np.float64]
    relative_std: NDArray[np.float64]
    correlation: Correlation
    sensitivity: Sensitivity
    objective: str
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "orders", readonly(self.orders, int))
        for name in ("measured_hz", "model_hz", "relative_std"):
            object.__setattr__(self, name, readonly(getattr(self, name)))

    @property
    def error_percent(self) -> NDArray[np.float64]:
        """Deviation of the model from the measurement, percent of the measured frequency."""
        return 100.0 * (self.model_hz / self.measured_hz - 1.0)

    def to_frame(self) -> pd.DataFrame:
        """Table of the ring's parameters, one row for each.

        Returns
        -------
        pandas.DataFrame
            ``parameter``, ``value``, ``std`` (NaN where unknown), ``unit`` (of both) and ``how``
            (given, identified, not identified or at bound).

        Examples
        --------
        >>> import model
        >>> ring = model.tune_ring(
        ...     [2, 3, 4, 5, 6, 7],
        ...     [106.5, 130.0, 152.5, 177.0, 206.0, 240.0],
        ...     mean_radius_m=0.33,
        ...     inflation_pressure_pa=2.2e5,
        ... )
        >>> table = ring.to_frame().set_index("parameter")
        >>> table.loc["mean_radius_m", ["unit", "how"]].to_list()
        ['m', 'given']
        """
        # Half a second to load, for tables alone.
        import pandas as pd  # takes 0.3 s, longer than a tuning: only those who want tables wait

        parameters = _parameters(self.ring)
        keys = [key for key, *_ in parameters]
        return pd.DataFrame(
            {
                "parameter": keys,
                "value": [value for *_, value, _ in parameters],
                "std": np.array([self.std.get(key, np.nan) for key in keys], dtype=float),
                "unit": [unit for *_, unit in parameters],
                "how": [self.how.get(key, GIVEN) for key in keys],
            }
        )

    def __repr__(self) -> str:
        return tuning_line(self)

    def _repr_html_(self) -> str:
        return tuning_html(self)


def tuning_line(tuning: TuningResult) -> str:
    """Orders, largest deviation and what was identified."""
    identified = [RING_NAMES[name][1] for name, how in tuning.how.items() if how == IDENTIFIED]
    orders = ", ".join(str(order) for order in tuning.orders)
    worst = float(np.max(np.abs(tuning.error_percent)))
    return (
        f"<TuningResult: orders {orders}, largest deviation {worst:.2f} %, "
        f"identified {', '.join(identified) or 'nothing'}>"
    )


def tuning_html(tuning: TuningResult) -> str:
    """Every parameter with ± and how it was obtained, then the frequencies order by order."""
    rows = [
        (name, symbol, _value(tuning, key, value), unit, tuning.how.get(key, "–"))
        for key, name, symbol, value, unit in _parameters(tuning.ring)
    ]
    head = ("parameter", "symbol", "value", "unit", "how obtained")
    return table("Tuned ring", head, rows, words=(0, 1, 3, 4)) + _frequencies(tuning)


def _value(tuning: TuningResult, key: str, value: float) -> str:
    given = tuning.how.get(key) == GIVEN
    return _typed(value) if given else value_with_std(value, tuning.std.get(key))


def _frequencies(tuning: TuningResult) -> str:
    columns = zip(
        tuning.orders, tuning.measured_hz, tuning.model_hz, tuning.error_percent, strict=True
    )
    rows = [
        (str(order), f"{measured:.2f}", f"{ring:.2f}", f"{error:+.2f}".replace("-", "−"))
        for order, measured, ring, error in columns
    ]
    head = ("order n", "measured / Hz", "ring / Hz", "deviation / %")
    return table("Frequencies it was tuned to", head, rows, words=())
