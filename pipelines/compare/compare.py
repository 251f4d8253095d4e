"""Two results side by side: what differs, and whether by more than the error bars allow."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipelines.compare.caveats import doubts
from pipelines.compare.conditions import (
    Contrast,
    condition_contrasts,
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
from pipelines.compare.parameters import ParameterChange, parameter_changes
from pipelines.compare.shapes import common_shapes
from pipelines.compare.significance import Agreement, agreement
from pipelines.process.run import retune
from pipelines.results.labels import short
from pipelines.results.result import Result

LONGEST_NAME = 40


@dataclass(frozen=True, eq=False)
class Comparison:
    """A second result against a first; every difference is second minus first.

    Parameters
    ----------
    first, second : Result
    names : (str, str)
        What to call them; never the same.
    modes : tuple of MatchedMode
        Ascending in frequency of the first.
    only_first, only_second : tuple of UnmatchedMode
    mac : ndarray, shape (n_first, n_second)
        All shapes of the first (rows) against all of the second; NaN where they cannot be
        compared.
    shapes_note : str
        On what ground shapes are compared, as a sentence.
    parameters : tuple of ParameterChange
        Empty where one result has no ring.
    conditions, processing : tuple of Contrast
        What was stated and chosen.
    doubts : tuple of str
        What makes the comparison doubtful, in sentences.
    agreement : Agreement or None
        All modes together; None where no standard deviation is known.

    Examples
    --------
    >>> import ringmodal as rm
    >>> found = rm.compare(rm.load("result"), rm.load("result"))
    >>> len(found.modes), found.only_first, found.is_repeat
    (8, (), False)
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

    @property
    def differing(self) -> tuple[Contrast, ...]:
        """Stated conditions that differ and may move a frequency."""
        return tuple(each for each in self.conditions if each.counts and each.differs)

    @property
    def is_repeat(self) -> bool:
        """Whether the same tyre was measured again and nothing stated differs."""
        return not self.differing and not same_recordings(self.first, self.second)


def compare(first: Result, second: Result) -> Comparison:
    """Compare two results: modes, shapes, ring parameters and how each was obtained.

    Differences of frequencies and damping ratios are tested together, those of identified ring
    parameters by themselves: two-sided, normal, with the number of comparisons accounted for by
    Holm's procedure at 5 %. What σ of a difference holds and what not: see
    `pipelines.compare.modes.std_of_difference`.

    Parameters
    ----------
    first, second : Result
        Tuned where ring parameters are to be compared (`pipelines.process.run.tune`).

    Returns
    -------
    Comparison

    Examples
    --------
    >>> import ringmodal as rm
    >>> first, second = rm.load("result"), rm.load("result")
    >>> rm.compare(first, second).mac.diagonal().round(3)
    array([1., 1., 1., 1., 1., 1., 1., 1.])
    """
    shapes = common_shapes(first.modal_model, second.modal_model)
    one = seen_by(first.modal_model, second.modal_model)
    two = seen_by(second.modal_model, first.modal_model)
    mac = common_shapes(one.model, two.model).mac
    matches = match_modes(one.model.modes, two.model.modes, mac)
    modes = matched_modes(one, two, matches, mac)
    conditions = condition_contrasts(first, second)
    processing = processing_contrasts(first, second)
    return Comparison(
        first=first,
        second=second,
        names=_names(first.name, second.name),
        modes=modes,
        only_first=unmatched_modes(one, two, dict(matches)),
        only_second=unmatched_modes(two, one, {j: i for i, j in matches}),
        mac=shapes.mac,
        shapes_note=shapes.how,
        parameters=parameter_changes(first, second),
        conditions=conditions,
        processing=processing,
        doubts=doubts(first, second, modes, conditions, processing),
        agreement=agreement([m.frequency for m in modes], [m.damping for m in modes]),
    )


def compare_folders(
    first: Path | str, second: Path | str, *, accept_changes: bool = False
) -> Comparison:
    """Compare two result folders; each ring is tuned as it was before.

    Parameters
    ----------
    first, second : path
    accept_changes : bool
        Whether to take results although parts of them were changed; `Comparison.doubts` says so.

    Raises
    ------
    InputError
        If a folder is no result, is damaged, or was changed and that is not accepted.

    Examples
    --------
    >>> import ringmodal as rm
    >>> found = rm.compare_folders("result", "result")
    >>> {each.name for each in found.parameters} >= {"radial_stiffness_n_m3"}
    True
    """
    one, two = (retune(Path(each), accept_changes=accept_changes) for each in (first, second))
    return compare(one, two)


def _names(first: str, second: str) -> tuple[str, str]:
    """Names that fit a heading and differ."""
    one, two = short(first, LONGEST_NAME), short(second, LONGEST_NAME)
    return (one, two) if one != two else (f"{one} (first)", f"{two} (second)")
