"""The rows of a settled fit, the list of modes made of them, and masses of what is listed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ema.circumference.orders import judged, label_modes, of_order
from ema.core.display import number
from ema.core.drift import Drift
from ema.core.errors import FitError
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.mac import frac
from ema.core.modes import Chosen, ModalModel, Mode, OrderReport, Pair, ResidualTerms
from ema.core.recording import ExponentialWindow
from ema.core.references import driving_point
from ema.fitting.order_pair import RingOrder
from ema.fitting.pole_fit import PoleFit
from ema.fitting.variable_projection import Complex

# Lines that a Hann window adds to a half-width, as the curve fit sees it: fitted rings of 1 to 3 %
# damping on lines 0.125 to 0.5 Hz apart give 0.95 to 1.1 (at half power it has 0.72: Harris 1978).
_HANN_LINES = 1.1
# A force drives a mode if the residue at its place is this many standard deviations.
_LEAST_DRIVE = 3.0
# No residue is known better than this.
_EXACT = 1e-6
# A force contradicts the others beyond this many of its standard deviations.
_CLEAR = 3.3
# … where it has this share of the weight of the best one: else what it sees is other modes.
_COUNTS = 0.1


def with_own_factor(frf: FRF) -> FRF:
    """FRFs with the factor s² that inertances have, in the place of (s + 1/τ)²."""
    if frf.exponential_window is None:
        return frf
    s = 2j * np.pi * frf.frequency_hz
    factor = (s / (s + frf.exponential_window.decay_per_s)) ** 2
    return replace(frf, values=frf.values * factor, std=frf.std * np.abs(factor))


def without_window(model: ModalModel, window: ExponentialWindow | None) -> ModalModel:
    """Modes with the damping of the tyre alone; modes that this leaves undamped are not listed.

    Parameters
    ----------
    model : ModalModel
        Fitted to FRFs with the window.
    window : ExponentialWindow or None

    Raises
    ------
    FitError
        If the window adds more damping than any mode has.
    """
    if window is None:
        return model
    decay = window.decay_per_s
    damped = [k for k, mode in enumerate(model.modes) if -mode.pole.real > decay]
    if not damped:
        raise FitError(
            f"all modes decay more slowly than the exponential window of "
            f"{window.time_constant_s:g} s alone. Correct exponential_window_s."
        )
    kept = np.ravel([(2 * k, 2 * k + 1) for k in damped])
    modes = [_compensated(model.modes[k], decay) for k in damped]
    covariance = model.covariance[np.ix_(kept, kept)] + _of_window(modes, window)
    std = np.sqrt(np.diag(covariance)).reshape(-1, 2)
    undamped = [mode for k, mode in enumerate(model.modes) if k not in damped]
    return replace(
        model,
        modes=tuple(
            replace(mode, frequency_std_hz=float(f), damping_std=float(ratio))
            for mode, (f, ratio) in zip(modes, std, strict=True)
        ),
        guard_modes=tuple(_compensated(mode, decay) for mode in (*undamped, *model.guard_modes)),
        covariance=covariance,
        orders=tuple(_compensated_order(each, window) for each in model.orders),
        exponential_window=window,
        notes=(*model.notes, _note(modes, window), *map(_not_listed, undamped)),
    )


def _compensated(mode: Mode, decay_per_s: float) -> Mode:
    return replace(mode, pole=mode.pole + decay_per_s)


def _of_window(modes: list[Mode], window: ExponentialWindow) -> NDArray[np.float64]:
    """Covariance of (frequency_hz, damping_ratio) from that of τ, which all modes share."""
    poles = np.array([mode.pole for mode in modes])
    size = np.abs(poles)
    slope = np.ravel(np.column_stack([poles.real / size / (2 * np.pi), -(poles.imag**2) / size**3]))
    return np.asarray(window.decay_std_per_s**2 * np.outer(slope, slope))


def _compensated_order(report: OrderReport, window: ExponentialWindow) -> OrderReport:
    omega = 2 * np.pi * report.frequency_hz
    return replace(
        report,
        damping_ratio=report.damping_ratio - window.decay_per_s / omega,
        damping_std=float(np.hypot(report.damping_std, window.decay_std_per_s / omega)),
    )


def _note(modes: list[Mode], window: ExponentialWindow) -> str:
    low, high = modes[0], modes[-1]
    added = [100 * window.decay_per_s / abs(mode.pole) for mode in (low, high)]
    known = f" ± {window.std_s:g}" if window.std_s else ""
    return (
        f"The damping of the exponential window ({window.time_constant_s:g}{known} s) is "
        f"compensated: −{number(added[0])} % of critical at {low.frequency_hz:.0f} Hz, "
        f"−{number(added[1])} % at {high.frequency_hz:.0f} Hz. FRFs and stability diagram are as "
        "measured."
    )


def with_unknown_window(model: ModalModel, frf: FRF, stated: Sequence[bool]) -> ModalModel:
    """Modes whose ± of damping holds `std_of_unknown_window`, all alike.

    Poles that are `stated` have it in what is known of them.
    """
    half = np.array(
        [std_of_unknown_window(frf, mode.frequency_hz, mode.damping_ratio) for mode in model.modes]
    )
    if not np.any(half):
        return model
    shared = np.where(stated, 0.0, half)
    covariance = model.covariance.copy()
    covariance[1::2, 1::2] += np.outer(shared, shared)
    std = np.sqrt(np.diag(covariance))[1::2]
    return replace(
        model,
        modes=tuple(
            replace(mode, damping_std=float(known))
            for mode, known in zip(model.modes, std, strict=True)
        ),
        covariance=covariance,
        orders=tuple(_order_with_unknown_window(each, frf) for each in model.orders),
        notes=(*model.notes, _note_of_hann(model.modes, 2 * half)),
    )


def std_of_unknown_window(frf: FRF, frequency_hz: float, damping_ratio: float) -> float:
    """What the window leaves open of a damping ratio, of FRFs whose blocks are not known.

    No file says which window its FRFs were made with. Half of what a Hann window adds, which widens
    b lines to √(b² + 1.1²); 0 with an exponential window, beside which there is no other one.
    """
    if frf.blocks is not None or frf.exponential_window is not None:
        return 0.0
    seen_hz = damping_ratio * frequency_hz
    added_hz = _HANN_LINES * float(np.min(np.diff(frf.frequency_hz)))
    own_hz = np.sqrt(max(seen_hz**2 - added_hz**2, 0.0))
    return float(damping_ratio - own_hz / frequency_hz) / 2


def _order_with_unknown_window(report: OrderReport, frf: FRF) -> OrderReport:
    half = std_of_unknown_window(frf, report.frequency_hz, report.damping_ratio)
    return replace(report, damping_std=float(np.hypot(report.damping_std, half)))


def _note_of_hann(modes: Sequence[Mode], added: NDArray[np.float64]) -> str:
    share = 100 * added / [mode.damping_ratio for mode in modes]
    at = int(np.argmax(share))
    return (
        "FRFs without their recordings do not state their window. Of the damping ratios, up to "
        f"{share[at]:.2g} % may come from a Hann window (at {modes[at].frequency_hz:.0f} Hz); half "
        "of that is in their ±."
    )


def _not_listed(mode: Mode) -> str:
    return (
        f"The pole at {mode.frequency_hz:.1f} Hz is fitted but not listed: it decays more slowly "
        "than the exponential window alone."
    )


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

    def against(self, twins: Mapping[Key, Key]) -> Choice:
        """The same of a fit against another force, whose rows are the twins."""
        chosen = {twins[key]: how for key, how in self.chosen.items() if key in twins}
        order = {twins[key]: number for key, number in self.order.items() if key in twins}
        aside = frozenset(twins[key] for key in self.aside if key in twins)
        return Choice(chosen, aside, self.only_chosen, order)

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
        With one pole for each order, and pairs that are told apart as they are.
    band_hz : tuple of float
    rows : tuple of Row
        Ascending in frequency, but for the members of pairs.
    covariance : ndarray, shape (2 n_rows, 2 n_rows)
        Of (frequency_hz, damping_ratio) of the rows.
    ring : tuple of RingOrder
    drift : Drift
    values : ndarray of complex, shape (n_positions, n_lines)
        Inertances that were fitted.
    misfit : float
        Reduced χ²; NaN where the noise is not known.
    notes : tuple of str
    locked : frozenset of int, as in the keys of rows
    """

    frf: FRF
    fit: PoleFit
    band_hz: tuple[float, float]
    rows: tuple[Row, ...]
    covariance: NDArray[np.float64]
    ring: tuple[RingOrder, ...]
    drift: Drift
    values: Complex
    misfit: float
    notes: tuple[str, ...]
    locked: frozenset[int]

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
    if not (inside := [k for k, row in enumerate(rows) if choice.lists(row)]):
        raise FitError("no mode is left to list. Set fewer aside, or keep another one.")
    shown = [
        replace(rows[k].mode, chosen=choice.chosen.get(rows[k].key, Chosen.AUTOMATIC))
        for k in inside
    ]
    shown = list(label_modes(shown, frf.position_deg))
    for at, k in enumerate(inside):
        if rows[k].key in choice.order:
            shown[at] = of_order(shown[at], choice.order[rows[k].key], frf.position_deg)
    in_band = {row.key[0] for row in rows if row.in_band}
    ring = [order for order in settled.ring if order.is_main and order.key in in_band]
    reports = _reports(ring, {rows[k].key for k in inside}, choice.aside)
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
        axis=frf.axis,
        excitation_deg=frf.excitation_deg,
        drift=settled.drift,
        orders=reports,
        notes=(*settled.notes, *_notes(rows, choice), *choice.notes),
    )
    fitted = model.synthesise(fit.lines.frequency_hz, run=frf.run)
    model = replace(model, frac=frac(settled.values, fitted))
    stated = [rows[k].key[0] in settled.locked for k in inside]
    return with_unknown_window(without_window(model, frf.exponential_window), frf, stated)


