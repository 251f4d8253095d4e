"""The rows of a settled fit, and the list of modes that the checks and a person make of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ema.circumference.orders import label_modes, of_order
from ema.circumference.ring_modes import judged
from ema.core.drift import Drift
from ema.core.errors import FitError
from ema.core.frf import FRF
from ema.core.mac import frac
from ema.core.modes import Chosen, ModalModel, Mode, OrderReport, Pair, ResidualTerms
from ema.fitting.exponential_window import without_window
from ema.fitting.mode_pairs import RingOrder
from ema.fitting.pole_fit import PoleFit

#: A row by the pole it stands for, and which member of that one's pair it is.
Key = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Row:
    """One mode that a fit can list.

    Parameters
    ----------
    mode : Mode
        With all of its uncertainty; damping of an exponential window included.
    key : Key
        The same in all fits that go on from each other.
    in_band : bool
        Whether it can be listed at all.
    doubt : str
        Why it is not listed unless a person wants it; empty where it is.
    """

    mode: Mode
    key: Key
    in_band: bool
    doubt: str

    @property
    def is_listed(self) -> bool:
        """Whether it is listed automatically."""
        return self.in_band and not self.doubt


@dataclass(frozen=True)
class Choice:
    """What a person wants listed, and of which order.

    Parameters
    ----------
    chosen : mapping of Key to Chosen
        Rows that are listed whatever the checks say.
    aside : set of Key
        Rows that are not.
    only_chosen : bool
        Whether nothing else is listed.
    order : mapping of Key to int
    notes : tuple of str
    """

    chosen: Mapping[Key, Chosen] = field(default_factory=dict)
    aside: frozenset[Key] = frozenset()
    only_chosen: bool = False
    order: Mapping[Key, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def lists(self, row: Row) -> bool:
        """Whether a row is listed."""
        if not row.in_band or row.key in self.aside:
            return False
        return row.key in self.chosen or (row.is_listed and not self.only_chosen)


@dataclass(frozen=True, eq=False)
class Settled:
    """A fit whose poles, pairs and uncertainty are settled.

    Parameters
    ----------
    frf : FRF
        As measured or without the mass of the sensors.
    fit : PoleFit
        With one pole for each order.
    band_hz : tuple of float
    rows : tuple of Row
        Ascending in frequency, but for the members of pairs.
    covariance : ndarray, shape (2 n_rows, 2 n_rows)
        Of (frequency_hz, damping_ratio) of the rows.
    ring : tuple of RingOrder
    drift : Drift
    misfit : float
        Reduced χ²; NaN where the noise is not known.
    notes : tuple of str
    """

    frf: FRF
    fit: PoleFit
    band_hz: tuple[float, float]
    rows: tuple[Row, ...]
    covariance: NDArray[np.float64]
    ring: tuple[RingOrder, ...]
    drift: Drift
    misfit: float
    notes: tuple[str, ...]

    def listed_pole(self, row: Row) -> complex:
        """Pole of a row as a result states it, without the damping of an exponential window."""
        window = self.frf.exponential_window
        return row.mode.pole + (0.0 if window is None else window.decay_per_s)


def listed(settled: Settled, choice: Choice | None = None) -> ModalModel:
    """Modes that are listed, labelled as what is listed shows them.

    Parameters
    ----------
    settled : Settled
    choice : Choice, optional
        Automatic by default.

    Raises
    ------
    FitError
        If nothing is left.
    """
    choice = choice or Choice()
    frf, fit, rows = settled.frf, settled.fit, settled.rows
    inside = [k for k, row in enumerate(rows) if choice.lists(row)]
    if not inside:
        raise FitError("no mode is left to list. Set fewer aside, or keep another one.")
    shown = [
        replace(rows[k].mode, chosen=choice.chosen.get(rows[k].key, Chosen.AUTOMATIC))
        for k in inside
    ]
    shown = list(label_modes(shown, frf.position_deg))
    for at, k in enumerate(inside):
        if rows[k].key in choice.order:
            shown[at] = of_order(shown[at], choice.order[rows[k].key], frf.position_deg)
    reports = _reports(settled.ring, {rows[k].key for k in inside}, choice.aside)
    where = np.ravel([(2 * k, 2 * k + 1) for k in inside])
    model = ModalModel(
        modes=judged(shown, reports),
        guard_modes=tuple(row.mode for k, row in enumerate(rows) if k not in inside),
        residual_terms=ResidualTerms(fit.lower, fit.upper),
        band_hz=settled.band_hz,
        fit_band_hz=(float(fit.lines.frequency_hz[0]), float(fit.lines.frequency_hz[-1])),
        covariance=settled.covariance[np.ix_(where, where)],
        frac=np.zeros(frf.n_positions),
        misfit=settled.misfit,
        node=frf.node,
        position_deg=frf.position_deg,
        drift=settled.drift,
        orders=reports,
        notes=(*settled.notes, *_notes(rows, choice), *choice.notes),
    )
    fitted = model.synthesise(fit.lines.frequency_hz, run=frf.run)
    model = replace(model, frac=frac(fit.lines.values, fitted))
    return without_window(model, frf.exponential_window)


def _reports(
    ring: Sequence[RingOrder], shown: set[Key], aside: frozenset[Key]
) -> tuple[OrderReport, ...]:
    """Verdicts on the orders of which something is listed, or nothing was set aside by hand."""
    reports = []
    for each in ring:
        if not each.is_main:
            continue
        own = {key for key in shown | aside if key[0] == each.key}
        if own & aside and not own & shown:
            continue
        report = each.report
        if own & aside and each.is_resolved:
            pair = replace(
                report.pair,
                verdict=Pair.ONE_SEEN,
                evidence="the other member was set aside by hand",
            )
            report = replace(report, pair=pair)
        reports.append(report)
    return tuple(reports)


def _notes(rows: Sequence[Row], choice: Choice) -> list[str]:
    """What is fitted but not listed, and why."""
    rest = [row for row in rows if row.in_band and not choice.lists(row)]
    by_hand = [row for row in rest if row.is_listed]
    without = ", ".join(f"{row.mode.frequency_hz:.2f}" for row in by_hand)
    notes = [f"Left out by hand, but fitted with the rest: {without} Hz."] if without else []
    return notes + [
        f"The pole at {row.mode.frequency_hz:.1f} Hz is fitted but not listed: {row.doubt}."
        for row in rest
        if row.doubt
    ]
