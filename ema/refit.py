"""Refits: an identification with other edits, at once or to the end, and what an edit costs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ema.automatic import Basis, automatic_basis, joint_bases
from ema.checks.corrections import channel_edits, corrected, corrections_by_hand
from ema.checks.sensor_mass import without_mass
from ema.core.edits import Edit
from ema.core.errors import InputError
from ema.core.modes import Mode
from ema.core.numerics import kept_with, one_blas_thread, stoppable
from ema.fitting.curve_fit import settled
from ema.fitting.edited_fit import EditedFit
from ema.fitting.listing import Key
from ema.fitting.pole_fit import PoleFit, fit_bounded
from ema.identify import Identification, edits_by_force, identified, identified_jointly

# Steps of a search that is only to say how much worse a fit is.
_FEW_TRIES = 8


@one_blas_thread
def refit_modes(
    found: Identification,
    edits: Sequence[Edit],
    *,
    live: bool = False,
    stop: Callable[[], bool] | None = None,
) -> Identification:
    """Identify the modes again with other edits.

    Without `live` the same, to the last digit, as `identify_modes` with these edits on the same
    FRFs. Edits of poles go on from where the automatic fit ended; those that only list or unlist
    modes need no fit. Edits of channels need all steps again.

    Parameters
    ----------
    found : Identification
        Of `identify_modes` or of this function; a preview of the same edits is finished.
    edits : sequence of Edit
        All that are in force.
    live : bool
        Whether to stop where poles, drift, leakage, residues and their ± have settled. Verdicts
        on pairs, checks of the channels, the cross-check and what the ends of the band change are
        those of before.
    stop : callable, optional
        Asked at every step of a search; the fit ends where it gives true.

    Returns
    -------
    Identification
        With `is_preview` where numbers can change yet.

    Raises
    ------
    InputError
        If `found` was read from a file, or an edit names a channel that was not measured.
    FitError
        If an edit names no mode, or several.
    SupersededError
        If it was stopped.

    Examples
    --------
    >>> import numpy as np
    >>> import ringmodal as rm
    >>> from ema.core.edits import Edit, EditKind, PoleName
    >>> frf = rm.estimate_frf(rm.read_campaign("sample_data/tyre_225_55R17"))
    >>> frf = frf.rows(np.arange(0, 72, 6))  # every 30°, to be quick
    >>> found = rm.identify_modes(frf, band_hz=(60.0, 160.0))
    >>> without = Edit(EditKind.SET_ASIDE, PoleName(121.4), reason="not seen at 2.0 bar")
    >>> [mode.order for mode in refit_modes(found, [without], live=True).model.modes]
    [1, 2, 4]
    """
    basis = found.basis
    if found.references and all(each.basis for each in found.references):
        with stoppable(stop):
            return _of_several(found, edits, live=live)
    if basis is None:
        rule = "it was read from a file and does not hold what a refit goes on from"
        raise InputError("result", "no fit", rule, "Identify the modes of its FRFs with the edits")
    with stoppable(stop):
        if not basis.is_of(edits) or (basis.is_preview and not live):
            anew = _live_basis if live and basis.stated_deg is None else _whole_basis
            basis = anew(basis, edits)
        return identified(basis, edits, live=live, before=found)


def _of_several(found: Identification, edits: Sequence[Edit], *, live: bool) -> Identification:
    """The same against several forces: where channels of one changed, the others stay by it."""
    bases = [each.basis for each in found.references if each.basis is not None]
    by_force = edits_by_force([basis.state.measured for basis in bases], edits)
    alone = list[Basis]()
    for basis, own in zip(bases, by_force, strict=True):
        each = basis.by_itself or basis
        if not basis.is_of(own) or (basis.is_preview and not live):
            anew = _live_basis if live and basis.stated_deg is None else _whole_basis
            each = anew(each, own)
        alone.append(each)
    pairs = zip(alone, bases, strict=True)
    stay = all(one.fit is (before.by_itself or before).fit for one, before in pairs)
    return identified_jointly(bases if stay else joint_bases(alone), edits, live=live)


def _whole_basis(basis: Basis, edits: Sequence[Edit]) -> Basis:
    return automatic_basis(basis.state.measured, basis.asked, edits)


def _live_basis(basis: Basis, edits: Sequence[Edit]) -> Basis:
    """The same fit on FRFs with other edits of channels, and with the automatic corrections."""
    measured, state = basis.state.measured, basis.state
    by_hand, told = corrections_by_hand(measured, edits)
    decided = {each.row for each in by_hand}
    others = [each for each in state.corrections if not each.is_by_hand and each.row not in decided]
    corrections = tuple(sorted((*by_hand, *others), key=lambda each: each.row))
    usable = corrected(measured, corrections)
    fitted = without_mass(usable, state.mass)
    curve = basis.fit.curve.on(fitted)
    state = replace(state, usable=usable, corrections=corrections).told(told)
    fit = EditedFit(curve, settled(curve), is_preview=True)
    return replace(
        basis,
        state=state,
        frf=fitted,
        fit=fit,
        edits=channel_edits(edits),
        is_preview=True,
        crossed=basis.crossed or basis.frf,
    )


@dataclass(frozen=True)
class ModeShift:
    """What an edit does to a mode that it does not name, in standard deviations of before."""

    frequency_hz: float
    order: int | None
    member: str
    frequency_shift_std: float
    damping_shift_std: float


@dataclass(frozen=True)
class EditCost:
    """What an edit costs: how much worse the fit becomes, and how far other modes move.

    Modes that are set aside stay in the fit of a result, and cost nothing there. Here they are
    taken out of it, which tells how much the FRFs need them.

    Parameters
    ----------
    chi_square_before, chi_square_after : float
        Weighted sum of squares that the listed modes leave.
    misfit_before, misfit_after : float
        The same over its degrees of freedom, 1 where only noise is left.
    shifts : tuple of ModeShift
        Of modes that are listed before and after.
    """

    chi_square_before: float
    chi_square_after: float
    misfit_before: float
    misfit_after: float
    shifts: tuple[ModeShift, ...]

    @property
    def change(self) -> float:
        """Δχ², positive where the fit gets worse; of other rows too where channels change."""
        return self.chi_square_after - self.chi_square_before


@one_blas_thread
def edit_cost(
    found: Identification, edits: Sequence[Edit], *, stop: Callable[[], bool] | None = None
) -> EditCost:
    """What other edits would cost against those of an identification.

    Parameters
    ----------
    found : Identification
    edits : sequence of Edit
        All that would be in force.
    stop : callable, optional
        As for `refit_modes`.
    """
    tried = refit_modes(found, edits, live=True, stop=stop)
    with stoppable(stop):
        before, after = _weighed(found), _weighed(tried)
    shifts = []
    for key, mode in before.listed.items():
        if key in after.listed:
            moved = after.poles[key] - before.poles[key]
            along = (mode.pole.conjugate() * moved).real / abs(mode.pole)
            ratio = (-moved.real - mode.damping_ratio * along) / abs(mode.pole)
            hz_std = along / (2 * np.pi) / mode.frequency_std_hz
            place = mode.frequency_hz, mode.order, mode.member
            shifts.append(ModeShift(*place, float(hz_std), float(ratio / mode.damping_std)))
    cost = before.chi_square, after.chi_square, before.misfit, after.misfit
    return EditCost(*cost, tuple(shifts))


@dataclass(frozen=True, eq=False)
class _Weighed:
    """What the listed modes leave, and where the poles are without those set aside."""

    chi_square: float
    misfit: float
    poles: Mapping[Key, complex]  # rad/s
    listed: Mapping[Key, Mode]


@kept_with
def _weighed(found: Identification) -> _Weighed:
    """Of several forces the sum of what is left, and the poles of the first one."""
    bases = [each.basis for each in found.references or (found,)]
    shown = [basis.shown or basis.fit for basis in bases if basis is not None]
    fits = [_fitted_again(each) for each in shown]
    (fit, keys), rows = fits[0], shown[0].settled.rows
    total = sum(each.chi_square for each, _ in fits)
    misfit = total / sum(each.chi_square / each.misfit for each, _ in fits)
    where = dict(zip(keys, fit.poles.tolist(), strict=True))
    names = [row.key for row in rows if shown[0].choice.lists(row)]
    named = dict(zip(names, found.model.modes, strict=False))
    return _Weighed(total, misfit, where, named)


def _fitted_again(shown: EditedFit) -> tuple[PoleFit, list[Key]]:
    """The poles without those set aside, and which rows they are.

    Pairs that several forces determine stay where they are: one force does not tell them apart.
    """
    rows = [row for row in shown.settled.rows if row.key not in shown.choice.aside]
    rows.sort(key=lambda row: row.key)  # those beyond the lines last
    before, curve = shown.curve.fit, shown.curve
    poles = np.array([row.mode.pole for row in rows])
    drift = before.drift if len(before.drift) > 1 else None
    stay = {*curve.locked, *curve.held, *(order.key for order in curve.ring if order.jointly)}
    locked = tuple(k for k, row in enumerate(rows) if row.key[0] in stay)
    given = curve.settings, drift, None, (), locked
    return fit_bounded(before.lines, poles, *given, tries=_FEW_TRIES), [row.key for row in rows]
