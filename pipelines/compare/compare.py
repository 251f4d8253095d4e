"""Comparison of two results: modes, shapes, ring parameters and conditions."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.circumference.orders import circle_basis, highest_order, on_circle
from ema.core.errors import require_type
from ema.core.mac import mac
from ema.core.modes import ModalModel
from pipelines.compare.conditions import (
    Contrast,
    condition_contrasts,
    doubts,
    processing_contrasts,
    same_recordings,
)
from pipelines.compare.modes import (
    MatchedMode,
    UnmatchedMode,
    match_modes,
    matched_modes,
    seen_by,
    unmatched_modes,
)
from pipelines.compare.significance import Agreement, ParameterChange, agreement, parameter_changes
from pipelines.process.ring import retune
from pipelines.results.options import Units
from pipelines.results.parameter_set import tuned_parameters
from pipelines.results.result import Result
from pipelines.results.tables import short

#: Longest name of a result in headings, characters.
LONGEST_NAME = 40
#: Positions closer than this are the same.
SAME_PLACE_DEG = 0.5
#: Fewest common nodes at which shapes are compared.
FEWEST_NODES = 3


@dataclass(frozen=True, eq=False)
class Comparison:
    """A second result compared with a first; every difference is second minus first.

    Parameters
    ----------
    first, second : Result
    names : (str, str)
        Always different.
    modes : tuple of MatchedMode
        Ascending in frequency of the first.
    only_first, only_second : tuple of UnmatchedMode
    mac : ndarray, shape (n_first, n_second)
        Shapes of the first (rows) against those of the second; NaN where not comparable.
    shapes_note : str
        Where shapes are compared, as a sentence.
    parameters : tuple of ParameterChange
        Empty where one result has no ring.
    conditions, processing : tuple of Contrast
    doubts : tuple of str
        Caveats, as sentences.
    agreement : Agreement or None
        All modes together; None where no standard deviation is known.
    units : Units
        That parameters and conditions are shown in.

    Examples
    --------
    >>> import ringmodal as rm
    >>> found = rm.compare(rm.load("result"), rm.load("result"))
    >>> len(found.modes), found.only_first, found.is_repeat
    (9, (), False)
    """

    first: Result
    second: Result
    names: tuple[str, str]
    modes: tuple[MatchedMode, ...]
    only_first: tuple[UnmatchedMode, ...]
    only_second: tuple[UnmatchedMode, ...]
    mac: NDArray[np.float64]
    shapes_note: str
    parameters: tuple[ParameterChange, ...]
    conditions: tuple[Contrast, ...]
    processing: tuple[Contrast, ...]
    doubts: tuple[str, ...]
    agreement: Agreement | None
    units: Units = Units.LAB

    def __repr__(self) -> str:
        moved = sum(mode.frequency.is_significant for mode in self.modes)
        alone = len(self.only_first) + len(self.only_second)
        return (
            f"<Comparison {' → '.join(self.names)}: {len(self.modes)} modes in both, {moved} with "
            f"another frequency; {alone} in one only>"
        )

    @property
    def differing(self) -> tuple[Contrast, ...]:
        """Stated conditions that differ and may move a frequency."""
        return tuple(each for each in self.conditions if each.counts and each.differs)

    @property
    def is_repeat(self) -> bool:
        """Whether this is a new measurement under the same stated conditions."""
        return not self.differing and not same_recordings(self.first, self.second)


def compare(first: Result, second: Result, units: Units = Units.LAB) -> Comparison:
    """Compare two results: modes, shapes, ring parameters and how each was obtained.

    Differences of frequencies and damping ratios are tested together, those of identified ring
    parameters separately: two-sided, normal, adjusted for the number of comparisons by Holm's
    procedure at 5 %. For the content of σ see `pipelines.compare.modes.std_of_difference`.

    Parameters
    ----------
    first, second : Result
        Tuned where ring parameters are to be compared (`pipelines.process.ring.tune`).
    units : Units
        That parameters and conditions are shown in.

    Examples
    --------
    >>> import ringmodal as rm
    >>> first, second = rm.load("result"), rm.load("result")
    >>> rm.compare(first, second).mac.diagonal().round(3)
    array([1., 1., 1., 1., 1., 1., 1., 1., 1.])
    """
    for result in (first, second):
        require_type("result", result, Result, "Use load, or compare_folders for folders")
    mac_of_all, shapes_note = common_shapes(first.modal_model, second.modal_model)
    one = seen_by(first.modal_model, second.modal_model)
    two = seen_by(second.modal_model, first.modal_model)
    table, _ = common_shapes(one.model, two.model)
    matches = match_modes(one.model.modes, two.model.modes, table)
    modes = matched_modes(one, two, matches, table)
    conditions = condition_contrasts(first, second, units)
    processing = processing_contrasts(first, second)
    return Comparison(
        first=first,
        second=second,
        names=_names(first.name, second.name),
        modes=modes,
        only_first=unmatched_modes(one, two, dict(matches)),
        only_second=unmatched_modes(two, one, {j: i for i, j in matches}),
        mac=mac_of_all,
        shapes_note=shapes_note,
        parameters=parameter_changes(
            tuned_parameters(first.tuning, first.damping),
            tuned_parameters(second.tuning, second.damping),
        ),
        conditions=conditions,
        processing=processing,
        doubts=doubts(first, second, modes, conditions, processing),
        agreement=agreement([m.frequency for m in modes], [m.damping for m in modes]),
        units=units,
    )


def compare_folders(
    first: Path | str, second: Path | str, *, accept_changes: bool = False, units: Units = Units.LAB
) -> Comparison:
    """Compare two result folders; each ring is tuned as it was before.

    Parameters
    ----------
    first, second : path
    accept_changes : bool
        Accept results of which parts were changed; `Comparison.doubts` then names them.
    units : Units
        That parameters and conditions are shown in.

    Raises
    ------
    InputError
        If a folder is not a result, is damaged, or was changed and that is not accepted.

    Examples
    --------
    >>> import ringmodal as rm
    >>> found = rm.compare_folders("result", "result")
    >>> {each.name for each in found.parameters} >= {"radial_stiffness_n_m3"}
    True
    """
    one, two = (retune(Path(each), accept_changes=accept_changes) for each in (first, second))
    return compare(one, two, units)


def _names(first: str, second: str) -> tuple[str, str]:
    """Names that fit a heading and differ."""
    one, two = short(first, LONGEST_NAME), short(second, LONGEST_NAME)
    return (one, two) if one != two else (f"{one} (first)", f"{two} (second)")


def common_shapes(first: ModalModel, second: ModalModel) -> tuple[NDArray[np.float64], str]:
    """MAC of the shapes of two results, and where these are compared, as a sentence.

    On a circle: at the common positions if these resolve all orders found, otherwise by amplitudes
    of the orders that both grids resolve. Without angles: at the common nodes. NaN where nothing
    is common.
    """
    ours, theirs = _residues(first), _residues(second)
    if not (on_circle(first.position_deg) and on_circle(second.position_deg)):
        nodes, here, there = np.intersect1d(first.node, second.node, return_indices=True)
        if nodes.size < FEWEST_NODES:
            how = f"Shapes are not compared: the results have {nodes.size} nodes in common."
            return np.full((len(ours), len(theirs)), np.nan), how
        places = f"the {nodes.size} nodes that both results have, by their numbers"
        how = f"Shapes are compared at {places}."
        return mac(ours[:, here], theirs[:, there]), how
    here, there = common_positions(first.position_deg, second.position_deg)
    orders = [mode.order for mode in first.modes + second.modes if mode.order is not None]
    if here.size and highest_order(first.position_deg[here]) >= max(orders, default=0):
        whole = here.size == first.position_deg.size == second.position_deg.size
        which = "all" if whole else "the"
        how = f"Shapes are compared at {which} {here.size} positions that both results have."
        return mac(ours[:, here], theirs[:, there]), how
    highest = min(highest_order(model.position_deg) for model in (first, second))
    how = (
        "The grids differ: shapes are compared by their amplitudes of cos nθ and sin nθ, orders "
        f"0 to {highest}, which each grid resolves."
    )
    return mac(_amplitudes(first, highest), _amplitudes(second, highest)), how


def common_positions(
    first_deg: NDArray[np.float64], second_deg: NDArray[np.float64]
) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Rows of the common positions in both, ascending in the first; each row at most once."""
    if not (first_deg.size and second_deg.size):
        return np.zeros(0, dtype=int), np.zeros(0, dtype=int)
    apart = np.abs((first_deg[:, None] - second_deg + 180) % 360 - 180)
    apart[~np.isfinite(apart)] = np.inf
    nearest = np.argmin(apart, axis=1)
    mutual = np.argmin(apart, axis=0)[nearest] == np.arange(first_deg.size)
    here = np.flatnonzero(mutual & (np.min(apart, axis=1) <= SAME_PLACE_DEG))
    return here, nearest[here]


def _amplitudes(model: ModalModel, highest: int) -> NDArray[np.complex128]:
    """Order amplitudes of all modes, scaled so that their MAC is that on the whole circle."""
    resolved = highest_order(model.position_deg)
    waves = np.linalg.pinv(circle_basis(model.position_deg, resolved))[: 2 * highest + 1]
    rms = np.full(len(waves), np.sqrt(0.5))
    rms[0] = 1.0
    return np.asarray(_residues(model) @ (waves * rms[:, None]).T)


def _residues(model: ModalModel) -> NDArray[np.complex128]:
    rows = [mode.residues for mode in model.modes]
    return np.array(rows, dtype=complex).reshape(len(rows), model.node.size)