def _reports(
    ring: Sequence[RingOrder], shown: set[Key], aside: frozenset[Key]
) -> tuple[OrderReport, ...]:
    """Verdicts on the orders of which something is listed, or nothing was set aside by hand."""
    reports = []
    for each in ring:
        own = {key for key in shown | aside if key[0] == each.key}
        if own & aside and not own & shown:
            continue
        report = each.report
        if own & aside and each.is_resolved:
            evidence = "the other member was set aside by hand"
            pair = replace(report.pair, verdict=Pair.ONE_SEEN, evidence=evidence)
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


def with_modal_masses(
    models: Sequence[ModalModel], frfs: Sequence[FRF], most: float
) -> tuple[list[ModalModel], list[Finding]]:
    """Models of several forces with the modal masses that their driving points give.

    At the point that a force drives, residue and shape give the mass of the mode:
    m = φ²/(2jω_d A), that of the shape as it is listed, its largest part 1. Weighted mean of all
    forces; ± from the residues, or from the scatter of the forces where that is more. Forces that
    differ by more than `most` give a finding.
    """
    masses: dict[int, tuple[float, float, float]] = {}
    apart = 0.0, ""
    for k, mode in enumerate(models[0].modes):
        seen = []
        for model, frf in zip(models, frfs, strict=True):
            own, place = counterpart(k, mode, model), driving_point(frf)
            if own is not None and place is not None:
                seen += _mass_at(own, *place)
        if not seen:
            continue
        mass, std = np.array(seen).T
        weight = std**-2.0 / np.sum(std**-2.0)
        mean = float(weight @ mass)
        off = np.abs(mass - mean)
        scatter = max(np.sum((off / std) ** 2) / max(mass.size - 1, 1), 1.0)
        known = np.sqrt(scatter / np.sum(std**-2.0))
        spread = np.sqrt(weight @ off**2) / mean if mass.size > 1 else np.nan
        masses[k] = mean, float(known), float(spread)
        counts = (off > _CLEAR * std) & (weight > _COUNTS * weight.max())
        clear = float(np.max(off / mean, where=counts, initial=0.0))
        apart = max(apart, (clear, f"{mode.frequency_hz:.2f} Hz"))
    doubt = []
    if apart[0] > most:
        detail = (
            f"modal masses from the driving points differ by {100 * apart[0]:.0f} % at {apart[1]}: "
            "check gains, places and directions of the forces"
        )
        doubt.append(Finding("", "", None, Check.FORCES, Verdict.WARNING, detail))
    scaled = []
    for model in models:
        modes = list(model.modes)
        for k, (mean, known, spread) in masses.items():
            own = counterpart(k, models[0].modes[k], model)
            if own is not None:
                at = next(i for i, each in enumerate(model.modes) if each is own)
                modes[at] = replace(
                    own, modal_mass_kg=mean, modal_mass_std_kg=known, modal_mass_spread=spread
                )
        scaled.append(replace(model, modes=tuple(modes)))
    return scaled, doubt


def counterpart(k: int, mode: Mode, model: ModalModel) -> Mode | None:
    """The mode `k` of another force's model; poles that coincide follow each other there too."""
    alike = [
        (abs(other.pole - mode.pole), at != k, other)
        for at, other in enumerate(model.modes)
        if (other.order, other.member) == (mode.order, mode.member)
    ]
    away, _, nearest = min(alike, key=lambda each: each[:2], default=(np.inf, True, mode))
    return nearest if away < -mode.pole.real else None


def _mass_at(own: Mode, row: int, sign: int) -> list[tuple[float, float]]:
    """Modal mass and its ± from one driving point; nothing where the force is at a node."""
    residue = sign * complex(own.residues[row])
    std = float(own.residues_std[row])
    if not abs(residue) > _LEAST_DRIVE * std:
        return []
    mass = float((own.shape[row] ** 2 / (2j * own.pole.imag * residue)).real)
    return [(mass, abs(mass) * max(std / abs(residue), _EXACT))]
